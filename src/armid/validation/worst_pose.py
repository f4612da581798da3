"""Search within the joint limits for the pose with the smallest eigenvalue of the mass matrix.

For consistent parameters M(q) is positive definite everywhere. For base parameters alone it need not be, and random
sampling can miss the pose where it is not. So the smallest eigenvalue is minimised from many poses; its derivative is
vᵀ (∂M/∂q) v with v the eigenvector [Lancaster1964].
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array

POSES = 4096
"""Number of random poses."""

STARTS = 16
"""Number of the worst of them that are refined."""

STEP = 1e-6
"""Step of the central difference of M [rad or m], with a truncation error of 1e-12."""

UNLIMITED = np.pi
"""Half width of the range of a joint without limits: one turn of a revolute joint."""


@dataclass(frozen=True, eq=False, slots=True)
class Pose:
    """Pose with the smallest eigenvalue.

    Attributes:
        min_eigenvalue: Smallest eigenvalue of the mass matrix there.
        q: The pose, shape (n,) [rad or m].
        unit: Unit of the eigenvalue: kg·m² if all joints are revolute, kg if all are prismatic, or both.
    """

    min_eigenvalue: float
    q: Array
    unit: str = "kg·m²"


def worst_pose(model: DynamicsModel, standard: Array, *, seed: int = 0) -> Pose:
    """Finds the pose within the joint limits with the smallest eigenvalue of the mass matrix, rotors included.

    Args:
        model: Arm and torque terms.
        standard: Standard parameters, or any with the same torque, shape (p,).
        seed: Seed of the random poses.
    """
    optimize: Any = import_module("scipy.optimize")
    low, high = _box(model)
    poses = np.random.default_rng(seed).uniform(low, high, (POSES, model.n))
    smallest = np.linalg.eigvalsh(model.mass_matrix(poses, standard))[:, 0]
    best = Pose(float("inf"), poses[0], _unit(model))
    for start in poses[np.argsort(smallest)[:STARTS]]:
        found = optimize.minimize(
            _eigenvalue,
            start,
            args=(model, standard),
            jac=True,
            method="L-BFGS-B",
            bounds=np.column_stack([low, high]),
            options={"ftol": 1e-14, "gtol": 1e-10},
        )
        if found.fun < best.min_eigenvalue:
            best = Pose(float(found.fun), np.asarray(found.x, dtype=np.float64), best.unit)
    return best


def worst_along(model: DynamicsModel, standard: Array, motion: Motion) -> Pose:
    """Finds the sample of a motion with the smallest eigenvalue of the mass matrix."""
    smallest = np.linalg.eigvalsh(model.mass_matrix(motion.q, standard))[:, 0]
    k = int(np.argmin(smallest))
    return Pose(float(smallest[k]), motion.q[k], _unit(model))


def _unit(model: DynamicsModel) -> str:
    """Unit of the mass matrix's eigenvalues."""
    kinds = {joint.is_prismatic for joint in model.robot.joints}
    return "kg·m² or kg, SI units of the joints" if len(kinds) > 1 else "kg" if kinds == {True} else "kg·m²"


def _box(model: DynamicsModel) -> tuple[Array, Array]:
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -UNLIMITED)
    high = np.where(np.isfinite(limits[:, 1]), limits[:, 1], UNLIMITED)
    return low, high


def _eigenvalue(q: Array, model: DynamicsModel, standard: Array) -> tuple[float, Array]:
    """Smallest eigenvalue at q and its gradient."""
    n = model.n
    steps = np.concatenate([np.zeros((1, n)), STEP * np.eye(n), -STEP * np.eye(n)])
    inertia = model.mass_matrix(q + steps, standard)
    eigenvalues, vectors = np.linalg.eigh(inertia[0])
    v = vectors[:, 0]
    slope = (inertia[1 : n + 1] - inertia[n + 1 :]) / (2.0 * STEP)
    return float(eigenvalues[0]), np.einsum("i,kij,j->k", v, slope, v)

"""Search within the joint limits for the pose with the smallest eigenvalue of the mass matrix.

For consistent parameters M(q) is positive definite everywhere. For base parameters alone it need not be, and random
sampling can miss the pose where it is not. So the smallest eigenvalue is minimised from many poses; its derivative is
vᵀ (∂M/∂q) v with v the eigenvector [Lancaster1964].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.maths.box_descent import descend_in_box
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array

POSES = 4096
"""Number of random poses."""

STARTS = 16
"""Number of the worst of them that are refined."""

ALIKE = 1e-9
"""Relative difference of eigenvalues below which poses count as equally bad, as they are where a joint does not
matter; the first is named, so that rounding does not choose."""

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
    low, high = _box(model)
    poses = np.random.default_rng(seed).uniform(low, high, (POSES, model.n))
    smallest = np.linalg.eigvalsh(model.mass_matrix(poses, standard))[:, 0]
    starts = poses[np.argsort(smallest)[:STARTS]]
    q, eigenvalue = descend_in_box(lambda q: _eigenvalues(q, model, standard), starts, low, high)
    least = float(eigenvalue.min())
    k = int(np.argmax(eigenvalue <= least + ALIKE * abs(least)))
    return Pose(float(eigenvalue[k]), q[k], _unit(model))


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


def _eigenvalues(q: Array, model: DynamicsModel, standard: Array) -> tuple[Array, Array]:
    """Smallest eigenvalues (K,) at poses (K, n) and their gradients (K, n)."""
    n = model.n
    steps = np.concatenate([np.zeros((1, n)), STEP * np.eye(n), -STEP * np.eye(n)])
    inertia = model.mass_matrix((q[:, None] + steps).reshape(-1, n), standard).reshape(len(q), 2 * n + 1, n, n)
    eigenvalues, vectors = np.linalg.eigh(inertia[:, 0])
    v = vectors[:, :, 0]
    slope = (inertia[:, 1 : n + 1] - inertia[:, n + 1 :]) / (2.0 * STEP)
    return eigenvalues[:, 0], np.einsum("ki,klij,kj->kl", v, slope, v)

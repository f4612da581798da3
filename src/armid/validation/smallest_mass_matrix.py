"""Search within the joint limits for the pose with the smallest eigenvalue of the mass matrix.

With physically consistent parameters, the mass matrix M(q) is positive definite in every pose. With base parameters
only, it may be indefinite in some poses, and random sampling may not find them. Therefore the smallest eigenvalue is
minimised from many start poses. Its derivative is vᵀ (∂M/∂q) v, where v is the eigenvector [Lancaster1964].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.maths.box_descent import descend_in_box
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

POSES = 4096
"""Number of random poses at which the mass matrix is computed before the search."""

STARTS = 16
"""Number of random poses with the smallest eigenvalues from which the search starts."""

ALIKE = 1e-9
"""Relative difference of the smallest eigenvalues of two poses below which they count as equal; the eigenvalue may
not depend on some joints. Of poses with equal eigenvalues the first one is returned, so that the result does not
depend on rounding."""

STEP = 1e-6
"""Step of the central differences of M [rad or m]; the truncation error is 1e-12."""

UNLIMITED = np.pi
"""Limit of the position of a joint without position limits [rad or m], in both directions: one turn in total for a
revolute joint."""


@dataclass(frozen=True, eq=False, slots=True)
class Pose:
    """Pose in which the mass matrix has the smallest eigenvalue.

    Attributes:
        min_eigenvalue: Smallest eigenvalue of the mass matrix in this pose.
        q: The pose, shape (n,) [rad or m].
        unit: Unit of the eigenvalue: kg·m² if all joints are revolute, kg if all are prismatic, or both.
    """

    min_eigenvalue: float
    q: Array
    unit: str = "kg·m²"


def worst_pose(model: DynamicsModel, standard: Array, *, seed: int = 0) -> Pose:
    """Finds the pose within the joint limits in which the mass matrix, with rotors, has the smallest eigenvalue.

    Args:
        model: Arm and torque terms.
        standard: Standard parameters, or other values that give the same torque, shape (p,).
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
    """Finds the sample of a motion at which the mass matrix has the smallest eigenvalue."""
    smallest = np.linalg.eigvalsh(model.mass_matrix(motion.q, standard))[:, 0]
    k = int(np.argmin(smallest))
    return Pose(float(smallest[k]), motion.q[k], _unit(model))


def _unit(model: DynamicsModel) -> str:
    """Unit of the eigenvalues of the mass matrix, which depends on the kinds of the joints."""
    kinds = {joint.is_prismatic for joint in model.robot.joints}
    return "kg·m² or kg, SI units of the joints" if len(kinds) > 1 else "kg" if kinds == {True} else "kg·m²"


def _box(model: DynamicsModel) -> tuple[Array, Array]:
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -UNLIMITED)
    high = np.where(np.isfinite(limits[:, 1]), limits[:, 1], UNLIMITED)
    return low, high


def _eigenvalues(q: Array, model: DynamicsModel, standard: Array) -> tuple[Array, Array]:
    """Smallest eigenvalues of the mass matrix at poses (K, n), shape (K,), and their gradients, shape (K, n)."""
    n = model.n
    steps = np.concatenate([np.zeros((1, n)), STEP * np.eye(n), -STEP * np.eye(n)])
    inertia = model.mass_matrix((q[:, None] + steps).reshape(-1, n), standard).reshape(len(q), 2 * n + 1, n, n)
    eigenvalues, vectors = np.linalg.eigh(inertia[:, 0])
    v = vectors[:, :, 0]
    slope = (inertia[:, 1 : n + 1] - inertia[:, n + 1 :]) / (2.0 * STEP)
    return eigenvalues[:, 0], np.einsum("ki,klij,kj->kl", v, slope, v)

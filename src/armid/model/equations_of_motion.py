"""Equations of motion for simulation and control: bias torque, forward dynamics, and the regressor of Slotine and Li.

    M(q) q̈ + C(q, q̇) q̇ + g(q) + friction = τ

The matrices M and C are `DynamicsModel.mass_matrix` and `DynamicsModel.coriolis_matrix`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from armid import kernel
from armid.checked_array import Array, array
from armid.errors import ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.torque_law_expression import symbols

CONVERGED = 1e-12
"""Relative change of the acceleration below which the iteration for load-dependent friction ends: the rounding error
of a linear system of a few joints."""

DIVERGED = 1e6
"""Ratio of the change of the acceleration in an iteration to the change in the first one, above which the iteration
has diverged."""

MOST_ITERATIONS = 100
"""Largest number of iterations for load-dependent friction. Each one reduces the error by the ratio of friction to
load, which is about 0.1 in gears, so 12 iterations are usual."""


def bias_torque(model: DynamicsModel, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
    """Bias torque C(q, q̇) q̇ + g(q) of the rigid links, shape (N, n) [N·m or N].

    Args:
        model: Arm and torque terms.
        q: Joint positions, shape (N, n) [rad or m].
        dq: Joint velocities, shape (N, n) [rad/s or m/s].
        parameters: Standard parameters, shape (p,).
    """
    q = array(q, (None, model.n), "joint positions")
    dq = array(dq, q.shape, "joint velocities")
    theta = array(parameters, (len(model.parameters),), "standard parameters")
    if not model.has_rigid_bodies:
        return np.zeros_like(q)
    inertial = theta[model.inertial_columns].reshape(model.n, 10)
    return kernel.inverse_dynamics(model.tree, inertial, q, dq, np.zeros_like(q))


def forward_dynamics(model: DynamicsModel, motion: Motion, torque: ArrayLike, parameters: ArrayLike) -> Array:
    """Joint accelerations that a joint torque causes against inertia and friction, shape (N, n) [rad/s² or m/s²].

    The mass matrix of each sample is factorised once. Friction that depends on the load of the joints depends on the
    acceleration, so the acceleration is then found by iteration.

    Args:
        model: Arm and torque terms.
        motion: Positions and velocities, and hysteresis states if the model needs them: a motion without these states
            is taken as one contiguous run. Its accelerations are not used.
        torque: Joint torque, shape (N, n) [N·m or N].
        parameters: Standard parameters, shape (p,).

    Raises:
        ModelError: The mass matrix of a sample is not positive definite, or the iteration does not converge.
    """
    torque = array(torque, motion.q.shape, "torque")
    motion = motion if motion.memory is not None else model.remember(motion)
    factors = _factors(model.mass_matrix(motion.q, parameters))
    loaded = any("load" in symbols(law.expression) for _, law in model.laws)
    ddq = np.zeros_like(motion.q)
    first = 0.0
    for iteration in range(MOST_ITERATIONS):
        step = _solved(factors, torque - model.torque(replace(motion, ddq=ddq), parameters))
        ddq, change = ddq + step, float(np.abs(step).max(initial=0.0))
        if not loaded or change <= CONVERGED * np.abs(ddq).max(initial=0.0):
            return ddq
        first = first if iteration else change
        if change > DIVERGED * first:
            break
    raise ModelError(
        "The acceleration was not found, because the load-dependent friction is larger than the load.",
        remedy="identify without load-dependent friction.",
    )


def slotine_li_regressor(model: DynamicsModel, motion: Motion, dq_r: ArrayLike, ddq_r: ArrayLike) -> Array:
    """Regressor Y_r with Y_r θ = M(q) q̈_r + C(q, q̇) q̇_r + g(q) + friction, shape (N, n, p) [Slotine1987].

    The product C(q, q̇) q̇_r is symmetric in both velocities. It is therefore computed as C(q, s) s - C(q, d) d with
    s = (q̇ + q̇_r) / 2 and d = (q̇ - q̇_r) / 2. The friction is that of the velocities q̇ and the accelerations q̈_r.

    Args:
        model: Arm and torque terms.
        motion: Positions q and velocities q̇, and hysteresis states if the model needs them. Its accelerations are not
            used.
        dq_r: Reference velocities, shape (N, n) [rad/s or m/s].
        ddq_r: Reference accelerations, shape (N, n) [rad/s² or m/s²].
    """
    q, dq = motion.q, motion.dq
    dq_r, ddq_r = array(dq_r, q.shape, "reference velocities"), array(ddq_r, q.shape, "reference accelerations")
    Y = model.regressor(replace(motion, ddq=ddq_r))
    if model.has_rigid_bodies:
        weightless = replace(model.tree, gravity=np.zeros(3))
        sums = kernel.regressor(model.tree, q, 0.5 * (dq + dq_r), ddq_r)
        differences = kernel.regressor(weightless, q, 0.5 * (dq - dq_r), np.zeros_like(q))
        Y[:, :, model.inertial_columns] = sums - differences
    return Y


def _factors(M: Array) -> Array:
    """Cholesky factors L with M = L Lᵀ of the mass matrices of all samples, shape (N, n, n)."""
    try:
        return np.asarray(np.linalg.cholesky(M), dtype=np.float64)
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(M)[:, 0]
        raise ModelError(
            f"The mass matrix of sample {int(smallest.argmin())} is not positive definite: its smallest eigenvalue "
            f"is {smallest.min():.2g}, so a torque has no physical acceleration.",
            remedy='identify with method = "physical", which gives links that can exist.',
        ) from None


def _solved(factors: Array, right: Array) -> Array:
    """Solutions x of L Lᵀ x = b for factors L (N, n, n) and right sides b (N, n), shape (N, n)."""
    half = np.linalg.solve(factors, right[:, :, None])
    return np.asarray(np.linalg.solve(np.swapaxes(factors, 1, 2), half)[:, :, 0], dtype=np.float64)

"""An arm with true parameters, recordings of it, and what information must say of them; for tests of information."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.information.information import Information, stack, total
from armid.maths.signals.decimation import coarsest_step, decimate, decimation_filter, decimation_step, interpolate
from armid.maths.signals.zero_phase_filters import low_pass, periodic_filter, zero_phase
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from problems import lively_motion
from trees import random_tree, robot_of

RATE = 100.0
NOISE = 0.2

EXACT = 1e-12
"""Error of a product of columns over their lengths, columns taken one by one."""

Arm = tuple[DynamicsModel, BaseParameters, Array]


def branching_arm() -> Arm:
    """An arm with a branch and a sliding joint, with friction; its base parameters and their true values."""
    rng = np.random.default_rng(3)
    tree = random_tree(rng, 4, prismatic=0.0)
    tree = replace(tree, parent=[-1, 0, 1, 1], prismatic=[0, 0, 1, 0])
    model = DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(width=0.1), Offset()))
    base = find_base_parameters(model)
    return model, base, rng.normal(size=base.count)


def recorded(
    arm: Arm, seed: int, seconds: float = 12.0, noise: float = NOISE, rate: float = RATE
) -> tuple[Motion, Array]:
    """One period of a motion, and its torque with noise."""
    model, base, truth = arm
    rng = np.random.default_rng(seed)
    motion = lively_motion(rng, model.n, rate, seconds)
    torque = model.regressor(motion)[:, :, base.kept] @ truth
    return motion, torque + noise * rng.normal(size=torque.shape)


def dense(arm: Arm, run: ObservedRun) -> Array:
    """Columns and torque (N, n, b + 1) of a run."""
    model, base, _ = arm
    return np.concatenate([model.regressor(run.motion)[:, :, base.kept], run.torque[:, :, None]], axis=2)


def rows_between(run: ObservedRun, band: Band) -> int:
    """Rows of the output grid for each that the band needs; whole periods must stay whole."""
    periodic = band.edges == "periodic"
    wanted = coarsest_step(run.rate, band.cutoff) // run.step
    fitting = [f for f in range(2, wanted + 1) if not periodic or run.motion.samples % (f * run.step) == 0]
    return max(fitting, default=1)


def filtered(arm: Arm, run: ObservedRun, band: Band) -> Array:
    """Dense rows (M, n, b + 1) through the band on the run's output grid, in the steps that the stream takes.

    The sharp filter computes all rows here, of which those of the grid are taken; the stream computes no others.
    """
    early = decimation_step(run.rate, band.cutoff, run.step)
    factor = rows_between(run, band) if early == run.step else 1
    early *= factor
    periodic = band.edges == "periodic"
    first = run.offset if factor > 1 else run.offset % early
    x = decimate(dense(arm, run), decimation_filter(early), early, first, periodic=periodic)
    sharp = low_pass(band.family, band.order, band.cutoff, run.rate / early)
    whole = run.motion.samples % early == 0
    lead, late = (run.offset - first) // early, max(1, run.step // early)
    y = periodic_filter(sharp, x) if periodic and whole else zero_phase(sharp, x)
    if factor > 1:
        return np.moveaxis(interpolate(np.moveaxis(y, 0, -1), factor, periodic=periodic), -1, 0)[: len(run.rows)]
    return y[lead::late][: len(run.rows)]


def solved(information: Information, weights: Array | None = None) -> Array:
    """The estimate."""
    A, y = stack(information, weights)
    return np.linalg.lstsq(A, y, rcond=None)[0]


def assert_says(information: Information, rows: Array, tolerance: float = EXACT) -> None:
    """The information is that of dense rows (M, n, b + 1), joint by joint."""
    whole = total(information)
    for j, joint in enumerate(whole.joints):
        own = rows[:, j][:, [*joint.parameters, whole.count]]
        assert_products(joint.R[0], own, tolerance)
        others = np.setdiff1d(np.arange(whole.count), joint.parameters)
        assert not rows[:, j][:, others].any()


def assert_products(R: Array, X: Array, tolerance: float) -> None:
    """RᵀR = XᵀX, each column by its own scale."""
    size = np.linalg.norm(X, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    assert np.abs((R.T @ R - X.T @ X) / np.outer(size, size)).max() <= tolerance

"""Friction laws that a recording resolves: those whose part near standstill lasts long enough to pass the band.

At a reversal a joint passes the speeds at which a narrow law acts within milliseconds. The band averages over that
time, so the data give the impulse of the law and not its height; the height that fits could be thirty times the
friction of the joint, and would act on the next slow motion in full.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.information.filtering import in_band
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Term

RESOLVED = 0.5
"""Share of a law's height that the band must leave in some row that counts; below it the height is extrapolated."""

SATURATED = 1e3
"""Speed at which a velocity law has reached its limit [rad/s or m/s]."""

SLOWEST, GRID = 1e-4, 400
"""Least speed at which the height of a law is looked for [rad/s or m/s], and number of speeds."""


def passed_height(model: DynamicsModel, term: Term, width: float, observations: Observations) -> Array:
    """Share of the height of a velocity law that is left behind the band, at most over the rows that count.

    The part that differs from Coulomb friction is looked at: the whole of a Stribeck effect, and of a sigmoid what
    lies between it and its limit.

    Args:
        model: Arm.
        term: A law of the velocity alone, on all joints.
        width: Velocity over which Coulomb friction turns [rad/s or m/s].
        observations: The training recordings.

    Returns:
        Shape (n,); 1 where rows are separate or nothing is filtered and a row lies at the height.
    """
    alone = replace(model, terms=(term,))
    speeds = np.geomspace(SLOWEST, SATURATED, GRID)[:, None] * np.ones(model.n)
    height = np.abs(_near_standstill(alone, speeds, width)).max(axis=0)
    passed = np.zeros(model.n)
    for run in observations.runs:
        values = _near_standstill(alone, run.motion.dq, width)
        passed = np.maximum(passed, _largest(values, run, observations.band))
    return np.divide(passed, height, out=np.zeros(model.n), where=height > 0.0)


def passed_transition(model: DynamicsModel, term: Term, width: float, observations: Observations) -> Array:
    """Share of the transition of a hysteresis element that is left behind the band, at most over the rows that count.

    After a reversal an element needs two deflections of travel to turn; until then it differs from Coulomb friction
    by up to 2. Elements whose transition the band averages away cannot be told from Coulomb friction, nor from each
    other, and share it in large amounts of opposite sign.

    Args:
        model: Arm.
        term: One element on all joints.
        width: Velocity over which Coulomb friction turns [rad/s or m/s].
        observations: The training recordings, whose samples follow each other in time.

    Returns:
        Shape (n,).
    """
    alone = replace(model, terms=(term,))
    passed = np.zeros(model.n)
    for run in observations.runs:
        known = with_hysteresis_states(alone, run, observations.band)
        values = (_of_joints(alone, known.motion) - _sign(known.motion.dq, width)) / 2.0
        passed = np.maximum(passed, _largest(values, known, observations.band))
    return passed


def _largest(values: Array, run: ObservedRun, band: Band) -> Array:
    """Largest size behind the band over the rows that count, shape (n,)."""
    if run.consecutive and not band.is_open:
        values = in_band(values, run.rate, band)
    return np.where(run.mask, np.abs(values[run.rows]), 0.0).max(axis=0, initial=0.0)


def _sign(dq: NDArray[np.float64], width: float) -> Array:
    return np.tanh(dq / width) if width > 0.0 else np.sign(dq)


def _near_standstill(alone: DynamicsModel, dq: NDArray[np.float64], width: float) -> Array:
    """The law less its limit at high speed times the sign of the velocity, shape (N, n)."""
    still = np.zeros_like(dq)
    top = Motion.of_states(still[:1], np.full((1, alone.n), SATURATED), still[:1])
    return _of_joints(alone, Motion.of_states(still, dq, still)) - _of_joints(alone, top) * _sign(dq, width)


def _of_joints(alone: DynamicsModel, motion: Motion) -> Array:
    """The one law of each joint along a motion, shape (N, n)."""
    columns = alone.term_columns(motion)
    values = np.zeros_like(motion.dq)
    for joint, column in zip(columns.joint, columns.values, strict=True):
        values[:, joint] += column
    return values

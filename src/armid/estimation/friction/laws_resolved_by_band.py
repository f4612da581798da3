"""Friction laws that a recording resolves: their effect near standstill lasts long enough for the low-pass filter.

A narrow law acts only at low speeds, through which a joint passes within milliseconds at a reversal. The low-pass
filter averages over a longer time. Therefore the filtered data determine the impulse of the law (height times time)
and not its height. The estimated height could be thirty times the friction of the joint, and the prediction of a slow
motion would then be wrong.
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
"""Share of a law's height that must remain after the filter in some row in use. For a smaller share, the height would
be an extrapolation."""

SATURATED = 1e3
"""Speed at which a velocity law has reached its limit [rad/s or m/s]."""

SLOWEST, GRID = 1e-4, 400
"""Smallest speed at which the height of a law is evaluated [rad/s or m/s], and number of speeds up to `SATURATED`."""


def passed_height(model: DynamicsModel, term: Term, width: float, observations: Observations) -> Array:
    """Share of the height of a velocity law that remains after the low-pass filter, maximum over the rows in use.

    Only the part of the law that differs from Coulomb friction is evaluated. For a Stribeck effect this is the whole
    law, for a sigmoid it is the difference between the law and its limit at high speed.

    Args:
        model: Arm.
        term: Term with a law that depends only on the velocity, on all joints.
        width: Velocity over which the sign of Coulomb friction changes [rad/s or m/s].
        observations: The training recordings.

    Returns:
        Share for each joint, shape (n,). If there is no filter, or if the rows are separate samples, it is 1 as soon
        as one row is at the maximum of the law.
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
    """Share of a hysteresis element's transition after a reversal that remains after the low-pass filter.

    It is the maximum over the rows in use.

    After a reversal an element changes from -1 to 1 over a travel of two deflections. During this travel it differs
    from Coulomb friction by up to 2. If the filter averages over the transition, the element cannot be distinguished
    from Coulomb friction or from other elements. Their estimates are then large values of opposite sign.

    Args:
        model: Arm.
        term: Term with one hysteresis element on each joint.
        width: Velocity over which the sign of Coulomb friction changes [rad/s or m/s].
        observations: The training recordings, whose samples follow each other in time.

    Returns:
        Share for each joint, shape (n,).
    """
    alone = replace(model, terms=(term,))
    passed = np.zeros(model.n)
    for run in observations.runs:
        known = with_hysteresis_states(alone, run, observations.band)
        values = (_of_joints(alone, known.motion) - _sign(known.motion.dq, width)) / 2.0
        passed = np.maximum(passed, _largest(values, known, observations.band))
    return passed


def _largest(values: Array, run: ObservedRun, band: Band) -> Array:
    """Largest absolute value of signals (N, n) after the low-pass filter, over the rows in use, shape (n,)."""
    if run.consecutive and not band.is_open:
        values = in_band(values, run.rate, band)
    return np.where(run.mask, np.abs(values[run.rows]), 0.0).max(axis=0, initial=0.0)


def _sign(dq: NDArray[np.float64], width: float) -> Array:
    return np.tanh(dq / width) if width > 0.0 else np.sign(dq)


def _near_standstill(alone: DynamicsModel, dq: NDArray[np.float64], width: float) -> Array:
    """Part of a velocity law that differs from Coulomb friction, at joint velocities (N, n), shape (N, n).

    It is the law minus the product of its limit at high speed and the sign of the velocity.
    """
    still = np.zeros_like(dq)
    top = Motion.of_states(still[:1], np.full((1, alone.n), SATURATED), still[:1])
    return _of_joints(alone, Motion.of_states(still, dq, still)) - _of_joints(alone, top) * _sign(dq, width)


def _of_joints(alone: DynamicsModel, motion: Motion) -> Array:
    """Values of the law of each joint along a motion, shape (N, n)."""
    columns = alone.term_columns(motion)
    values = np.zeros_like(motion.dq)
    for joint, column in zip(columns.joint, columns.values, strict=True):
        values[:, joint] += column
    return values

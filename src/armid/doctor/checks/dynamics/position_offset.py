"""Positions with another zero than the description's.

A zero shows by the geometry alone, and more clearly where the description's inertias are taken for a guess: the
weight of a forearm points down, whatever it is. The zero of a vertical first joint shows in no torque, those of
light wrists in few.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import products
from armid.errors import Finding
from armid.measurement.remedy import lines
from armid.values import Array

__all__ = ["check", "explain", "offsets_of"]

CODE = "position-offset"

STEP = 1e-4
"""Displacement by which the torque's derivative is taken [rad or m]: rounding and curvature both stay below
1e-7."""

LONGEST = 0.4
"""Largest change of a zero in one Gauss-Newton step [rad]."""

KNOWN = 0.15
"""Deviation from which on the torques say nothing about a joint's zero [rad]; it is left where it is."""

STEPS = 4
"""Rounds of moving zeros; three are enough where the description has weights."""

LEAST = 0.08
"""Smallest offset worth a word [rad]. Fits of recorded arms, whose zeros are right, find up to 0.06."""

SURE = 4.5
"""Standard deviations by which an offset must differ from none."""

SURER, SUREST = 5.5, 8.0
"""The same where the torque says little: then they are the description's weights against the arm's, which differ. A
sound log came to 4.9; up to the second it is a warning."""

ALONE = 0.015
"""Fall of the residual, as a logarithm, from which the torque says enough by itself."""

LOSS = 0.005
"""Rise of the residual, as a logarithm, that zeros nearer to the description's weights may bring."""

USUAL = 0.1
"""Conflict between the joints that noise makes; where more remains, deviations grow with it, since what conflicts
is then none of noise."""

MASS, SPREAD, INERTIA = 0.3, 0.03, 0.5
"""How far the description is trusted: share of mass and first moment, centre of mass [m], share of inertia."""

UNSEEN = 1e-10
"""Added to what is known of columns of unit length: where nothing is, as of the last joint's zero without a
description, the deviation is then huge."""

FREE = 1e3
"""Deviation of parameters that the description does not have, in SI units."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if other zeros explain the log."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """The zeros that explain the log, or `None` if they are those that it has."""
    offset, deviation, after = offsets_of(state)
    if not _are_sure(offset, deviation).any():
        return None
    gain = state.fit.cost - after.fit.cost
    deviation = deviation * np.hypot(1.0, after.conflict / USUAL)
    sure = _are_sure(offset, deviation)
    known = state.nominal is not None
    least = float(np.min(np.abs(offset)[sure] / deviation[sure], initial=np.inf))
    if not sure.any() or (gain < ALONE and not (known and least > SURER)):
        return None
    only = np.where(sure, offset, 0.0)
    names = state.model.robot.joint_names
    listed = ", ".join(f"{names[j]} {offset[j]:+.3f} ± {deviation[j]:.3f}" for j in np.flatnonzero(sure))
    return Explanation(
        CODE,
        max(gain, LOSS),
        "error" if gain >= ALONE or least > SUREST else "warning",
        ", ".join(names[j] for j in np.flatnonzero(sure)),
        f"Positions that are off by {listed} rad would leave {1 - np.exp(-max(gain, 0.0)):.0%} less of the torque"
        + (", with weights nearer to the description's." if known else "."),
        lambda evidence: lines(joint_offset=np.round(_given(evidence, state.rows.n) + only, 3) + 0.0),
        after,
    )


def _given(evidence: LogEvidence, n: int) -> Array:
    """Offsets (n,) that the reading has already."""
    given = evidence.reading.joint_offset
    return np.zeros(n) if given is None else np.asarray(given)


def _are_sure(offset: Array, deviation: Array) -> NDArray[np.bool_]:
    return (np.abs(offset) > SURE * deviation) & (np.abs(offset) > LEAST)


def offsets_of(state: LogState) -> tuple[Array, Array, LogState]:
    """Fit what must be added to the positions (n,) for the torques, its deviation, and the log then."""
    n, b = state.rows.n, state.base.count
    precision, expected = _prior(state)
    offset, deviation = np.zeros(n), np.full(n, np.inf)
    now = state
    for _ in range(STEPS):
        weight = 1.0 / (now.fit.sigma**2 * now.fit.memory)
        values = _posterior(now, weight, precision, expected, np.zeros((0, *now.rows.torque.shape)))[0]
        theta = now.standard(values)
        slopes = now.rigid_slopes(theta, STEP)
        found, spread = _posterior(now, weight, precision, expected, slopes)
        step, deviation = found[b:], spread[b:]
        seen = (deviation > 0.0) & (deviation < KNOWN)
        step = np.where(seen, np.clip(step, -LONGEST, LONGEST), 0.0)
        deviation = np.where(seen, deviation, np.inf)
        if not _are_sure(2.0 * (offset + step), deviation).any():
            break  # nor would they be after more steps
        moved = state.on(state.log.moved(offset + step))
        if moved.fit.cost > now.fit.cost + LOSS or not step.any():
            break
        offset, now = offset + step, moved
    return offset, deviation, now


def _prior(state: LogState) -> tuple[Array, Array]:
    """Precision (b, b) of the description's base parameters, and these; zeros where it has no inertias."""
    b, model = state.base.count, state.model
    theta = model.nominal_parameters()
    if theta is None:
        return np.zeros((b, b)), np.zeros(b)
    deviation = np.full(len(theta), FREE)
    for own in model.inertial_columns.reshape(-1, 10):
        body = theta[own]
        deviation[own[0]] = MASS * body[0]
        deviation[own[1:4]] = MASS * np.abs(body[1:4]) + SPREAD * body[0]
        moved = SPREAD * (2.0 * float(np.linalg.norm(body[1:4])) + SPREAD * body[0])  # by the centre of mass
        deviation[own[4:]] = INERTIA * np.abs(body[4:]).max() + moved
    deviation = np.maximum(deviation, 1e-6)
    spread = state.base.regrouping * deviation
    covariance = spread @ spread.T
    unit = np.sqrt(np.diag(covariance))
    return np.linalg.inv(covariance / np.outer(unit, unit)) / np.outer(unit, unit), state.base.values_of(theta)


def _posterior(
    state: LogState, weight: Array, precision: Array, expected: Array, extra: Array
) -> tuple[Array, Array]:
    """Base parameters and factors of the extra columns with their deviations, given data and prior."""
    rows, b, more = state.rows, state.base.count, len(extra)
    H, side = np.zeros((b + more, b + more)), np.zeros(b + more)
    H[:b, :b], side[:b] = precision, precision @ expected
    for j, P in enumerate(products(rows, extra=extra)):
        own = np.concatenate([rows.parameters[j], np.arange(b, b + more)])
        H[np.ix_(own, own)] += weight[j] * P[:-1, :-1]
        side[own] += weight[j] * P[:-1, -1]
    unit = np.sqrt(np.diag(H))
    unit = np.where(unit > 0.0, unit, 1.0)
    inverse = np.linalg.inv(H / np.outer(unit, unit) + UNSEEN * np.eye(b + more)) / np.outer(unit, unit)
    return inverse @ side, np.sqrt(np.maximum(np.diag(inverse), 0.0))

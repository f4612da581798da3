"""Check for offsets between the zeros of the logged positions and the zeros of the description.

A wrong zero changes the geometry and thus the torque. The inertias of the description are used as a prior, because
they make the offset more visible: the gravity torque of a forearm, for instance, has a known phase for any mass. The
offset of a vertical first joint cannot be found, because the torque does not depend on it. Offsets of light wrists
have little effect on the torque.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import products
from armid.doctor.rows_away_from_reversals import away_from_reversals
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

CODE = "position-offset"

STEP = 1e-4
"""Step of the finite difference of the torque [rad or m]: errors by rounding and curvature both stay below 1e-7."""

LONGEST = 0.4
"""Largest change of an offset in one Gauss-Newton step [rad]."""

KNOWN = 0.15
"""Standard deviation from which the offset of a joint counts as undetermined and is not changed [rad]."""

STEPS = 4
"""Largest number of Gauss-Newton steps; three are enough if the description has masses."""

LEAST = 0.08
"""Smallest offset that is reported [rad]. On recorded arms with right zeros the fit gives up to 0.06."""

SMALL, SMALL_GAIN = 0.02, 0.18
"""The limit that is used instead of `LEAST` [rad], for offsets of more than `SURER` standard deviations, if the mean
logarithm of the RMS residuals decreases by the second number or more. On recorded arms with right zeros it is at most
0.15, with up to 3.6 standard deviations; with all zeros off by 0.03 rad it was 0.24, with 8."""

SURE = 4.5
"""Number of standard deviations by which an offset must differ from zero."""

SURER, SUREST = 5.5, 8.0
"""Two limits in standard deviations that are used if the residual hardly decreases. An offset must differ from zero
by the first, instead of `SURE`; below the second, the finding is only a warning. The offset then depends on the
masses of the description, which may be wrong; a log without offset reached 4.9."""

ALONE = 0.015
"""Decrease of the mean logarithm of the RMS residuals from which the torque alone is enough evidence."""

LOSS = 0.005
"""Largest increase of the mean logarithm of the RMS residuals for offsets that agree better with the masses of the
description."""

USUAL = 0.1
"""Conflict between the joints that noise can cause. A larger conflict is model error; standard deviations are
then enlarged in proportion."""

MASS, SPREAD, INERTIA = 0.3, 0.03, 0.5
"""Standard deviations of the values of the description: relative for mass and first moment, centre of mass [m],
relative for inertia."""

UNSEEN = 1e-10
"""Number that is added to the precision of unit columns. Undetermined values, such as the zero of the last joint
without a prior, then get a huge but finite standard deviation."""

FREE = 1e3
"""Standard deviation of parameters that the description does not have, in SI units."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports offsets of the positions if the model fits the log better with the offsets corrected.

    The offset of a joint whose position jumps several times is a consequence of the jumps.
    """
    joints = [each.joint for each in evidence.jumps]
    jumping = {evidence.robot.joint_names[j] for j in joints if joints.count(j) > 1}
    return [found for found in evidence.explained(CODE) if not any(name in found.channel for name in jumping)]


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by offsets of the positions; `None` if there are no offsets.

    Rows away from reversals are used first: stiction at reversals causes much of the residual of all rows and hides
    offsets of joints that carry little weight. All rows are used next: in slow motion, more rows are needed to find
    an offset.
    """
    moving = away_from_reversals(state)
    judged = [each for each in (moving, state) if each.rows.mask.any()]
    return next((found for each in judged if (found := _explanation(state, each)) is not None), None)


def _explanation(state: LogState, judged: LogState) -> Explanation | None:
    """Explains the misfit by offsets that are significant in the rows of `judged`.

    The result is `None` if there are no such offsets.

    Args:
        state: The log with all rows.
        judged: The log with the rows from which the offsets are estimated.
    """
    offset, deviation, after = offsets_of(judged)
    if not _are_sure(offset, deviation, SMALL).any():
        return None
    gain = judged.fit.cost - after.fit.cost
    deviation = deviation * np.hypot(1.0, after.conflict / USUAL)
    sure = _are_sure(offset, deviation, LEAST)
    if not sure.any() and gain > SMALL_GAIN and (np.abs(offset) > SURER * deviation).any():
        sure = _are_sure(offset, deviation, SMALL)
    known = _known_bodies(state) is not None
    least = float(np.min(np.abs(offset)[sure] / deviation[sure], initial=np.inf))
    if not sure.any() or (gain < ALONE and not (known and least > SURER)):
        return None
    only = np.where(sure, offset, 0.0)
    names = state.model.robot.joint_names
    listed = ", ".join(f"{names[j]} {offset[j]:+.3f} ± {deviation[j]:.3f}" for j in np.flatnonzero(sure))
    corrected = after if judged is state else state.on(state.log.moved(offset))
    where = "" if judged is state else " away from reversals"
    return Explanation(
        CODE,
        max(gain if judged is state else state.fit.cost - corrected.fit.cost, LOSS),
        "error" if gain >= ALONE or least > SUREST else "warning",
        ", ".join(names[j] for j in np.flatnonzero(sure)),
        f"With offsets of {listed} rad added to the positions, the residual{where} is "
        f"{1 - np.exp(-max(gain, 0.0)):.0%} smaller"
        + (f", and the masses agree better with {state.reference}." if known else "."),
        lambda evidence: lines(joint_offset=np.round(_given(evidence, state.rows.n) + only, 3) + 0.0),
        corrected,
    )


def _given(evidence: LogEvidence, n: int) -> Array:
    """Key `joint_offset` of the log format as an array (n,) [rad or m]; zeros if the key is not given."""
    given = evidence.reading.joint_offset
    return np.zeros(n) if given is None else np.asarray(given)


def _are_sure(offset: Array, deviation: Array, least: float) -> NDArray[np.bool_]:
    return (np.abs(offset) > SURE * deviation) & (np.abs(offset) > least)


def offsets_of(state: LogState) -> tuple[Array, Array, LogState]:
    """Estimates offsets (n,) to add to the positions; also returns standard deviations (n,) and the corrected log."""
    n, b = state.rows.n, state.base.count
    precision, expected = _prior(state)
    offset, deviation = np.zeros(n), np.full(n, np.inf)
    now = state
    for _ in range(STEPS):
        weight = 1.0 / (now.fit.sigma**2 * now.fit.autocorrelation)
        values = _posterior(now, weight, precision, expected, np.zeros((0, *now.rows.torque.shape)))[0]
        theta = now.standard(values)
        slopes = now.rigid_slopes(theta, STEP)
        extended, spread = _posterior(now, weight, precision, expected, slopes)
        step, deviation = extended[b:], spread[b:]
        seen = (deviation > 0.0) & (deviation < KNOWN)
        step = np.where(seen, np.clip(step, -LONGEST, LONGEST), 0.0)
        deviation = np.where(seen, deviation, np.inf)
        if not _are_sure(2.0 * (offset + step), deviation, SMALL).any():
            break  # further steps would not make them significant
        moved = state.on(state.log.moved(offset + step))
        if moved.fit.cost > now.fit.cost + LOSS or not step.any():
            break
        offset, now = offset + step, moved
    return offset, deviation, now


def _known_bodies(state: LogState) -> Array | None:
    """Standard parameters (p,) of the description or of the earlier run, from which the prior is computed.

    The result is `None` if the masses of the links are not known.
    """
    without_masses = state.known is not None and (state.known.bodies[:, 0] <= 0.0).any()
    return None if without_masses else state.described


def _prior(state: LogState) -> tuple[Array, Array]:
    """Prior of the base parameters from the description: precision (b, b) and mean (b,).

    Both are zero if the description has no inertias.
    """
    b, model = state.base.count, state.model
    theta = _known_bodies(state)
    if theta is None:
        return np.zeros((b, b)), np.zeros(b)
    deviation = np.full(len(theta), FREE)
    for columns in model.inertial_columns.reshape(-1, 10):
        body = theta[columns]
        deviation[columns[0]] = MASS * body[0]
        deviation[columns[1:4]] = MASS * np.abs(body[1:4]) + SPREAD * body[0]
        shift = SPREAD * (2.0 * float(np.linalg.norm(body[1:4])) + SPREAD * body[0])  # shift of the centre
        deviation[columns[4:]] = INERTIA * np.abs(body[4:]).max() + shift
    if state.known is not None and state.known.loaded is not None:
        own = model.inertial_columns.reshape(-1, 10)[state.known.loaded]
        deviation[own] = np.hypot(deviation[own], state.known.usual_load)
    deviation = np.maximum(deviation, 1e-6)
    spread = state.base.regrouping * deviation
    covariance = spread @ spread.T
    unit = np.sqrt(np.diag(covariance))
    return np.linalg.inv(covariance / np.outer(unit, unit)) / np.outer(unit, unit), state.base.values_of(theta)


def _posterior(
    state: LogState, weight: Array, precision: Array, expected: Array, extra: Array
) -> tuple[Array, Array]:
    """Posterior means and standard deviations of base parameters and of the coefficients of extra columns.

    Args:
        state: The log.
        weight: Weight of the rows of each joint, shape (n,).
        precision: Precision of the prior of the base parameters, shape (b, b).
        expected: Mean of the prior, shape (b,).
        extra: Extra columns, shape (e, M, n).
    """
    rows, b, extras = state.rows, state.base.count, len(extra)
    H, side = np.zeros((b + extras, b + extras)), np.zeros(b + extras)
    H[:b, :b], side[:b] = precision, precision @ expected
    for j, P in enumerate(products(rows, extra=extra)):
        indices = np.concatenate([rows.parameters[j], np.arange(b, b + extras)])
        H[np.ix_(indices, indices)] += weight[j] * P[:-1, :-1]
        side[indices] += weight[j] * P[:-1, -1]
    unit = np.sqrt(np.diag(H))
    unit = np.where(unit > 0.0, unit, 1.0)
    inverse = np.linalg.inv(H / np.outer(unit, unit) + UNSEEN * np.eye(b + extras)) / np.outer(unit, unit)
    return inverse @ side, np.sqrt(np.maximum(np.diag(inverse), 0.0))


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "position-offset": "Gravity torques are fitted at wrong poses, so first moments and inertias are biased.",
    },
    explain=explain,
)

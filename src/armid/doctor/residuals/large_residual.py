"""Joints whose residual is larger than what models of sound arms leave, and what these residuals follow.

What a model of links and simple friction leaves on a sound arm is a part of the friction, and a few percent of the
torque. A joint with a larger residual has a fault, also if no other check knows it. Its residual is then compared
with functions of all that the log contains: torques of other joints, and the products of {1, friction, torque} with
functions of the joint's angle, its velocity and the time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.alternatives import weights_by_axis
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.remedy_trial import HELPS, RemedyTrial, try_remedy
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.residuals.residual_causes import ResidualCause, causes_of
from armid.errors import Finding

CODE = "residual-large"
"""Code of the findings on residuals that follow nothing that is tried."""

USUAL = (0.75, 0.06)
"""Largest usual residual of a joint that carries weight, as shares of the RMS friction and of the standard deviation
of the torque. On recordings of eight arms it is at most 0.88 of their sum, in halves of them 0.9."""

USUAL_UNLOADED = (1.4, 0.08)
"""The shares that are used instead for a joint that carries no weight, such as a vertical first joint: on two
recorded arms, friction that no law describes is larger there than the friction of the model."""

LOADED = 0.1
"""Ratio of the weights at a joint to its torque, both standard deviations, from which the joint carries weight."""

NOISE = 3.0
"""Smallest ratio of the residual to the noise of the torque in the band of the log."""

COMMON = 3
"""Number of joints with a large residual from which the cause is one of the whole log, and no cause is sought in the
single joints: in half of such logs, one was found that was wrong."""

MEDIAN_OF_NORMAL = 0.6745
"""Median amount of a standard normal number."""

FAINT = 0.3
"""Residual, relative to the largest usual one, from which a cause is sought."""

CLEARLY = 0.01
"""Smallest difference of two decreases of the mean logarithm of the RMS residuals from which the larger one decides
between two faults of one torque."""

FOLLOWS = 0.4
"""Share of the squared residual from which the residual follows functions: share that they explain, minus the share
that as many functions explain of a residual of the same autocorrelation by chance."""


def findings(state: LogState, left_out: NDArray[np.bool_]) -> list[Finding]:
    """Findings on joints whose residual is large or follows a cause, and one for large residuals without a cause.

    Args:
        state: The log, in which all faults that were found are corrected.
        left_out: Mask of the joints that are not examined, shape (n,).
    """
    names, relative = state.model.robot.joint_names, _relative_residuals(state)
    large = (relative > 1.0) & ~left_out
    found: list[Finding] = []
    unknown: list[int] = []
    for j in map(int, np.flatnonzero((relative > FAINT) & ~left_out)):
        best = joint_cause(state, j, float(relative[j]), large=bool(large[j])) if large.sum() < COMMON else None
        if best is not None:
            cause = best.cause
            text = f"{_size(state, j, large=bool(large[j]))} It follows {cause.text}. {best.trial}"
            found.append(Finding(cause.code, cause.severity, names[j], text, cause.remedy))
        elif large[j]:
            unknown.append(j)
    if unknown:
        text = f"{' '.join(_size(state, j) for j in unknown)} No cause was found."
        remedy = "find out what differs between the log and the arm, in the joint, its sensors or the logger"
        found.append(Finding(CODE, "warning", ", ".join(names[j] for j in unknown), text, remedy))
    return found


def _relative_residuals(state: LogState) -> Array:
    """Residual of each joint, relative to the largest one that models of sound arms leave, shape (n,).

    It is zero where the residual is the noise of the torque.
    """
    size, friction, sigma = _deviation(state.rows), _friction(state), state.fit.sigma
    tiny = np.finfo(float).tiny
    relative = sigma / np.maximum(USUAL[0] * friction + USUAL[1] * size, tiny)
    if not (relative > FAINT).any():
        return relative
    weight = np.tensordot(state.model.robot.gravity, weights_by_axis(state), 1)
    loaded = _deviation(replace(state.rows, torque=weight)) > LOADED * size
    unloaded = sigma / np.maximum(USUAL_UNLOADED[0] * friction + USUAL_UNLOADED[1] * size, tiny)
    return np.where(sigma > NOISE * _noise(state), np.where(loaded, relative, unloaded), 0.0)


def _size(state: LogState, j: int, *, large: bool = True) -> str:
    """Sentences on the size of the residual of joint j, and on that of sound arms if it is large."""
    joint, sigma, friction = state.model.robot.joints[j], float(state.fit.sigma[j]), float(_friction(state)[j])
    unit = joint.effort_unit
    share = sigma / max(float(_deviation(state.rows)[j]), np.finfo(float).tiny)
    return (
        f"The RMS residual of {state.model.robot.joint_names[j]} is {sigma:.3g} {unit}, {share:.0%} of "
        f"the standard deviation of its torque, and the RMS friction of the model {friction:.3g} {unit}. "
        + ("On sound arms the residual is smaller." if large else "")
    ).rstrip()


def _deviation(rows: QuickRows) -> Array:
    """Standard deviation of the torque of each joint, shape (n,)."""
    used = zip(rows.torque.T, rows.mask.T, strict=True)
    return np.array([float(np.std(torque[mask])) if mask.any() else 0.0 for torque, mask in used])


def _noise(state: LogState) -> Array:
    """Standard deviation of the white noise of each torque in the band of the log, shape (n,)."""
    run = max(state.log.runs, key=lambda each: each.motion.samples)
    second = np.abs(np.diff(run.torque, n=2, axis=0))
    whole = np.median(second, axis=0) / (MEDIAN_OF_NORMAL * np.sqrt(6.0))
    return np.asarray(whole * np.sqrt(min(1.0, 2.0 * state.log.cutoff / run.rate)))


def _friction(state: LogState) -> Array:
    """RMS friction of each joint in the model, shape (n,)."""
    rows, result = state.rows, np.zeros(state.rows.n)
    for j, own in enumerate(rows.parameters):
        part = np.array([symbol in ("FV", "FS") for symbol in state.symbols(j)])
        torque = state.fit.values[own[part]] @ rows.columns[j][part]
        result[j] = np.sqrt(np.mean(torque[rows.mask[:, j]] ** 2)) if rows.mask[:, j].any() else 0.0
    return result


@dataclass(frozen=True, slots=True, eq=False)
class JointCause:
    """Cause that explains most of the residual of a joint.

    Attributes:
        joint: Index of the joint.
        cause: The cause.
        share: Share of the squared residual that it explains beyond chance.
        gain: Decrease of the mean logarithm of the RMS residuals.
        torque: Torque of the cause, shape (M,) [N·m or N].
        trial: Errors on left-out motion without and with the cause.
    """

    joint: int
    cause: ResidualCause
    share: float
    gain: float
    torque: Array
    trial: RemedyTrial


def joint_cause(state: LogState, j: int, relative: float, *, large: bool) -> JointCause | None:
    """Cause that explains most of the residual of joint j and lowers the error on left-out motion, if there is one.

    Args:
        state: The log.
        j: Index of the joint.
        relative: Residual of the joint, relative to the largest usual one.
        large: False if the cause must explain as much as its `least` says.
    """
    added, rows = AddedColumns(state), state.rows
    chance = float(state.fit.autocorrelation[j]) / max(int(rows.mask[:, j].sum()), 1)
    causes = list(causes_of(state, j))
    price = np.array([len(each.columns) * chance + each.price for each in causes])
    score = added.decreases_of_laws(j, [each.columns for each in causes]) - price
    best, share = causes[int(np.argmax(score))], float(score.max())
    if share < FOLLOWS or not (large or np.sqrt(share) * relative > best.least):
        return None
    columns, parameters = list(rows.columns), list(rows.parameters)
    more = np.arange(rows.count, rows.count + len(best.columns), dtype=np.int32)
    columns[j], parameters[j] = np.vstack([columns[j], best.columns]), np.append(parameters[j], more)
    after = replace(rows, columns=tuple(columns), parameters=tuple(parameters), count=rows.count + len(more))
    trial = try_remedy(rows, after)
    if not trial.helps:
        return None
    fit = solve(after)
    lost = 0.5 * len(more) * chance / rows.n
    torque = fit.values[rows.count :] @ best.columns
    return JointCause(j, best, share, state.fit.cost - fit.cost - lost, torque, trial)


def rival(state: LogState, j: int, gain: float) -> Explanation | None:
    """Explains the misfit by a cause in the torque of joint j that lowers the residuals more than another fault.

    Args:
        state: The log.
        j: Index of the joint.
        gain: Decrease of the mean logarithm of the RMS residuals by the other fault of this torque.
    """
    if state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    found = joint_cause(state, j, float(_relative_residuals(state)[j]), large=True)
    if found is None or found.gain < gain + CLEARLY:
        return None
    name, cause = state.model.robot.joint_names[j], found.cause
    change = np.zeros_like(state.rows.torque)
    change[:, j] = found.torque
    return Explanation(
        cause.code,
        found.gain,
        cause.severity,
        name,
        f"{_size(state, j, large=False)} It follows {cause.text}; with this, the residual is "
        f"{1.0 - np.exp(-found.gain * state.rows.n):.0%} smaller.",
        lambda evidence: cause.remedy,
        state.without_torque(change),
        worse=HELPS,
        trial=found.trial,
    )

"""Check for a delay of the logged torque against the logged positions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import WIDTH, Explanation, LogEvidence
from armid.doctor.downsample import CUTOFFS, DownsampledLog, downsample
from armid.doctor.fitted_log import LogState
from armid.doctor.held_torque import held_by_controller, with_repeated_torque
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import HELPS, try_remedy
from armid.doctor.residuals.delay_of_all_torques import (
    delay_of,
    delay_of_each_joint,
    slopes_of,
    with_torque_advanced,
)
from armid.doctor.rows_away_from_reversals import away_from_reversals
from armid.doctor.stuck_channels import without_stuck
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Stribeck

CODE = "channel-delay"

GAIN = 0.06
"""Smallest decrease of the mean logarithm of the RMS residuals for which a delay is accepted. On most arms, a true
delay of 10 ms gives 0.3 or more; on a servo arm with encoders of 4096 counts, 8 ms give 0.07. On recorded arms,
friction that resembles a delay gives up to 0.04, and more only if it is not significant or not the same in a wider
band."""

AGREED_GAIN = 0.03
"""The limit that is used instead of `GAIN` if the torque without dry friction has the same delay with equal
significance. Stiction looks like a delay of the whole torque, but not like a delay of the torque by gravity and
inertia."""

HINT, AGREED_HINT = 0.03, 0.015
"""Smallest decrease of the mean logarithm of the RMS residuals, with the time derivative of the torque as an extra
column, for which a delay is searched. It is at least half of the decrease that the delay itself gives."""

SHARE = 0.98
"""Smallest ratio of two decreases of the mean logarithm of the RMS residuals: with one delay for all joints, and with
a separate lag of the friction of each joint. If friction only resembles a delay, the ratio is below 0.97 (recorded
arms: two thirds; a light arm with presliding: 0.96). For a true delay of 10 ms it is 1, even in slow motion where
friction dominates."""

SURE_OF_ERROR = 3.0
"""Number of stated standard deviations of a delay from which it is an error; below, it is a warning."""

SURE = 6.0
"""Number of standard deviations by which a delay must differ from zero."""

SHARP = 15.0
"""Highest cut-off with which a detected delay is measured on all rows [Hz]. If friction reverses with the velocity,
reversals determine the delay better in a wider band, up to frequencies where noise of the positions dominates."""

NOISY = 0.05
"""Largest ratio of noise to acceleration in the wider band. Noise hides a share of the inertial torque, the square of
this ratio; viscous friction then seems to lead the velocity. On a light arm with rotors that are heavier than its
links, the lead seemed to be 0.2 ms at this ratio, 0.7 ms at 0.1 and 7 ms at 0.25."""

SAME = 0.5
"""Largest relative difference of the delays measured in the two bands. True delays differ by some percent, effects of
friction by a factor of three to five (closed loop, light arms)."""

APART = 2.5
"""Smallest ratio of the cut-offs of the bands in which a delay on all rows must be the same."""

SHARP_LEAST, SHARP_GAIN = 0.03, 0.1
"""Shortest delay [s] from the wider band that is reported although the narrower band shows another one, and smallest
decrease of the mean logarithm of the RMS residuals that it must give in the narrower band, on all rows and away from
reversals. On a recorded arm with friction that looks like a delay of 0.11 s in a band of 2 Hz, the delay in the wider
band was 0.000 ± 0.005 s, and 0.080 ± 0.011 s with all torques 0.08 s late."""

RISE = 0.1
"""Stribeck velocity of the model in the wider band [rad/s]. Without a Stribeck term, the increase of friction near
rest could look like a delay."""

LEAST = 2e-4
"""Shortest delay that is reported [s], if it is significant and explains as much of the residual as a longer one. A
controller at 500 Hz that logs the torque that it holds for 2 ms has a lead of 1 ms, which makes intervals too narrow
where the torque has little noise."""

SHORT = 1.5e-3
"""Longest delay that is a warning and not an error [s]: half a step of the usual controllers."""

AGREE, CONTRADICT = 2.0, 3.0
"""Two limits for the difference between the delay from all rows and the delay from rows away from reversals, in
standard deviations of the latter. Up to the first, the delay is measured on all rows; from the second, a delay that
is significant only on all rows is rejected."""

UNSURE = "s, if the positions of no single joint are late"
"""Comment behind the line `delay` of the remedy, if torques of single joints contradict the delay."""

OTHERWISE, DOUBT = 0.5, 4.0
"""Smallest decrease of the delay for the torque of one joint, as a share of the delay of all torques and in standard
deviations, for which the latter is called doubtful."""

DIGITS = 5
"""Decimals of a reported delay in seconds: a twentieth of a sample at 5 kHz."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a delay of the torque, and its cause if the log shows the cause."""
    return [with_repeated_torque(each, evidence) for each in _measured(evidence)]


def _measured(evidence: LogEvidence) -> list[Finding]:
    """Reports a delay that explains the misfit; a delay that is the strongest fault is measured in a wider band."""
    found = evidence.explained(CODE)
    sharp = _in_wider_band(evidence) if found and evidence.explanations[0].code == CODE else None
    if sharp is None or evidence.state is None:
        return found
    (delay, deviation, after), (moving, spread) = delay_of(sharp), _away_from_reversals_alone(evidence.state)
    if abs(delay - moving) > AGREE * spread:
        other = _by_wider_band(evidence.state, sharp) if abs(delay - moving) >= SAME * abs(moving) else None
        if other is None:
            return found
        delay, deviation, after = other
    else:
        deviation = _with_difference(deviation, delay - moving, spread)
    first = evidence.explanations[0]
    doubt = _doubt(after, delay)
    text = f"{_delay_text(delay, deviation, first.gain, sharp.log.rate)}{doubt} {evidence.trial_of(first)}"
    remedy = lines(UNSURE if doubt else "s", delay=_total_delay(evidence, delay)).marked()
    return [replace(each, severity=_severity(delay, deviation), evidence=text, remedy=remedy) for each in found]


def _by_wider_band(state: LogState, sharp: LogState) -> tuple[float, float, LogState] | None:
    """Delay in the wider band, its standard deviation [s] and the corrected log, where the narrower band contradicts.

    The result is `None` if the delay is short, not significant, or of no use in the narrower band.
    """
    moving = away_from_reversals(sharp)
    if not moving.rows.mask.any():
        return None
    delay, deviation, after = delay_of(moving)
    if abs(delay) < max(SHARP_LEAST, SURE * deviation):
        return None
    for judged in (state, away_from_reversals(state)):
        if judged.fit.cost - with_torque_advanced(judged, delay).fit.cost < SHARP_GAIN:
            return None
    return delay, deviation, after


def _in_wider_band(evidence: LogEvidence) -> LogState | None:
    """The log with a higher cut-off, and a model with a Stribeck term; `None` if the log is too short."""
    assert evidence.state is not None  # it was compared with a model
    return _in_band(evidence, _wider_cutoff(evidence.state.log))


def _in_band(evidence: LogEvidence, cutoff: float) -> LogState | None:
    """The log with a given cut-off [Hz], and a model with a Stribeck term; `None` if the log is too short."""
    state, recording = evidence.state, evidence.recording
    assert state is not None and recording is not None  # it was compared with a model
    log = downsample(without_stuck(recording, evidence.stuck), cutoff)
    if not log.runs:
        return None
    names = {term.name for term in state.model.terms}
    added = () if Stribeck.name in names else (Stribeck(velocity=RISE, width=WIDTH),)
    model = DynamicsModel(state.model.robot, state.model.terms + added)
    return LogState(model, find_base_parameters(model), log)


def _wider_cutoff(log: DownsampledLog) -> float:
    """Highest cut-off [Hz] with which noise of the positions is small against the accelerations of most joints."""
    acceleration = np.sqrt(np.mean(np.concatenate([run.motion.ddq for run in log.runs]) ** 2, axis=0))
    share = NOISY * acceleration / np.maximum(log.noise, np.finfo(float).eps)
    # White noise of the positions causes a variance of the accelerations of 2 noise² / rate (2 pi)⁴ f⁵ / 5 below f.
    highest = 2.5 * log.rate * float(np.median(share)) ** 2 / (2.0 * np.pi) ** 4
    return max(log.cutoff, min(SHARP, highest**0.2))


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a delay of the torque; `None` if there is no significant delay."""
    if state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    return _explained_by(state, away_from_reversals(state)) or _explained_by(state, state)


def _explained_by(state: LogState, judged: LogState) -> Explanation | None:
    """Explains the misfit by a delay that is significant in the rows of `judged`; `None` if there is no delay."""
    cost, whole = judged.fit.cost, judged is state
    hint = cost - solve(judged.rows, extra=judged.torque_slope()[None]).cost
    if hint < (HINT if whole else AGREED_HINT):
        return None
    delay, deviation, after = delay_of(judged)
    gain = cost - after.fit.cost
    if gain < AGREED_GAIN or abs(delay) < max(LEAST, SURE * deviation):
        return None
    applied = delay
    rest, spread = _delay_without_friction(after)
    agrees = not whole and abs(rest) < AGREE * spread and abs(delay + rest) > SURE * spread
    imitated = not whole and abs(delay + rest) < SURE_OF_ERROR * spread
    if not agrees and (imitated or gain < GAIN or hint < HINT):
        return None
    if gain < SHARE * (cost - _friction_alone(judged)):
        return None
    if whole:
        moving, spread = _away_from_reversals_alone(state)
        if abs(delay - moving) > CONTRADICT * spread:
            return None
        applied, deviation = _with_reversals(delay, deviation, moving, spread)
    else:
        deviation = float(np.hypot(deviation, rest / 2.0))
    doubt = _doubt(after, delay)
    return Explanation(
        CODE,
        gain,
        _severity(applied, deviation),
        "effort",
        _delay_text(applied, deviation, gain, state.log.rate) + doubt,
        lambda evidence: lines(UNSURE if doubt else "s", delay=_total_delay(evidence, applied)),
        with_torque_advanced(state, applied),
        lambda evidence: _is_in_every_band(evidence, delay, whole),
        worse=HELPS,
        trial=None if whole else try_remedy(judged.rows, after.rows),
    )


def _with_reversals(delay: float, deviation: float, moving: float, spread: float) -> tuple[float, float]:
    """Combines the delays from all rows and from rows away from reversals: delay and standard deviation [s].

    If the delay from all rows (`delay`) and that from rows away from reversals (`moving`) differ by more than the
    standard deviation of the latter (`spread`), the cause is probably stiction. The difference then counts as the
    error of `delay`. The result is the mean of the two delays, weighted with the inverse squares of their errors.
    """
    error = abs(delay - moving)
    if error <= spread:
        return delay, _with_difference(deviation, error, spread)
    share = spread**2 / (spread**2 + error**2)
    return share * delay + (1.0 - share) * moving, error * spread / float(np.hypot(error, spread))


def _severity(delay: float, deviation: float) -> Literal["error", "warning"]:
    """Severity of a delay: a warning if the delay is uncertain or short, otherwise an error."""
    return "error" if abs(delay) > max(SHORT, SURE_OF_ERROR * deviation) else "warning"


def _delay_without_friction(after: LogState) -> tuple[float, float]:
    """Remaining delay of the torque without dry friction in a corrected log, and its standard deviation [s].

    A separate delay of the dry friction of each joint is estimated at the same time.
    """
    rows = after.rows
    lags, friction = _friction_lags(after)
    rest = slopes_of(rows, rows.torque - after.fit.residual - friction)
    fit = solve(rows, extra=np.concatenate([rest[None], lags]))
    return -float(fit.values[rows.count]), float(fit.deviation[rows.count])


def _away_from_reversals_alone(state: LogState) -> tuple[float, float]:
    """Delay of the torque in rows away from reversals, and its standard deviation [s]: infinite with too few rows."""
    moving = away_from_reversals(state)
    return delay_of(moving)[:2] if moving.rows.mask.any() else (0.0, np.inf)


def _with_difference(deviation: float, difference: float, spread: float) -> float:
    """Standard deviation [s] of a delay measured on all rows, with the possible error by friction at reversals."""
    return float(np.hypot(deviation, difference)) if np.isfinite(spread) else deviation


def _is_in_every_band(evidence: LogEvidence, delay: float, whole: bool) -> bool:
    """True if the delay is the same in a wider band; an apparent delay by presliding friction depends on the band.

    If the noise of the positions does not allow a much wider band, the delay in a narrower band is compared, too.
    """
    sharp = _in_wider_band(evidence)
    if sharp is None:
        return True
    wide = delay_of(sharp if whole else away_from_reversals(sharp))[0]
    assert evidence.state is not None
    if abs(wide - delay) >= SAME * abs(delay):
        return _by_wider_band(evidence.state, sharp) is not None
    cutoff = max(sharp.log.cutoff / APART, CUTOFFS[0])
    narrow = _in_band(evidence, cutoff) if whole and cutoff < evidence.state.log.cutoff else None
    return narrow is None or abs(wide - delay_of(narrow)[0]) < SAME * abs(delay)


def _delay_text(delay: float, deviation: float, gain: float, rate: float) -> str:
    """Sentence that states a delay, its standard deviation and the decrease of the residual without it."""
    word = "lags behind" if delay > 0 else "runs ahead of"
    return (
        f"The torque {word} the positions by {1e3 * abs(delay):.2f} ± {1e3 * deviation:.2f} ms "
        f"({abs(delay) * rate:.2g} samples); with the delay removed, the residual is {1 - np.exp(-gain):.0%} smaller."
        + held_by_controller(delay * rate)
    )


def _total_delay(evidence: LogEvidence, delay: float) -> float | list[float]:
    """Value of the key `delay` [s]: found delay plus delay of the log format, as a list if joints differ."""
    whole = [round(float(d) + delay, DIGITS) for d in np.asarray(evidence.reading.delay)]
    return whole[0] if len(set(whole)) == 1 else whole


def _doubt(after: LogState, delay: float) -> str:
    """Sentence on joints whose torque contradicts a common delay of all torques; empty if there are no such joints.

    Args:
        after: The log with the delay removed.
        delay: The delay that was removed [s].
    """
    rest, deviation = delay_of_each_joint(after)
    less = -np.sign(delay) * rest  # the torque of a joint beside a late position has no delay
    doubtful = np.flatnonzero((less > np.maximum(OTHERWISE * abs(delay), DOUBT * deviation)) & (deviation > 0.0))
    each = [f"{after.model.robot.joint_names[j]} {1e3 * (delay + rest[j]):.1f} ms" for j in doubtful]
    text = (
        f" The torques of some joints contradict this delay (lag of {', '.join(each)}): other positions may be "
        "late instead."
    )
    return text if each else ""


def _friction_alone(state: LogState) -> float:
    """Mean logarithm of the RMS residuals of a model in which the dry friction of each joint has a separate delay.

    Stiction and backlash delay the torque of friction, but not gravity and inertial torques; a delay of the log
    delays all of them.
    """
    return solve(state.rows, extra=_friction_lags(state)[0]).cost


def _friction_lags(state: LogState) -> tuple[Array, Array]:
    """Time derivative of unit dry friction of each joint, (n, M, n) [1/s], and fitted dry friction, (M, n) [N·m]."""
    rows, values = state.rows, state.fit.values
    lags, friction = np.zeros((rows.n, *rows.torque.shape)), np.zeros_like(rows.torque)
    for j in range(rows.n):
        own = zip(state.symbols(j), rows.columns[j], rows.parameters[j], strict=True)
        for symbol, column, parameter in own:
            if symbol == "FS":
                lags[j, :, j] = slopes_of(rows, column)
                friction[:, j] += values[parameter] * column
    return lags, friction


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "channel-delay": "Torque and motion belong to different times, so inertia is confused with viscous friction.",
    },
    explain=explain,
)

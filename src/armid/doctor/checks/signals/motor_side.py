"""Check whether motor torque, motor current or torque in another unit is logged instead of joint torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import try_remedy
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy

MOTOR, CURRENT, UNIT = "motor-side", "current-without-gain", "torque-unit"

SMALL = 0.3
"""Share of the described torque below which the effort is not the torque of the joints. Descriptions differ from the
arms by up to a factor of 2."""

MOTOR_SCALE = 0.04
"""Share of the described torque below which the effort is a motor torque, with a gear ratio of 25 or more. The share
of a motor current is larger: drives of arms give 5 to 20 N·m at the joint per ampere."""

LARGE = 4.0
"""Multiple of the described torque from which the effort is in another unit. On eight recorded arms, the loaded
joints have 0.7 to 2.3 times the described torque; the median over the joints is 0.8 to 1.5 times."""

BEYOND_LIMIT = 2.0
"""Largest effort, relative to the effort limit of the description, from which the effort is in another unit, for a
typical joint of a description without masses."""

IMPOSSIBLE = 1.25
"""Largest effort, relative to the effort limit of the description, above which a torque is impossible at the joint
with the largest ratio. Together with an effort of more than `LARGE` times the described torque, it shows another unit
although the masses of the description are placeholders. On eight recorded arms the ratio is below 0.6."""

FIND_UNIT = "find out the unit of the torque, and give `drive_gain`, the newton metres in one unit of the log"

LOWEST_OF_LIMIT = 1 / 500
"""Largest effort, relative to the effort limit of the description, below which the effort is in another unit, for the
joint with the largest ratio. On eight recorded arms this ratio is 0.08 to 0.6."""

LOWEST_SCALE = 1 / 500
"""Share of the described torque below which the effort is in another unit than N·m, because gear ratios of joints are
below 500."""

UNITS = ((0.001, "kN·m"), (10.197, "kgf·cm"), (100.0, "N·cm"), (1000.0, "mN·m"), (1e4, "0.1 mN·m"))
"""Units of torque, each with the number of units in one newton metre."""

NEAR_UNIT = 1.6
"""Largest factor between the effort and the described torque in a unit for which this unit is named."""

AFTER_DEGREES = 1.0
"""Decrease of the mean logarithm of the RMS residuals that is assumed for the correction of a torque that is too
large. The correction is made early, because other results depend on it; but it comes after angles in a wrong unit,
which make the described torque too small and give a larger decrease."""

SAME_MASS = 0.5
"""Share of links with the same mass above which masses count as placeholders, for instance 1 kg for each link."""

ALIKE = 0.85
"""Correlation of the torque of a joint with the description from which the scale of the joint is known."""

MOST_OF = 0.5
"""Share of the loaded joints whose scale must be known. If channels are in a wrong order, a single joint may
correlate by chance."""

HEAVY = 0.05
"""Share of the described torque of the most loaded joint below which a joint counts as not loaded."""

DESCRIBED = 0.2
"""Relative standard deviation of a scale from the description if the torque has the right shape, because of errors of
the masses in the description."""

UNSEEN = 0.7
"""Relative standard deviation of the scale of a joint with little gravity torque. This scale is taken from the other
joints; drives of one arm differ by a factor of two or three."""

APART = 0.1
"""Decrease of the conflict between the joints from which each joint gets a separate factor. On simulated logs with
one factor for all joints it was below 0.01; with factors that differ by half it was up to 1.0."""

MOTOR_NOTE = (
    "gear ratios estimated from the gravity torque of {reference}; positions are joint positions; use the "
    "maker's values"
)
ESTIMATE = (
    "relative deviations; estimated from this recording and the masses of {reference}, so give the same gains "
    "to all recordings of the arm; if the gains are known, use the maker's values"
)
CURRENT_NOTE = f"gains in N·m/A, {ESTIMATE}"
UNIT_NOTE = "N·m per unit of the log"
ESTIMATED_NOTE = f"gains in {UNIT_NOTE}, {ESTIMATE}"

COVERED = 4.0
"""Number of stated deviations up to which a gain agrees with the description."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports recorded efforts that are not joint torques in N·m or N: motor torques, currents, or another unit."""
    found = [finding for code in (MOTOR, CURRENT, UNIT) for finding in evidence.explained(code)]
    return [_declared(finding) if _covers(evidence, finding) else finding for finding in found]


def _covers(evidence: LogEvidence, finding: Finding) -> bool:
    """True if proposed drive gains agree with the gains of the log format, within the deviations stated there."""
    given, stated = evidence.reading.drive_gain, evidence.reading.drive_gain_deviation
    of_run = evidence.known is not None and evidence.known.of_run  # with the same gains
    if given is None or stated is None or of_run:
        return False
    ratio = np.asarray(Remedy.read(finding.remedy).keys["drive_gain"]) / np.asarray(given)
    size = np.maximum(np.abs(ratio - 1.0), np.abs(1.0 / ratio - 1.0))
    return bool((size <= COVERED * np.asarray(stated)).all())


def _declared(finding: Finding) -> Finding:
    """The finding as a warning, for a user who stated the deviation of the gains and so has not forgotten them."""
    evidence = (
        f"{finding.evidence} This is possible with the stated deviation of the drive gains, so it is not an error; "
        "the intervals are as wide as the deviation."
    )
    return replace(finding, severity="warning", evidence=evidence)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit by a wrong scale of the effort; `None` if the scale agrees with the description."""
    nominal = state.nominal
    if nominal is None:
        return _beyond_limits(state)
    known = (np.abs(nominal.correlation) > ALIKE) & (nominal.size > HEAVY * nominal.size.max())
    heavy = nominal.size > HEAVY * nominal.size.max()
    if known.sum() < MOST_OF * heavy.sum():
        return None
    typical = float(median(np.abs(nominal.scale[known])))
    if LOWEST_SCALE <= typical < SMALL:
        return _small_share(state, known, typical)
    if typical > LARGE or 0.0 < typical < SMALL:
        if has_placeholder_masses(state) and not (typical > LARGE and _largest_share(state) > IMPOSSIBLE):
            return _beyond_limits(state)
        return _other_unit(state, known, typical)
    return None


def _largest_share(state: LogState) -> float:
    """Largest effort relative to the effort limit of the description, for the joint with the largest ratio."""
    return float(_shares(state).max(initial=0.0))


def _shares(state: LogState) -> Array:
    """Largest effort of each joint relative to its effort limit, for the joints that have one."""
    limits = np.array([joint.effort_limit for joint in state.model.robot.joints])
    known = (limits > 0.0) & np.isfinite(limits) & state.rows.mask.any(axis=0)
    largest = np.array(
        [np.abs(x[m]).max(initial=0.0) for x, m in zip(state.rows.torque.T, state.rows.mask.T, strict=True)]
    )
    return largest[known] / limits[known]


def _beyond_limits(state: LogState) -> Explanation | None:
    """Explains the misfit by a wrong unit if the effort does not fit the described limits; `None` if it fits.

    It is used for descriptions without masses. Units are possible with which a typical joint neither exceeds its
    limit nor stays far below it.
    """
    shares = _shares(state)
    if len(shares) < MOST_OF * state.rows.n:
        return None
    typical = float(median(shares))
    if typical < BEYOND_LIMIT and shares.max() > LOWEST_OF_LIMIT:
        return None
    fitting = [unit for unit in UNITS if LOWEST_OF_LIMIT < typical / unit[0] < 1.0]
    if not fitting:
        return None
    gains = np.full(state.rows.n, 1.0 / fitting[0][0])
    return Explanation(
        UNIT,
        AFTER_DEGREES,
        "error",
        "effort",
        f"The largest effort is {typical:.3g} times the effort limit of the description (median of the joints). It "
        f"is probably in {' or '.join(name for _, name in fitting)}, unless the limits are wrong.",
        lambda evidence: _gains(evidence, gains.tolist(), UNIT_NOTE) if len(fitting) == 1 else FIND_UNIT,
        state.with_torque(gains),
    )


def _small_share(state: LogState, known: NDArray[np.bool_], typical: float) -> Explanation:
    """Explains the misfit by motor torques or currents, if the effort is a small share of the described torque.

    Each joint gets the factor that follows from the description. If the held-out error then increases, all joints get
    the same factor: errors of the described masses may be larger than the differences of the factors.

    Args:
        state: The log.
        known: Joints whose scale is known, shape (n,).
        typical: Ratio of the effort to the described torque, median over these joints.
    """
    nominal = state.nominal
    assert nominal is not None
    own = np.where(known, np.abs(nominal.scale), typical)
    deviations = _deviations(nominal.correlation, known)
    scale, after = own, state.with_torque(1.0 / own)
    if try_remedy(state.rows, after.rows).harms:
        scale = np.full(state.rows.n, typical)
        after = state.with_torque(1.0 / scale)
        deviations = [float(f"{each:.2g}") for each in np.hypot(deviations, np.log(own / typical))]
    names = state.model.robot.joint_names
    listed = ", ".join(f"{names[j]} 1/{1 / abs(nominal.scale[j]):.3g}" for j in np.flatnonzero(known))
    motor = typical < MOTOR_SCALE
    note = (MOTOR_NOTE if motor else CURRENT_NOTE).format(reference=state.reference)
    gains = [float(f"{1 / s:.3g}") for s in scale]
    return Explanation(
        MOTOR if motor else CURRENT,
        10.0,  # corrected first, since all other numbers depend on the unit
        "error",
        "effort",
        f"The effort has the shape of the torque of {state.reference}, but is only a small share of this torque: "
        f"{listed}.",
        lambda evidence: _gains(evidence, gains, note, deviations),
        after,
    )


def _other_unit(state: LogState, known: NDArray[np.bool_], typical: float) -> Explanation:
    """Explains the misfit by a wrong unit, if the effort is a multiple or a tiny share of the described torque.

    If the ratio of effort to described torque is about the factor of a unit, all joints get this factor. Otherwise
    the factor is estimated, and all joints get the same one unless the joints contradict each other. An estimated
    factor is only as accurate as the masses in the description; therefore the gains get standard deviations, as for
    currents.

    Args:
        state: The log.
        known: Joints whose scale is known, shape (n,).
        typical: Ratio of the effort to the described torque, median over these joints.
    """
    nominal = state.nominal
    assert nominal is not None
    names = state.model.robot.joint_names
    loaded = int(np.argmax(nominal.size))
    what = (
        f"The effort has the shape of the torque of {state.reference}, but is {typical:.3g} times as large (median "
        f"of the joints; {names[loaded]}: {nominal.scale[loaded]:.3g})."
    )
    unit = next((u for u in UNITS if 1.0 / NEAR_UNIT < typical / u[0] < NEAR_UNIT), None)
    masses = f"the masses of {state.reference} are too {'small' if typical > 1.0 else 'large'}"
    if unit is not None:
        gains, note, deviations = np.full(state.rows.n, 1.0 / unit[0]), UNIT_NOTE, None
        what += f" It is probably in {unit[1]}, unless {masses}."
    else:
        gains = np.full(state.rows.n, 1.0 / float(f"{typical:.2g}"))
        own = np.where(known, 1.0 / np.abs(np.where(known, nominal.scale, 1.0)), gains)
        apart = state.conflict - state.with_torque(own).conflict > APART
        gains, note = own if apart else gains, ESTIMATED_NOTE.format(reference=state.reference)
        deviations = _deviations(nominal.correlation, known)
        what += (
            " The factor fits no usual unit of torque: the effort may be in raw units of the drive, a motor current, "
            f"or scaled by a wrong gain, or {masses}."
        )
        if apart:
            what += " The joints have different factors."
    return Explanation(
        UNIT,
        AFTER_DEGREES,
        "error",
        "effort",
        what,
        lambda evidence: _gains(evidence, gains.tolist(), note, deviations),
        state.with_torque(gains),
    )


def has_placeholder_masses(state: LogState) -> bool:
    """True if the masses of the description are placeholders, so that the described torque has no known scale."""
    theta = state.described
    if theta is None:
        return True
    masses = theta[state.model.inertial_columns].reshape(-1, 10)[:, 0]
    masses = masses[masses > 0.0]
    if len(masses) < 2:
        return False
    return bool(np.unique(masses, return_counts=True)[1].max() > SAME_MASS * len(masses))


def _deviations(correlation: Array, known: NDArray[np.bool_]) -> list[float]:
    """Relative standard deviations (n,) of scales that are computed with the torque of the description.

    Args:
        correlation: Correlation of measured and described torque, shape (n,); the deviation grows as it falls.
        known: Joints whose scale is known, shape (n,).
    """
    shape = np.sqrt(1.0 / np.where(known, correlation, 1.0) ** 2 - 1.0)
    return [float(f"{each:.2g}") for each in np.where(known, np.hypot(DESCRIBED, shape), UNSEEN)]


def _gains(evidence: LogEvidence, gains: list[float], note: str, deviations: list[float] | None = None) -> str:
    """Lines of a study with corrected drive gains: gains of the log format times ratio of joint torque to effort."""
    given = evidence.reading.drive_gain
    total = np.asarray(gains) * (1.0 if given is None else np.asarray(given))
    given_gains = [float(f"{gain:.3g}") for gain in total]
    if deviations is None:
        return lines(note, drive_gain=given_gains)
    return lines(note, drive_gain=given_gains, drive_gain_deviation=deviations)


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "motor-side": "All parameters are wrong by the gear ratio, or by the counts of the encoders.",
        "current-without-gain": "All parameters are in units of the drive's current.",
        "torque-unit": "All parameters are too large or too small by one factor; a validation in the same unit does "
        "not detect it.",
    },
    explain=explain,
    hides=("saturation", "torque-beyond-limit"),
)

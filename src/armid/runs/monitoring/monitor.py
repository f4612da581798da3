"""Monitor of a run: external torque of recordings, and alarms if it exceeds thresholds.

The thresholds are computed for a given rate of false alarms. The monitor is no safety function: it is not redundant,
not certified, and stops nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.estimation.estimate_record import torque_parameters
from armid.maths.peaks_over_threshold import Tail
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.runs.monitoring.cross_validated_rate import rate_excess, validated_thresholds
from armid.runs.monitoring.motion_comparison import MotionLevel, motion_level, unlike_unseen_motion
from armid.runs.monitoring.observer import SETTLED, Observed, ObserverOptions
from armid.runs.monitoring.thresholds import PROMISED, Thresholds, alarm_rows, find_thresholds, usable_seconds
from armid.runs.monitoring.tip_wrench import TipWrench, tip_wrench
from armid.runs.monitoring.unseen_residuals import (
    UnseenResiduals,
    external_torque_of,
    own_residuals,
    reference_residuals,
)
from armid.runs.run import Run
from armid.study.progress import Progress, no_progress

RATE_RATIO = 1.1
"""Largest ratio between the sample rate of the monitored motion and that of the unseen motion, in both directions.
With other rates, the filters pass another part of the noise."""

WATCHED = 0.9
"""Smallest share of the time in which alarms must be possible on a joint; below it, a finding reports the share."""

NO_SAFETY = (
    "This is no safety function: it is neither certified nor redundant and stops nothing. Do not protect people with "
    "it."
)
"""Warning in every output that a monitor is no safety function."""

LOWEST = 1.0
"""Smallest rate of false alarms that is chosen if the user gives no rate [1/h]."""

SEARCHES = 5
"""Largest number of iterations of the search for the smallest rate of false alarms that can be promised."""

DRY_SPEED = 0.05
"""Speed at which the dry friction of a joint is computed from the model [rad/s or m/s]. It is larger than the usual
width of Coulomb friction, and so small that viscous friction is negligible."""


@dataclass(frozen=True, eq=False, slots=True)
class Monitor:
    """Run with an observer and thresholds.

    Attributes:
        run: The run.
        options: Kind and gain of the observer.
        rate: Sample rate of the unseen motion [Hz], for which the thresholds are valid.
        thresholds: The thresholds.
        tails: Tail of the distribution of each joint's scaled residual; `None` if the unseen motion is too short.
        source: Source of the unseen motion: `reference`, `recordings` or `parts`.
        level: Speed, torque change and reversals of the unseen motion.
        velocity: True if recorded velocities are an input of the observer.
        findings: Findings about the thresholds.
    """

    run: Run
    options: ObserverOptions
    rate: float
    thresholds: Thresholds
    tails: tuple[Tail | None, ...]
    source: str
    level: MotionLevel
    velocity: bool = False
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Alarm:
    """Interval of time in which the external torque of one or several joints exceeded the thresholds.

    Attributes:
        joint: Name of the joint whose torque exceeds its threshold by the largest factor.
        joints: Names of all joints whose torque exceeds the threshold in the interval.
        start: Time of the first exceedance [s].
        duration: Time from the first to the last exceedance [s].
        time: Time of the largest exceedance [s].
        size: External torque of the joint at this time [N·m or N].
        threshold: Threshold of the joint at this time [N·m or N].
        external: External torque of all joints at this time, shape (n,) [N·m or N].
        wrench: Wrench at the tip at this time; `None` if the tip is fixed to the base.
    """

    joint: str
    joints: tuple[str, ...]
    start: float
    duration: float
    time: float
    size: float
    threshold: float
    external: Array
    wrench: TipWrench | None


@dataclass(frozen=True, eq=False, slots=True)
class Watched:
    """External torque and alarms of a recording.

    Attributes:
        parts: External torque along each contiguous part of the recording.
        thresholds: Thresholds along each part, shape (N, n) each [N·m or N].
        alarms: Alarms in the order of time.
        seconds: Total time in which alarms were possible [s].
        findings: Findings about joints and times for which alarms were not possible, and about motion unlike the
            unseen motion.
    """

    parts: tuple[Observed, ...]
    thresholds: tuple[Array, ...]
    alarms: tuple[Alarm, ...]
    seconds: float
    findings: tuple[Finding, ...] = ()


def require_rate(expected: float, rate: float, source: str = "The samples") -> None:
    """Raises an error if a sample rate differs from that of the thresholds by more than the factor `RATE_RATIO`.

    Args:
        expected: Sample rate for which the thresholds are valid [Hz].
        rate: Sample rate [Hz].
        source: Subject of the error message.
    """
    if not 1.0 / RATE_RATIO <= rate / expected <= RATE_RATIO:
        raise ArmidError(
            f"{source} come at {rate:.5g} Hz, but the thresholds are for {expected:.5g} Hz.",
            remedy="give reference recordings at the rate of the samples with --reference.",
        )


def make_monitor(
    run: Run,
    *,
    false_alarms: float | None = None,
    options: ObserverOptions | None = None,
    references: Sequence[Recording] = (),
    data: Path | str | None = None,
    progress: Progress = no_progress,
) -> Monitor:
    """Makes a monitor of a run: observer and thresholds from residuals of unseen motion.

    Args:
        run: The run.
        false_alarms: False alarms per hour, of the whole arm; if not given, the smallest rate that can be promised,
            but not less than one.
        options: Kind and gain of the observer.
        references: Recordings without contact that did not train the run, in the convention of the robot; if none are
            given, the recordings of the run are used.
        data: Folder of the recordings of the run, if they were moved.
        progress: Callback that is called while the rate is cross-validated.

    Raises:
        ArmidError: The rate is not positive, or there is no unseen motion.
    """
    if false_alarms is not None and not 0.0 < false_alarms < np.inf:
        raise ArmidError(
            f"The rate of false alarms must be positive; found {false_alarms:g} per hour.",
            remedy="give for instance --false-alarms 1 for one per hour.",
        )
    options = options or ObserverOptions()
    unseen = reference_residuals(run, options, references) if references else own_residuals(run, options, data)
    parts = tuple(part for part in unseen.parts if part.usable.all(axis=1).any())
    if not parts:
        raise ArmidError(
            "There is no unseen motion from which thresholds can be computed: every part is shorter than the time in "
            "which the observer settles.",
            remedy="give longer recordings of motion without contact with --reference.",
        )
    rate = max(parts, key=lambda part: len(part.time)).rate
    for part in parts:
        require_rate(rate, part.rate, "Samples of a recording of unseen motion")
    friction = dry_friction(run, parts)
    found, tails = find_thresholds(parts, friction, LOWEST if false_alarms is None else false_alarms)
    for _ in range(SEARCHES if false_alarms is None else 0):
        if found.promised or not np.isfinite(found.smallest):
            break
        # Another rate can change which thresholds follow the motion, and so the smallest rate.
        found, tails = find_thresholds(parts, friction, found.smallest * (1.0 + 1e-6))
    excess = rate_excess(parts, friction, found.rate, progress=progress)
    wanted = found.rate * excess if false_alarms is None else false_alarms
    found, tails = validated_thresholds(parts, friction, wanted, excess)
    findings = (*unseen.findings, *_findings(found, unseen, asked=false_alarms))
    velocity = all(part.velocity for part in parts)
    return Monitor(run, options, rate, found, tails, unseen.source, motion_level(parts), velocity, findings)


def dry_friction(run: Run, parts: Sequence[Observed]) -> Array:
    """Dry friction of each joint, shape (n,) [N·m or N]: half the jump of the torque of the model at a reversal.

    Args:
        run: The run.
        parts: External torque along parts of recordings, whose poses are used.
    """
    model, theta = run.model, torque_parameters(run.estimate.base, run.estimate.fit)
    q = np.concatenate([part.q[:: max(1, len(part.q) // 20)] for part in parts])
    jumps = np.empty(model.n)
    for j in range(model.n):
        torques: list[Array] = []
        for sign in (1.0, -1.0):
            dq = np.zeros_like(q)
            dq[:, j] = sign * DRY_SPEED
            motion = Motion.of_states(q, dq, np.zeros_like(q))
            if model.nodes:
                drive = [sum(w * np.sign(dq[:, i]) for i, w in node.coordinate) for node in model.nodes]
                at = [sum(w * q[:, i] for i, w in node.coordinate) for node in model.nodes]
                widths = np.array([node.memory.width for node in model.nodes])
                motion = motion.with_memory(np.column_stack(at) - widths * np.sign(np.column_stack(drive)))
            torques.append(model.torque(motion, theta)[:, j])
        jumps[j] = 0.5 * float(np.abs(torques[0] - torques[1]).max())
    return jumps


def watch(monitor: Monitor, recording: Recording) -> Watched:
    """Computes external torque and alarms along a recording, with the same results as `LiveMonitor`.

    Args:
        monitor: The monitor.
        recording: Recording in the convention of the robot.

    Raises:
        ArmidError: The recording cannot be observed.
    """
    parts = external_torque_of(monitor.run, monitor.options, recording, velocity=monitor.velocity)
    for part in parts:
        require_rate(monitor.rate, part.rate, f"Samples of {recording.source or 'the recording'}")
    where = recording.source or "The recording"
    findings = (
        *_unwatched(monitor, parts, where),
        *unlike_unseen_motion(monitor.level, motion_level(parts), monitor.run.robot.joint_names, where),
    )
    thresholds = tuple(monitor.thresholds.along(part) for part in parts)
    alarms = [
        alarm for part, along in zip(parts, thresholds, strict=True) for alarm in find_alarms(monitor, part, along)
    ]
    return Watched(parts, thresholds, tuple(alarms), usable_seconds(parts), findings)


def _unwatched(monitor: Monitor, parts: Sequence[Observed], where: str) -> tuple[Finding, ...]:
    """Finding about joints on which alarms were not possible during a part of a recording; empty if there are none.

    Raises:
        ArmidError: Alarms were not possible on any joint at any time.
    """
    rows = sum(len(part.time) for part in parts)
    counts = np.sum([part.usable.sum(axis=0) for part in parts], axis=0) if parts else np.zeros(monitor.run.robot.n)
    if not counts.any():
        raise ArmidError(
            f"{where} cannot be watched: after the start and after each gap, the observer settles for {SETTLED:g} s, "
            f"and none of its {len(parts)} parts is longer.",
            remedy="give a recording without gaps that is longer.",
        )
    share = counts / (rows - min(rows - 1, int(SETTLED * monitor.rate)))
    if (share >= WATCHED).all():
        return ()
    listed = ", ".join(
        f"{name} {min(each, 1.0):.0%}"
        for name, each in zip(monitor.run.robot.joint_names, share.tolist(), strict=True)
        if each < WATCHED
    )
    return (
        Finding(
            "partly-watched",
            "warning",
            "",
            f"{where}: because of gaps and invalid samples, alarms were possible in a share of the time: {listed}.",
            "record without gaps; an alarm is not given within a second after one.",
        ),
    )


def find_alarms(monitor: Monitor, part: Observed, thresholds: Array) -> list[Alarm]:
    """Finds the alarms along one contiguous part; exceedances within the time `GAP` are one alarm.

    Args:
        monitor: The monitor.
        part: External torque along the part, N samples.
        thresholds: Thresholds along the part, shape (N, n) [N·m or N].
    """
    ratio = np.where(part.usable, np.abs(part.external) / thresholds, 0.0)
    return [_alarm(monitor, part, thresholds, ratio, rows) for rows in alarm_rows(ratio > 1.0, part.rate)]


def _alarm(monitor: Monitor, part: Observed, thresholds: Array, ratio: Array, rows: NDArray[np.intp]) -> Alarm:
    robot = monitor.run.robot
    inside = ratio[rows]
    over: NDArray[np.bool_] = np.asarray(inside.max(axis=0) > 1.0)
    k, j = np.unravel_index(int(np.argmax(inside)), inside.shape)
    row = int(rows[k])
    names = robot.joint_names
    external = part.external[row]
    wrench = None
    if robot.tip.parent >= 0:
        wrench = tip_wrench(robot, part.q[row], external, monitor.thresholds.covariance)
    return Alarm(
        names[int(j)],
        tuple(name for name, exceeds in zip(names, over.tolist(), strict=True) if exceeds),
        float(part.time[rows[0]]),
        float(part.time[rows[-1]] - part.time[rows[0]]),
        float(part.time[row]),
        float(external[j]),
        float(thresholds[row, j]),
        external,
        wrench,
    )


def _findings(found: Thresholds, unseen: UnseenResiduals, asked: float | None) -> list[Finding]:
    """Findings about the reliability of the thresholds: a rate that cannot be promised, or too few recordings.

    Args:
        found: The thresholds.
        unseen: Residuals from which they were computed.
        asked: Rate of false alarms that the user gave [1/h]; `None` if not given.
    """
    minutes = found.seconds / 60.0
    findings: list[Finding] = []
    if not found.promised:
        least = f"The smallest rate that can be promised is {found.smallest:.3g} per hour."
        if not np.isfinite(found.smallest):
            least = "They are too short to promise any rate."
        what = "Without --false-alarms, " if asked is None else f"{asked:g} false alarms per hour were asked for; "
        findings.append(
            Finding(
                "rate-not-promised",
                "warning",
                "",
                f"{what}the thresholds come from {minutes:.1f} minutes of unseen motion. {least} The thresholds are "
                "extrapolated, and the true rate can be several times as high.",
                "record motion without contact for longer, and give it with --reference; or ask for a higher rate "
                "with --false-alarms.",
            )
        )
    if unseen.recordings < 2:
        kind = "parts of one recording" if unseen.source == "parts" else "one recording"
        findings.append(
            Finding(
                "one-recording",
                "warning",
                "",
                f"The thresholds come from {kind}. They do not contain what changes from one recording to the next, "
                "such as friction, offsets and the motion itself.",
                "give recordings without contact from other days and of the motion of the work with --reference.",
            )
        )
    return findings


__all__ = ["NO_SAFETY", "PROMISED", "Alarm", "Monitor", "Watched", "make_monitor", "watch"]

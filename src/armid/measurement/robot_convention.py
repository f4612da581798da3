"""Conversion of recordings to the robot's convention: its joints, SI units, joint side, signs of the URDF."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding, RecordingError
from armid.measurement.columns.channels import in_joint_order
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.cleaning import clean, recording_error
from armid.measurement.processing.delay import compensate_delay
from armid.measurement.recording import Recording
from armid.measurement.remedy import lines, naming
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["ConvertedRecording", "to_robot_convention", "understood"]

WRAP_TOLERANCE = 0.5
"""Distance from whole turns up to which a jump is a wrap [rad]: what a joint turns from sample to sample,
also over a short gap. Where a channel's typical step is larger than this, jumps tell nothing."""

FAR = 0.5
"""Excess over a joint's limits, relative to their span, that shows more than a loose limit."""


COMMON = ("torque_sign", "position_sign", "delay", "drive_gain_deviation")
"""Fields that may be one number for all joints."""


@dataclass(frozen=True, slots=True)
class ConvertedRecording:
    """Recording in the robot's convention.

    Attributes:
        recording: Joints in the robot's order, SI units, joint side, signs of the URDF.
        findings: What was noticed on the way.
    """

    recording: Recording
    findings: tuple[Finding, ...] = ()


def to_robot_convention(recording: Recording, reading: LogFormat, robot: Robot) -> ConvertedRecording:
    """Converts a recording to the robot's convention.

    Args:
        recording: As a reader gave it.
        reading: How to read it.
        robot: The arm that was recorded.

    Raises:
        RecordingError: Joints that do not match, NaN, a dead channel, no clock and no rate, a clock that runs
            backwards, degrees taken for radians, currents without gains, hardly any samples.
    """
    reading = understood(recording, reading)
    _check_lengths(reading, robot)
    seen = recording.findings
    recording, others = in_joint_order(recording, reading, robot)
    recording, findings = clean(recording, reading)
    standing = _check_channels(recording, reading)
    _check_gains(recording, reading)
    recording, wrapped = _on_joint_side(recording, reading, robot)
    recording = compensate_delay(recording, reading)
    offset = _check_limits(recording, reading, robot)
    return ConvertedRecording(recording, (*seen, *others, *findings, *standing, *wrapped, *offset))


def understood(recording: Recording, reading: LogFormat) -> LogFormat:
    """Log format completed by what the reader has detected."""
    return replace(reading, **recording.guessed) if recording.guessed else reading


def _check_lengths(reading: LogFormat, robot: Robot) -> None:
    for name in (*COMMON, "units", "drive_gain", "transmission", "joint_offset"):
        shape = np.shape(getattr(reading, name))
        fits = shape in ((), (robot.n,), (robot.n, robot.n))
        if not fits and not (shape == (1,) and name in COMMON):
            raise RecordingError(
                f"{name} has {shape[0]} entries; {robot.name} has {robot.n} joints.",
                possible=", ".join(robot.joint_names),
                remedy="give one for each joint, in the robot's order.",
            )


def _check_channels(recording: Recording, reading: LogFormat) -> tuple[Finding, ...]:
    """Raises an error for channels without a signal; reports joints that stand still."""
    still = np.ptp(recording.q, axis=0) == 0
    if still.all():
        raise recording_error(
            "standstill",
            recording,
            f"the arm stands still: every position is constant over {recording.samples} rows.",
            "record while the arm moves, or name the measured positions in columns.",
        )
    for name in ("q", "dq", "ddq", "effort"):
        values = getattr(recording, name)
        if values is None:
            continue
        dead = np.ptp(values, axis=0) == 0
        # A joint held by its brake has a constant position, velocity and acceleration; nought is a wire cut.
        dead &= (values[0] == 0) if name == "q" else ~still if name != "effort" else True
        if dead.any():
            joint = int(np.argmax(dead))
            optional = name in ("dq", "ddq")
            raise recording_error(
                "channel-dead",
                recording,
                f"{name} of {recording.channels[joint]} is {values[0, joint]:g} in all {recording.samples} rows.",
                naming(reading, {name: ""}, "leave it out")
                if optional
                else "record it again, or lock that joint and leave its channel out.",
            )
    return tuple(
        Finding(
            "standstill",
            "warning",
            recording.channels[i],
            f"The joint stays at {recording.q[0, i]:g} throughout; what only its motion shows stays unknown.",
            "record it while it moves, or lock it.",
        )
        for i in np.flatnonzero(still)
    )


def _check_gains(recording: Recording, reading: LogFormat) -> None:
    if reading.drive_gain is not None and recording.effort is None:
        raise RecordingError(
            f"{recording.source}: drive_gain is given, but the recording has no effort.",
            remedy="name the column of the currents under columns, or leave drive_gain out.",
        )
    if recording.effort_is_current and reading.drive_gain is None:
        raise recording_error(
            "current-without-gain",
            recording,
            "the effort is a motor current [A], and no drive gain says how much torque an ampere makes.",
            "find out the drive_gain in N·m/A at the joint, one for each joint, or name a torque in columns.",
        )


def _on_joint_side(recording: Recording, reading: LogFormat, robot: Robot) -> tuple[Recording, tuple[Finding, ...]]:
    """Converts to radians without wrapping, motor to joint side, current to torque, and the URDF's signs."""
    turns = np.array([not joint.is_prismatic for joint in robot.joints])
    sign = np.asarray(reading.position_sign)
    unit = sign * np.where(turns & reading.degrees(robot.n), np.pi / 180, 1.0)
    q, findings = _unwrapped(
        recording.q * unit, turns if recording.consecutive else np.zeros(robot.n, dtype=np.bool_), robot
    )
    gear = np.eye(robot.n) if reading.transmission is None else np.asarray(reading.transmission, dtype=np.float64)
    offset = np.zeros(robot.n) if reading.joint_offset is None else np.asarray(reading.joint_offset)
    gain = np.ones(robot.n) if reading.drive_gain is None else np.asarray(reading.drive_gain)
    to_joint = np.asarray(np.linalg.inv(gear).T, dtype=np.float64)
    valid = recording.valid
    if reading.transmission is not None and not valid.all():
        # A joint counts where every motor does that its position or torque is made from.
        needed = (gear != 0) | (to_joint != 0)
        valid = ~((~valid).astype(np.float64) @ needed.astype(np.float64)).astype(np.bool_)

    def through(values: Array, matrix: Array) -> Array:
        return values if reading.transmission is None else values @ matrix

    def moved(values: Array | None) -> Array | None:
        return None if values is None else through(values * unit, to_joint)

    effort = recording.effort
    return replace(
        recording,
        q=through(q, to_joint) + offset,
        dq=moved(recording.dq),
        ddq=moved(recording.ddq),
        effort=None if effort is None else through(effort * gain, gear) * np.asarray(reading.torque_sign),
        valid=valid,
        effort_is_current=False,
    ), findings


def _unwrapped(q: Array, turns: NDArray[np.bool_], robot: Robot) -> tuple[Array, tuple[Finding, ...]]:
    """Continuous angles, and a mask of those that were wrapped."""
    findings: list[Finding] = []
    q = q.copy()
    for i in np.flatnonzero(turns):
        step = np.diff(q[:, i])
        whole = np.round(step / (2 * np.pi))
        jump = (whole != 0) & (np.abs(step - 2 * np.pi * whole) < WRAP_TOLERANCE)
        if not jump.any() or np.median(np.abs(step)) >= WRAP_TOLERANCE:
            continue
        q[1:, i] -= 2 * np.pi * np.cumsum(np.where(jump, whole, 0.0))
        evidence = f"{jump.sum()} jumps by whole turns, first after row {int(np.argmax(jump)) + 1}; unwrapped."
        findings.append(Finding("position-wrapped", "info", robot.joint_names[i], evidence))
    return q, tuple(findings)


def _check_limits(recording: Recording, reading: LogFormat, robot: Robot) -> tuple[Finding, ...]:
    """Raises an error for degrees taken for radians; reports joints far outside their limits."""
    limits = np.array([joint.position_limits for joint in robot.joints])
    span = limits[:, 1] - limits[:, 0]
    known = np.isfinite(span) & (span > 0)
    turns = np.array([not joint.is_prismatic for joint in robot.joints]) & known
    low, high = recording.q.min(axis=0), recording.q.max(axis=0)
    beyond = np.maximum(limits[:, 0] - low, high - limits[:, 1])
    far = known & (beyond > FAR * np.where(known, span, 1.0))
    if not far.any():
        return ()
    scaled_low, scaled_high = np.radians(low), np.radians(high)
    as_degrees = turns & (scaled_low >= limits[:, 0]) & (scaled_high <= limits[:, 1])
    plain = ~reading.degrees(robot.n)
    worst = int(np.argmax(np.where(far, beyond, -np.inf)))
    evidence = (
        f"joint {robot.joint_names[worst]} goes from {low[worst]:.4g} to {high[worst]:.4g} "
        f"{robot.joints[worst].unit}, far outside its limits [{limits[worst, 0]:.4g}, {limits[worst, 1]:.4g}]"
    )
    if (far & turns & plain & as_degrees).sum() == far.sum():
        several = 2 * far.sum() > turns.sum() and plain.all() and as_degrees[turns].all()
        units = "deg" if several else ["deg" if each else "rad" for each in far | ~plain]
        others = "all joints stay inside" if several else f"{_listed(robot, far)} stay inside, the others as they are"
        raise recording_error(
            "degrees",
            recording,
            f"{evidence}; taken as degrees, {others}.",
            lines("or transmission and joint_offset, where the log is motor-side", units=units),
        )
    return (
        Finding(
            "position-offset",
            "warning",
            robot.joint_names[worst],
            f"J{evidence[1:]}.",
            "find out units, joint_offset, transmission, the order of the channels and the limits.",
        ),
    )


def _listed(robot: Robot, which: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, one in zip(robot.joint_names, which, strict=True) if one)

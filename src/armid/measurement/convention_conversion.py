"""Conversion of recordings to the robot's convention: joint order, SI units, joint side and signs of the URDF."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.signals.unwrapping import whole_turn_jumps, without_turns
from armid.measurement.columns.column_guessing import shortened
from armid.measurement.columns.joint_assignment import in_joint_order
from armid.measurement.log_format import LogFormat
from armid.measurement.position_range_check import check_limits
from armid.measurement.processing.command_checks import still_commands, unwrapped_command
from armid.measurement.processing.delay import compensate_delay
from armid.measurement.processing.row_checks import clean
from armid.measurement.processing.spikes import without_spikes
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording, recording_error
from armid.measurement.remedy_builders import naming
from armid.robot.robot import Robot

WRAP_TOLERANCE = 0.5
"""Largest difference between a jump of an angle and a whole number of turns at which the jump counts as a wrap of the
angle [rad]. It allows for the motion of the joint from sample to sample, also over a short gap. If the typical step
of a channel is larger, wraps cannot be detected."""

COMMON = ("torque_sign", "position_sign", "delay", "drive_gain", "drive_gain_deviation", "position_zero_deviation")
"""Fields of the log format that may be one number for all joints, or one number for each joint."""


@dataclass(frozen=True, slots=True)
class ConvertedRecording:
    """Recording in the robot's convention.

    Attributes:
        recording: Recording in the joint order of the robot, SI units, joint side, signs of the URDF.
        findings: Findings of the conversion.
    """

    recording: Recording
    findings: tuple[Finding, ...] = ()


def to_robot_convention(recording: Recording, log_format: LogFormat, robot: Robot) -> ConvertedRecording:
    """Converts a recording to the robot's convention: joint order, SI units, joint side and signs of the URDF.

    Args:
        recording: Recording from a reader.
        log_format: Log format of the recording.
        robot: The arm that was recorded.

    Raises:
        RecordingError: The joints do not match; values are NaN; a channel is dead; there is neither clock nor rate;
            the clock runs backwards; angles are in degrees instead of radians; currents have no drive gains; or there
            are too few samples.
    """
    log_format = understood(recording, log_format)
    _check_lengths(log_format, robot)
    seen = recording.findings
    recording, others = in_joint_order(recording, log_format, robot)
    recording, findings = clean(recording, log_format)
    standing = (*_check_channels(recording, log_format), *still_commands(recording))
    _check_gains(recording, log_format)
    recording, spiked = without_spikes(recording, log_format, robot)
    recording, wrapped = _on_joint_side(recording, log_format, robot)
    recording = compensate_delay(recording, log_format)
    offset = check_limits(recording, log_format, robot)
    return ConvertedRecording(recording, (*seen, *others, *findings, *standing, *spiked, *wrapped, *offset))


def read_recording(path: Path | str, robot: Robot, log_format: LogFormat | None = None) -> Recording:
    """Reads a recording and converts it to the convention of the robot.

    The findings of the result are those of the reader and of the conversion.

    Args:
        path: A file in one of the known formats, or the folder of a ROS bag.
        robot: The arm that was recorded.
        log_format: Log format of the file; if not given, it is detected from the names of the columns.

    Raises:
        RecordingError: The file cannot be read or does not fit the robot; see `to_robot_convention`.
        MissingExtraError: The format needs a package that is not installed.
    """
    log_format = log_format or LogFormat()
    converted = to_robot_convention(load_recording(path, log_format, robot), log_format, robot)
    return replace(converted.recording, findings=converted.findings)


def understood(recording: Recording, log_format: LogFormat) -> LogFormat:
    """Log format to which the fields are added that the reader has detected."""
    return replace(log_format, **recording.guessed) if recording.guessed else log_format


def _check_lengths(log_format: LogFormat, robot: Robot) -> None:
    for name in (*COMMON, "units", "transmission", "joint_offset"):
        shape = np.shape(getattr(log_format, name))
        fits = shape in ((), (robot.n,), (robot.n, robot.n))
        if not fits and not (shape == (1,) and name in COMMON):
            raise RecordingError(
                f"The key `{name}` has {shape[0]} entries, but {robot.name} has {robot.n} joints.",
                possible=", ".join(robot.joint_names),
                remedy="give one entry for each joint, in the order of the robot.",
            )


def _check_channels(recording: Recording, log_format: LogFormat) -> tuple[Finding, ...]:
    """Raises an error for channels without a signal; returns findings about joints that stand still."""
    still = np.ptp(recording.q, axis=0) == 0
    if still.all():
        raise recording_error(
            "standstill",
            recording,
            f"the arm stands still: all positions are constant in all {recording.samples} rows.",
            "record while the arm moves, or name the columns of the measured positions under `columns`.",
        )
    for name in ("q", "dq", "ddq", "effort"):
        values = getattr(recording, name)
        if values is None:
            continue
        dead = np.ptp(values, axis=0) == 0
        # A joint held by its brake has a constant position, velocity and acceleration; other constant zeros are a
        # dead channel.
        dead &= (values[0] == 0) if name == "q" else ~still if name != "effort" else True
        if dead.any():
            joint = int(np.argmax(dead))
            optional = name in ("dq", "ddq")
            raise recording_error(
                "channel-dead",
                recording,
                f"{name} of {recording.channels[joint]} is {values[0, joint]:g} in all {recording.samples} rows.",
                naming(log_format, {name: ""}, "leave it out")
                if optional
                else "check whether the sensor, its cable or the logger is faulty, and record again; or lock this "
                "joint and leave its channel out.",
            )
    return tuple(
        Finding(
            "standstill",
            "warning",
            recording.channels[i],
            f"The position of the joint is {recording.q[0, i]:g} in all rows; parameters that need a motion of this "
            "joint cannot be identified.",
            "record while this joint moves, too, or lock it.",
        )
        for i in np.flatnonzero(still)
    )


def _check_gains(recording: Recording, log_format: LogFormat) -> None:
    if log_format.drive_gain is not None and recording.effort is None:
        raise RecordingError(
            f"{recording.source}: the key `drive_gain` is given, but the recording has no effort (torque or "
            "current).",
            remedy="name the columns of the currents under `columns`, or leave `drive_gain` out.",
        )
    if recording.effort_is_current and log_format.drive_gain is None:
        columns = recording.columns.get("effort", ())
        by_name = (
            f" by {'its name' if len(columns) == 1 else 'their names'}, {shortened(columns)}," if columns else ","
        )
        raise recording_error(
            "current-without-gain",
            recording,
            f"the effort is a motor current [A]{by_name} but there is no drive gain to convert it to torque.",
            "give the joint torque per ampere [N·m/A] under [[recording]]: `drive_gain = […]`, one value for "
            "each joint. If it is unknown, `armid doctor` estimates it from the masses of the description, with its "
            "`drive_gain_deviation`, as lines to paste; if the description has no masses, give `drive_gain = 1` with "
            "`drive_gain_deviation = 10`. Afterwards, a load of known mass determines the gains: armid payload RUN "
            "LOG --mass KG. If the log has torques as well, name their columns under `columns`.",
        )


def _on_joint_side(
    recording: Recording, log_format: LogFormat, robot: Robot
) -> tuple[Recording, tuple[Finding, ...]]:
    """Converts degrees, motor side, currents and signs to the robot's convention, and unwraps angles."""
    turns = np.array([not joint.is_prismatic for joint in robot.joints])
    sign = np.asarray(log_format.position_sign)
    unit = sign * np.where(turns & log_format.degrees(robot.n), np.pi / 180, 1.0)
    turning = turns if recording.consecutive else np.zeros(robot.n, dtype=np.bool_)
    logged, command = recording.q * unit, recording.command
    q, findings = _unwrapped(logged, turning, robot)
    command = None if command is None else unwrapped_command(command * unit, logged, q, turning)
    gear = (
        np.eye(robot.n) if log_format.transmission is None else np.asarray(log_format.transmission, dtype=np.float64)
    )
    offset = np.zeros(robot.n) if log_format.joint_offset is None else np.asarray(log_format.joint_offset)
    gain = np.ones(robot.n) if log_format.drive_gain is None else np.asarray(log_format.drive_gain)
    to_joint = np.asarray(np.linalg.inv(gear).T, dtype=np.float64)
    valid = recording.valid
    if log_format.transmission is not None and not valid.all():
        # A joint's sample is valid where those of all motors are that its position or torque is computed from.
        needed = (gear != 0) | (to_joint != 0)
        valid = ~((~valid).astype(np.float64) @ needed.astype(np.float64)).astype(np.bool_)

    def through(values: Array, matrix: Array) -> Array:
        return values if log_format.transmission is None else values @ matrix

    def moved(values: Array | None) -> Array | None:
        return None if values is None else through(values * unit, to_joint)

    effort = recording.effort
    return replace(
        recording,
        q=through(q, to_joint) + offset,
        dq=moved(recording.dq),
        ddq=moved(recording.ddq),
        effort=None if effort is None else through(effort * gain, gear) * np.asarray(log_format.torque_sign),
        command=None if command is None else through(command, to_joint) + offset,
        valid=valid,
        effort_is_current=False,
    ), findings


def _unwrapped(q: Array, turns: NDArray[np.bool_], robot: Robot) -> tuple[Array, tuple[Finding, ...]]:
    """Makes angles (N, n) continuous that jump by whole turns; the findings name their joints.

    `turns` is the mask of the joints whose angles may wrap, shape (n,).
    """
    findings: list[Finding] = []
    q = q.copy()
    for i in np.flatnonzero(turns):
        jump, whole = whole_turn_jumps(q[:, i], 2 * np.pi, WRAP_TOLERANCE)
        if not jump.any():
            continue
        q[:, i] = without_turns(q[:, i], jump, whole, 2 * np.pi)
        evidence = (
            f"The angle jumps by whole turns {jump.sum()} times, first after row {int(np.argmax(jump)) + 1}; it "
            "was made continuous."
        )
        findings.append(Finding("position-wrapped", "info", robot.joint_names[i], evidence))
    return q, tuple(findings)

"""Normalised positions of servo motors, and the calibration that converts them to angles.

A motor of LeRobot is calibrated by the two ends of its range, in ticks of an encoder with 4096 ticks a turn. Its
positions are logged as degrees about the middle of the range, or as a share of the range: from -100 to 100, and from
0 to 100 for a gripper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.input_boundary import read_json
from armid.measurement.log_format import LogFormat
from armid.measurement.remedy_builders import lines
from armid.robot.robot import Robot

TICKS = 4096
"""Ticks of the encoder in a turn."""

LARGEST = 100.0
"""Largest normalised position."""

ROUNDING = 1e-3
"""Excess over `LARGEST` that single precision can cause."""

GRIPPER = "gripper"
"""Part of the name of a motor that is normalised from 0 to 100, also where the others are in degrees."""


@dataclass(frozen=True, eq=False, slots=True)
class ConvertedChannels:
    """Channels of a data set after the conversion of normalised positions.

    Attributes:
        values: Values of each quantity, shape (N, n), in rad, or in degrees if the log format or `guessed` says so.
        guessed: Fields of the log format that were detected.
        findings: Findings about them.
    """

    values: Mapping[str, Array]
    guessed: Mapping[str, Any] = field(default_factory=dict[str, Any])
    findings: tuple[Finding, ...] = ()


def in_angles(
    values: Mapping[str, Array], motors: tuple[str, ...], log_format: LogFormat, robot: Robot | None, folder: Path
) -> ConvertedChannels:
    """Converts normalised positions to angles.

    With `units`, positions are in this unit, except those of grippers with degrees. Without it, they are normalised
    if there is a calibration, and degrees if one of them exceeds 100.

    Args:
        values: Values of `q` and, if they exist, `dq`, `effort` and `command`, shape (N, n) each.
        motors: Names of the motors; empty if they are unknown.
        log_format: Log format, with `units` and `calibration`.
        robot: The arm; grippers that it does not have need no calibration.
        folder: Folder of the data set.

    Raises:
        RecordingError: Positions are normalised, or may be, and there is no calibration; or it lacks a motor.
    """
    if log_format.units is not None and log_format.units != "deg":
        return ConvertedChannels(values)
    grippers = [j for j, name in enumerate(motors) if GRIPPER in name.lower()]
    others = [j for j in range(values["q"].shape[1]) if j not in grippers]
    guessed: dict[str, Any] = {}
    findings: tuple[Finding, ...] = ()
    degrees = log_format.units == "deg"
    if not degrees and log_format.calibration is None:
        largest = max(
            float(np.abs(values[key][:, others]).max(initial=0.0)) for key in ("q", "command") if key in values
        )
        if not largest > LARGEST + ROUNDING:
            raise _uncalibrated(folder)
        degrees, guessed = True, {"units": "deg"}
        evidence = (
            f"Positions reach {largest:.4g}, so they are not normalised values from -100 to 100; they were read as "
            "degrees."
        )
        findings = (Finding("units-guessed", "info", "", evidence, lines(units="deg")),)
    normalised = grippers if degrees else range(values["q"].shape[1])
    changed = {key: x.copy() for key, x in values.items()}
    ranges = _calibration(log_format.calibration, folder) if normalised and log_format.calibration else {}
    for j in normalised:
        name = motors[j] if motors else str(j + 1)
        if not ranges:
            _refuse_gripper(name, log_format, robot, folder)
        scale, middle = _scale(name, ranges, folder, from_zero=j in grippers) if ranges else (np.nan, 0.0)
        scale = np.degrees(scale) if degrees else scale
        for key in changed.keys() & {"q", "dq", "command"}:
            changed[key][:, j] = scale * (changed[key][:, j] - (0.0 if key == "dq" else middle))
    return ConvertedChannels(changed, guessed, findings)


def _scale(name: str, ranges: Mapping[str, Any], folder: Path, *, from_zero: bool) -> tuple[float, float]:
    """Angle of a unit of the normalised position [rad], and the normalised position of the middle of the range.

    Args:
        name: Name of the motor.
        ranges: Content of the calibration file.
        folder: Folder of the data set, for messages.
        from_zero: True if the position is normalised from 0 to 100, false if from -100 to 100.
    """
    motor = ranges.get(name)
    try:
        low, high, reversed_ = (float(motor[key]) for key in ("range_min", "range_max", "drive_mode"))  # pyright: ignore[reportOptionalSubscript]
        if not high > low:
            raise ValueError
    except (TypeError, KeyError, ValueError):
        raise RecordingError(
            f"{folder}: the calibration has no range of the motor {name!r}.",
            possible=", ".join(ranges),
            remedy="give the calibration of the robot that was recorded: for each motor `range_min` below "
            "`range_max`, and `drive_mode`.",
        ) from None
    span = (high - low) * 2.0 * np.pi / TICKS * (-1.0 if reversed_ else 1.0)
    return (span / LARGEST, LARGEST / 2.0) if from_zero else (span / (2.0 * LARGEST), 0.0)


def _calibration(name: str, folder: Path) -> dict[str, Any]:
    """Content of a calibration file, from the folder of the data set or a folder above it."""
    places = [above / name for above in (folder, *folder.absolute().parents)]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise RecordingError(
            f"{folder}: the calibration {name} was not found in the folder of the data set or above it.",
            remedy="copy the calibration of the robot there; LeRobot writes it as ROBOT_ID.json.",
        )
    return read_json(found, "a calibration of LeRobot", RecordingError)


def _uncalibrated(folder: Path) -> RecordingError:
    """Error for positions of which it is not known in which unit they are."""
    return RecordingError(
        f"{folder}: the positions are between -100 and 100, and it is not stated whether they are degrees or "
        "normalised values, which need a calibration.",
        possible='units = "deg"; units = "rad"; or calibration = "FILE.json" for normalised values',
        remedy="give one of these keys under [[recording]] of a study, or --units deg or --units rad; the "
        "calibration is the file that LeRobot has written for the robot.",
        code="calibration-missing",
    )


def _refuse_gripper(name: str, log_format: LogFormat, robot: Robot | None, folder: Path) -> None:
    """Raises an error if a gripper without calibration is a joint of the robot."""
    if robot is None or log_format.joint_map.get(name, name) not in robot.joint_names:
        return
    raise RecordingError(
        f"{folder}: the motor {name!r} is normalised from 0 to 100, also where others are in degrees, and there is "
        "no calibration.",
        remedy='give the key `calibration`; or lock the joint and leave its channel out: joints = { NAME = "" }.',
        code="calibration-missing",
    )

"""Recordings of a servo result, read again and compared with their digests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from armid.errors import ArmidError
from armid.measurement.recording import Recording
from armid.runs.locate_recording import find_recording
from armid.runs.servos.stored_servo import StoredServo
from armid.servo.servo_run import ServoRun, servo_runs
from armid.study.recordings.reading import read_choice


def read_servo_runs(
    stored: StoredServo, role: Literal["train", "validate"], data: Path | str | None = None
) -> tuple[tuple[ServoRun, ...], tuple[str, ...]]:
    """Reads the recordings of a result again.

    Args:
        stored: The result.
        role: Role of the recordings.
        data: Folder that is searched first.

    Returns:
        Runs of the recordings, and messages about recordings that are missing or have changed.
    """
    recordings, missing = read_servo_recordings(stored, role, data)
    return tuple(run for recording in recordings for run in servo_runs(recording)), missing


def read_servo_recordings(
    stored: StoredServo, role: Literal["train", "validate"], data: Path | str | None = None
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Reads the parts of the recordings of a result that have a role; arguments as of `read_servo_runs`."""
    found: list[Recording] = []
    missing: list[str] = []
    for choice, sha256 in zip(stored.study.recordings, stored.digests, strict=True):
        if choice.role != role:
            continue
        try:
            place = find_recording(choice.path, sha256, stored.study.folder, data)
            found.append(read_choice(replace(choice, path=str(place)), ".", stored.robot)[0])
        except ArmidError as error:
            missing.append(error.problem)
    return tuple(found), tuple(missing)

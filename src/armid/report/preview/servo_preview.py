"""Motion and masses of a servo result for a preview."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from armid.errors import ArmidError
from armid.report.preview.animation_frames import Clip, clip_of_recording
from armid.report.preview.inertia_ellipsoids import MassLayer
from armid.runs.servos.servo_recordings import read_servo_recordings
from armid.runs.servos.stored_servo import StoredServo, is_servo_folder, load_servo

ROLES: tuple[Literal["validate", "train"], ...] = ("validate", "train")
"""Roles of recordings, in the order in which a recording is looked for."""


def servo_in(name: str) -> StoredServo | None:
    """Servo result in a folder; `None` if it is no such folder."""
    return load_servo(name) if is_servo_folder(name) else None


def clip_of_servo(stored: StoredServo, data: Path | str | None) -> Clip:
    """Clip of the first readable recording of a servo result, validation before training.

    Args:
        stored: The result.
        data: Folder that is searched first for recordings.

    Raises:
        ArmidError: No recording can be read.
    """
    missing: list[str] = []
    for role in ROLES:
        recordings, absent = read_servo_recordings(stored, role, data)
        if recordings:
            return clip_of_recording(recordings[0], f"{Path(recordings[0].source).name} of {stored.folder}")
        missing += absent
    raise ArmidError(
        f"None of the recordings of {stored.folder} can be read: {' '.join(missing)}",
        remedy="give the folder of the recordings with --data, or give a plan or recording to show.",
    )


def layer_of_servo(stored: StoredServo) -> MassLayer:
    """Layer of the link inertias of a servo result."""
    return MassLayer("estimate", stored.parameters.inertial)

"""Search for the recordings that a run was made from, by name and sha256."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from armid.errors import ArmidError
from armid.measurement.bag_paths import sha256_of_recording
from armid.measurement.recording import Recording
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.demo import MOTIONS, demo_recordings
from armid.study.read_recordings import read_choice


def read_recording_of(
    run: Run, choice: RecordingChoice, sha256: str, folder: Path | str, data: Path | str | None = None
) -> Recording:
    """Reads the recording that a run was made from; one of a demo is simulated again.

    Args:
        run: The run.
        choice: The recording in the run's study.
        sha256: Digest of its bytes when the run was made.
        folder: Folder that the study's paths are relative to.
        data: Folder that is searched first.

    Raises:
        ArmidError: It is missing or has changed.
    """
    if choice.path in MOTIONS:
        recording, _ = read_choice(choice, ".", run.robot, demo_recordings(run.folder))
    else:
        place = find_recording(choice.path, sha256, folder, data)
        recording, _ = read_choice(replace(choice, path=str(place)), ".", run.robot)
    if recording.sha256 != sha256:
        raise ArmidError(
            f"{choice.path} has changed since the run was made (sha256 {recording.sha256[:12]}…).",
            remedy="put the file of that time back, or identify again.",
        )
    return recording


def find_recording(path: str, sha256: str, folder: Path | str, data: Path | str | None = None) -> Path:
    """Finds a recording of a study: the file of that name with the same bytes.

    Args:
        path: Path in the study.
        sha256: Digest of its bytes when the run was made.
        folder: Folder that the study's paths are relative to.
        data: Folder that is searched first, by path and then by name in all its sub-folders.

    Raises:
        ArmidError: There is none; the message lists files of its name with other bytes.
    """
    others: list[Path] = []
    for place in dict.fromkeys(_places(Path(path), Path(folder), None if data is None else Path(data))):
        if sha256_of_recording(place) == sha256:
            return place
        others.append(place)
    study_folder = "the working folder" if folder in (Path(), ".", "") else f"{folder}"
    where = study_folder if data is None else f"{data} or {study_folder}"
    if others:
        listed = ", ".join(str(place) for place in others)
        raise ArmidError(
            f"{path} has changed since the run was made: {listed} "
            f"{'holds' if len(others) == 1 else 'hold'} other data (then sha256 {sha256[:12]}…).",
            remedy="put the file of that time back, say with --data FOLDER where it is, or identify again.",
        )
    raise ArmidError(f"{path} is not in {where} any more.", remedy="say with --data FOLDER where it is.")


def _places(path: Path, folder: Path, data: Path | None) -> Iterator[Path]:
    """Candidate files or folders, the likeliest first."""
    likely = [] if data is None else [data / path, data / path.name]
    yield from (place for place in likely if place.exists())
    if data is not None and data.is_dir():
        yield from sorted(place for place in data.rglob(path.name) if place.exists())
    # Or in the working folder, where all of it was moved.
    yield from (place for place in (folder / path, folder / path.name, path) if place.exists())

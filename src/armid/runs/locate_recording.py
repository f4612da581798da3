"""Search for the recordings from which a run was made, by name and sha256."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from armid.errors import ArmidError
from armid.measurement.recording import Recording
from armid.measurement.recording_paths import recording_exists, sha256_of_recording, split_episode
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.demo import MOTIONS, demo_recordings
from armid.study.recordings.reading import read_choice


def read_recording_of(
    run: Run, choice: RecordingChoice, sha256: str, folder: Path | str, data: Path | str | None = None
) -> Recording:
    """Reads a recording from which a run was made; a recording of a demo is simulated again.

    Args:
        run: The run.
        choice: The recording in the study of the run.
        sha256: Digest of the file when the run was made.
        folder: Folder to which the paths of the study are relative.
        data: Folder that is searched first.

    Raises:
        ArmidError: The recording is missing or has changed.
    """
    if choice.path in MOTIONS:
        recording, _ = read_choice(choice, ".", run.robot, demo_recordings(run.folder))
    else:
        place = find_recording(choice.path, sha256, folder, data)
        recording, _ = read_choice(replace(choice, path=str(place)), ".", run.robot)
    if recording.sha256 != sha256:
        raise ArmidError(
            f"{choice.path} has changed since the run was made (sha256 {recording.sha256[:12]}…).",
            remedy="restore the original file, or identify again.",
        )
    return recording


def find_recording(path: str, sha256: str, folder: Path | str, data: Path | str | None = None) -> Path:
    """Finds the file of a recording of a study: a file with the same name and the same digest.

    Args:
        path: Path in the study.
        sha256: Digest of the file when the run was made.
        folder: Folder to which the paths of the study are relative.
        data: Folder that is searched first, by path and then by name in all its sub-folders.

    Raises:
        ArmidError: No file has this name and the same bytes. The message lists files with this name and other bytes.
    """
    others: list[Path] = []
    for place in dict.fromkeys(_places(Path(path), Path(folder), None if data is None else Path(data))):
        if sha256_of_recording(place) == sha256:
            return place
        others.append(place)
    study_folder = "the current working folder" if folder in (Path(), ".", "") else f"{folder}"
    where = study_folder if data is None else f"{data} or {study_folder}"
    if others:
        listed = ", ".join(str(place) for place in others)
        raise ArmidError(
            f"{path} has changed since the run was made: {listed} {'has' if len(others) == 1 else 'have'} "
            f"other data than the original file (sha256 {sha256[:12]}…).",
            remedy="restore the original file, give its folder with --data FOLDER, or identify again.",
        )
    raise ArmidError(f"{path} was not found in {where}.", remedy="give the folder of the file with --data FOLDER.")


def _places(path: Path, folder: Path, data: Path | None) -> Iterator[Path]:
    """Yields existing files or folders that may be the recording, the most probable first.

    Args:
        path: Path in the study.
        folder: Folder to which the paths of the study are relative.
        data: Folder that is searched first.
    """
    likely = [] if data is None else [data / path, data / path.name]
    yield from (place for place in likely if recording_exists(place))
    if data is not None and data.is_dir():
        files = data.rglob(split_episode(path)[0].name)
        yield from sorted(each.with_name(path.name) for each in files if recording_exists(each.with_name(path.name)))
    # Or in the working folder, where all of it was moved.
    yield from (place for place in (folder / path, folder / path.name, path) if recording_exists(place))

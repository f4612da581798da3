"""Description and validation recordings of a run, read again and verified with the digests in the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armid.errors import ArmidError, OutputError
from armid.export.catalogue import EXPORTERS
from armid.export.types import DescriptionSource
from armid.input_boundary import read_json
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import Robot
from armid.robot.loading import builtin_arms, held_of, load_robot
from armid.robot.readers import mjcf
from armid.runs.locate_recording import read_recording_of
from armid.runs.run import Run
from armid.study.config import RecordingChoice, RobotChoice, parse_robot


@dataclass(frozen=True, eq=False, slots=True)
class Unseen:
    """Recordings with which a run was validated, read again for the check of an exported file.

    Attributes:
        recordings: Recordings that can be read.
        missing: Messages, one for each recording that cannot be read again.
    """

    recordings: tuple[tuple[RecordingChoice, Recording], ...]
    missing: tuple[str, ...]


def find_source(run: Run, description: Path | str | None = None) -> DescriptionSource:
    """Finds the description with which a run was identified, and checks that it has not changed.

    Args:
        run: The run.
        description: Path of the description, if it was moved after the identification.

    Raises:
        OutputError: The file does not exist, or it has changed.
    """
    study = _record(run)
    return source_of(parse_robot(study["robot"]), _relative_folder(study), run.robot, description)


def source_of(
    choice: RobotChoice, folder: Path, identified: Robot, description: Path | str | None = None
) -> DescriptionSource:
    """Finds the description of an identified arm, and checks that it has not changed.

    Args:
        choice: Description and options of the arm in the study.
        folder: Folder to which the path of the description is relative.
        identified: The arm, as it was read for the identification.
        description: Path of the description, if it was moved after the identification.

    Raises:
        OutputError: The file does not exist, or it has changed.
    """
    name = choice.description
    selected: dict[str, Any] = {"lock": choice.lock, "only": choice.only, "tip": choice.tip}
    if name in builtin_arms():
        return DescriptionSource(name, "dh", b"", held_of(name, **selected))
    places = [Path(description)] if description is not None else []
    places += [folder / name, Path(identified.source)] if description is None else []
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise OutputError(
            f"The description {places[0]} of the run does not exist any more.",
            remedy="give the present path of the description with --description FILE.",
        )
    robot = load_robot(path, gravity=choice.gravity, **selected)
    if identified.sha256 not in (robot.sha256, _former_digest(path)):
        raise OutputError(
            f"{path} has changed since the identification: its sha256 was {identified.sha256[:12]}… at that time "
            f"and is {robot.sha256[:12]}… now.",
            remedy="give the unchanged file with --description FILE, or identify again.",
        )
    return _read(path, held_of(path, **selected))


def _former_digest(path: Path) -> str | None:
    """Digest of an MJCF as earlier versions of armid computed it, without the files of meshes.

    The result is `None` for other formats.
    """
    text = path.read_text(encoding="utf-8")
    return mjcf.digest_without_meshes(text, source=str(path)) if mjcf.recognises(text) else None


def unseen_recordings(run: Run, data: Path | str | None = None) -> Unseen:
    """Reads the validation recordings of a run again.

    Args:
        run: The run.
        data: Folder that is searched first, for the path that the study gives to a recording, and for its file name.
    """
    study = _record(run)
    recordings: list[tuple[RecordingChoice, Recording]] = []
    missing: list[str] = []
    for each, sha256 in zip(study["recordings"], run.estimate.recording_digests, strict=True):
        if each["role"] != "validate":
            continue
        try:
            choice = RecordingChoice(each["path"], each["role"], LogFormat(**each["reading"]), tuple(each["part"]))
            recording = read_recording_of(run, choice, sha256, _relative_folder(study), data)
        except ArmidError as error:
            missing.append(error.problem)
        else:
            recordings.append((choice, recording))
    return Unseen(tuple(recordings), tuple(missing))


def _relative_folder(study: Mapping[str, Any]) -> Path:
    """Folder of the study, as a path relative to the working folder if the study is inside the working folder."""
    folder, here = Path(str(study["folder"])), Path.cwd()
    return folder.relative_to(here) if folder.is_relative_to(here) else folder


def _read(path: Path, locked: Mapping[str, float]) -> DescriptionSource:
    """Reads a description with an exporter that can edit its format; without one, its format is stored as `dh`."""
    data = path.read_bytes()
    for name, exporter in EXPORTERS.items():
        opened = exporter.open_description(path, data)
        if opened is not None:
            return DescriptionSource(str(path), name, opened.data, locked, opened.files, opened.findings)
    return DescriptionSource(str(path), "dh", data, locked, (str(path),))


def _record(run: Run) -> dict[str, Any]:
    """Reads the file `study.json` of a run."""
    path = Path(run.folder) / "study.json"
    return read_json(path, "the study of a run", remedy="identify again; this writes the file again.")

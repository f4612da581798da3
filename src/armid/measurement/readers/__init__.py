"""Readers of recordings, one module for each format; `armid.measurement.catalogue` lists them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from armid.errors import RecordingError
from armid.input_boundary import boundary, within
from armid.measurement.catalogue import READERS, RecordingFormat, recording_suffixes
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.measurement.recording_paths import format_of_folder, sha256_of_recording, split_episode
from armid.measurement.reduction.reduce import PIECE, UnsuitableRecordingError, reduce_pieces, reduce_recording
from armid.robot.robot import Robot
from armid.threads import ahead, meanwhile

__all__ = ["load_recording"]


def load_recording(path: Path | str, log_format: LogFormat | None = None, robot: Robot | None = None) -> Recording:
    """Reads a recording without conversion; `to_robot_convention` converts it to the convention of the robot.

    A recording with a high sample rate is reduced (`highest_rate` of the log format).

    Args:
        path: File, whose suffix determines the format, or folder of a ROS bag, a LeRobot data set or SAGE; the name
            of the data set followed by `#3` is its episode 3.
        log_format: Log format of the file.
        robot: The arm; its joint names are used to select columns, topic and messages.

    Raises:
        RecordingError: The file is missing, empty, damaged, of an unknown format, or lacks a column.
        MissingExtraError: The format needs a package that is not installed.
    """
    path = Path(path)
    with boundary("a recording", path, RecordingError, remedy="give the path of a file that exists."):
        form = _format(path)
    with boundary(form.title, path, RecordingError, remedy=form.repair):
        digest = meanwhile(lambda: sha256_of_recording(path))
        recording = _read(form, path, log_format or LogFormat(), robot)
        within("samples", recording.samples, str(path), RecordingError)
        return replace(recording, source=str(path), sha256=digest())


def _read(form: RecordingFormat, path: Path, log_format: LogFormat, robot: Robot | None) -> Recording:
    """Reads a recording, and reduces it if its rate is high; piece by piece, if the format allows it."""
    reader = form.piece_reader
    found = None if reader is None else reader.pieces(path, log_format, robot, PIECE)
    if found is not None:
        try:
            return reduce_pieces(ahead(found.pieces), found.samples, log_format)
        except UnsuitableRecordingError:
            return form.reader.read(path, log_format, robot)
    return reduce_recording(form.reader.read(path, log_format, robot), log_format)


def _format(path: Path) -> RecordingFormat:
    """Format of the recording at a path, determined by its suffix; raises an error if the file cannot be read."""
    folder, _ = split_episode(path)
    if folder.is_dir():
        return format_of_folder(folder)
    name = path.name.lower()
    known = next((each for each in READERS.values() if path.suffix.lower() in each.suffixes), None)
    found = known or next((each for each in READERS.values() if name.endswith(each.packed)), None)
    if found is None:
        packings = READERS["csv"].packings
        raise RecordingError(
            f"{path} has an unknown format.",
            possible=f"{', '.join(recording_suffixes())}; compressed text as .csv{', '.join(packings[:-1])} or "
            f"{packings[-1]}; the folder of a ROS bag, a LeRobot data set or SAGE",
            remedy="export the recording in one of these formats, or rename the file if its suffix does not match "
            "its format.",
        )
    if not path.is_file():
        raise RecordingError(
            f"{path} does not exist.",
            remedy="check the path; paths in a study are relative to the folder of the study.",
        )
    if not path.stat().st_size:
        raise RecordingError(f"{path} is empty.", remedy="record again, because nothing was written.")
    return found

"""Reading of the recordings that a study names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.problem import default_zero_deviation
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.reduction.reduce import reduce_recording
from armid.robot import Robot
from armid.study.config import RecordingChoice, Study
from armid.study.progress import Progress
from armid.study.recordings.data_split import cut_recording, refuse_shared


def recording_as_logged(
    choice: RecordingChoice,
    folder: Path | str,
    robot: Robot,
    given: Mapping[str, Recording] | None = None,
) -> Recording:
    """Recording of a study as it was logged, with a reduced rate if its rate is high.

    The arguments and errors are those of `read_choice`.
    """
    found = (given or {}).get(choice.path)
    if found is not None:
        return reduce_recording(found, choice.reading)
    return load_recording(Path(folder) / choice.path, choice.reading, robot)


def read_choice(
    choice: RecordingChoice,
    folder: Path | str,
    robot: Robot,
    given: Mapping[str, Recording] | None = None,
) -> tuple[Recording, tuple[Finding, ...]]:
    """Reads one recording of a study and converts it to the robot's convention.

    Args:
        choice: File, log format and part.
        folder: Folder to which the path is relative.
        robot: The arm.
        given: Recordings that are in memory already, by path.

    Raises:
        RecordingError: The recording cannot be read or does not fit the robot.
    """
    raw = recording_as_logged(choice, folder, robot, given)
    read = to_robot_convention(raw, choice.reading, robot)
    return cut_recording(read.recording, choice.part), read.findings


def read_all(
    study: Study, robot: Robot, given: Mapping[str, Recording] | None, progress: Progress
) -> tuple[list[tuple[RecordingChoice, Recording]], list[tuple[Finding, ...]]]:
    """Reads all recordings of a study.

    Args:
        study: The study.
        robot: The arm.
        given: Recordings that are in memory already, by path.
        progress: Function that is called before each recording with the share of the recordings that are read.

    Returns:
        Recordings with their options in the study, and the findings on each recording.

    Raises:
        RecordingError: A recording cannot be read or does not fit the robot.
        StudyError: A sample is used twice.
    """
    recordings: list[tuple[RecordingChoice, Recording]] = []
    findings: list[tuple[Finding, ...]] = []
    logged: dict[tuple[str, str], Recording] = {}  # a file that is used in several parts is read once
    for k, choice in enumerate(study.recordings):
        progress("recordings", k / len(study.recordings))
        file = choice.path, repr(choice.reading)
        if file not in logged:
            logged[file] = recording_as_logged(choice, study.folder, robot, given)
        recording, found = read_choice(choice, study.folder, robot, {choice.path: logged[file]})
        findings.append(found)
        recordings.append((choice, recording))
    refuse_shared(recordings)
    return recordings, findings


def scale_deviation(choices: Sequence[RecordingChoice], robot: Robot) -> Array:
    """Relative standard deviation of the torque scale of each joint: the largest value that any recording states.

    Args:
        choices: Recordings with their log formats.
        robot: The arm.

    Returns:
        Relative standard deviations, shape (n,); 0 if no recording states a value.
    """
    given = [choice.reading.drive_gain_deviation for choice in choices]
    deviations = [np.broadcast_to(np.asarray(each, dtype=np.float64), robot.n) for each in given if each is not None]
    return np.max([np.zeros(robot.n), *deviations], axis=0)


def position_zero_deviation(choices: Sequence[RecordingChoice], robot: Robot) -> Array:
    """Standard deviation of the zero error of each joint's positions: the largest value of all recordings.

    Args:
        choices: Recordings with their log formats.
        robot: The arm.

    Returns:
        Standard deviations, shape (n,) [rad or m]. For a recording that states none, the default is used.
    """
    given = [choice.reading.position_zero_deviation for choice in choices]
    default = default_zero_deviation(robot)
    each = [default if value is None else np.asarray(value, dtype=np.float64) for value in given]
    return np.max([np.broadcast_to(value, robot.n) for value in each] or [default], axis=0)

"""Remedies of exchanged joints: pasted, they give the sound log, however its columns are called."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.convention_conversion import read_recording
from armid.measurement.log_format import LogFormat
from armid.robot import Robot
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study, build_model
from armid.study.diagnosis import diagnose, run_checks
from armid.study.remedy_translation import applied, as_option
from recordings import write_csv
from sick import Case, sound

ARM = "ur10e"

NAMES = {
    "by word": ("q_{name}", "tau_{name}"),
    "by word in front": ("{name}_pos", "{name}_effort"),
    "from 1": ("J{number}_pos", "J{number}_torque"),
    "from 0": ("q{index}", "tau{index}"),
    "usual": ("q{number}", "tau{number}"),
}
"""Columns of positions and torques of a joint."""

USUAL = ("by word", "usual")
"""Forms that are tried always; the others only with --long, because each takes as long as these."""

ORDER = np.array([0, 2, 1, 3, 4, 5])
"""Shoulder and elbow exchanged."""

EXCHANGED = {"both": (ORDER, ORDER), "torque": (range(6), ORDER), "positions": (ORDER, range(6))}
"""Channels of positions and of torques in the log."""


def columns(pattern: str, robot: Robot) -> list[str]:
    return [pattern.format(name=name, number=j + 1, index=j) for j, name in enumerate(robot.joint_names)]


def write_log(
    path: Path, case: Case, names: Sequence[str], q: Sequence[int] = range(6), torque: Sequence[int] = range(6)
) -> None:
    """A log without velocities, channels as given, and columns by the patterns of names."""
    log = case.recording
    assert log.time is not None and log.effort is not None
    table = {"t": log.time} | dict(zip(columns(names[0], case.robot), log.q[:, q].T, strict=True))
    write_csv(path, table | dict(zip(columns(names[1], case.robot), log.effort[:, torque].T, strict=True)))


def study_of(path: Path, reading: LogFormat) -> Study:
    return Study(RobotChoice(ARM), ModelChoice(), (RecordingChoice(str(path), reading=reading),), folder=Path("/"))


def errors(study: Study) -> list[Finding]:
    return [finding for finding in diagnose(study)[0].findings if finding.severity == "error"]


def errors_of_identification(study: Study, case: Case) -> list[Finding]:
    """Errors that an identification finds."""
    (choice,) = study.recordings
    recording = read_recording(choice.path, case.robot, choice.reading)
    model = build_model(case.robot, ModelChoice(terms=("rigid-body",)))
    return [finding for _, finding in run_checks(model, [(choice, recording)]) if finding.severity == "error"]


@pytest.mark.parametrize("fault", EXCHANGED)
@pytest.mark.parametrize("names", [n if n in USUAL else pytest.param(n, marks=pytest.mark.long) for n in NAMES])
def test_the_remedy_of_exchanged_joints_gives_the_sound_log_however_columns_are_called(
    names: str, fault: str, tmp_path: Path
):
    case = sound(11, name=ARM)
    write_log(tmp_path / "log.csv", case, NAMES[names], *EXCHANGED[fault])
    study = study_of(tmp_path / "log.csv", LogFormat())
    for (found,) in (errors(study), errors_of_identification(study, case)):
        assert found.code == "joint-order" and as_option(found.remedy) is not None
        again = applied(study, str(tmp_path / "log.csv"), found.remedy)
        assert not errors(again) and not errors_of_identification(again, case)
        read = read_recording(tmp_path / "log.csv", case.robot, again.recordings[0].reading)
        np.testing.assert_array_equal(read.q, case.recording.q)
        np.testing.assert_array_equal(read.effort, case.recording.effort)


@pytest.mark.parametrize("form", [list, pytest.param(dict, marks=pytest.mark.long)])
@pytest.mark.parametrize("fault", EXCHANGED)
def test_the_remedy_replaces_joints_that_the_study_states(form: type, fault: str, tmp_path: Path):
    case = sound(11, name=ARM)
    write_log(tmp_path / "log.csv", case, NAMES["by word"], *EXCHANGED[fault])
    joints = case.robot.joint_names if form is list else {name: name for name in case.robot.joint_names}
    study = study_of(tmp_path / "log.csv", LogFormat(joints=joints))
    for (found,) in (errors(study), errors_of_identification(study, case)):
        again = applied(study, str(tmp_path / "log.csv"), found.remedy)
        assert {*tomllib.loads(found.remedy)} == {"columns", "joints"} and not errors(again)


@pytest.mark.parametrize("names", NAMES)
def test_a_list_of_joints_counts_columns_in_the_order_of_the_file(names: str, tmp_path: Path):
    case = sound(11, name=ARM)
    write_log(tmp_path / "log.csv", case, NAMES[names], ORDER, ORDER)
    joints = [case.robot.joint_names[k] for k in ORDER]
    read = read_recording(tmp_path / "log.csv", case.robot, LogFormat(joints=joints))
    np.testing.assert_array_equal(read.q, case.recording.q)
    np.testing.assert_array_equal(read.effort, case.recording.effort)


def test_joints_named_as_in_the_columns_are_assigned(tmp_path: Path):
    case = sound(11, name=ARM)
    write_log(tmp_path / "log.csv", case, ("pos_axis_{number}", "tau_axis_{number}"), ORDER, ORDER)
    joints = {f"axis_{k + 1}": case.robot.joint_names[j] for k, j in enumerate(ORDER)}
    read = read_recording(tmp_path / "log.csv", case.robot, LogFormat(joints=joints))
    np.testing.assert_array_equal(read.q, case.recording.q)
    straight = dict(zip((f"axis_{k + 1}" for k in range(6)), case.robot.joint_names, strict=True))
    read = read_recording(tmp_path / "log.csv", case.robot, LogFormat(joints=straight))
    np.testing.assert_array_equal(read.q, case.recording.q[:, ORDER])


@pytest.mark.parametrize("names", [("q", "tau"), ("positions", "torques")])
def test_exchanged_columns_of_matrices_are_assigned_by_joints(names: tuple[str, str], tmp_path: Path):
    case = sound(11, name=ARM)
    log = case.recording
    assert log.time is not None and log.effort is not None
    np.savez(tmp_path / "log.npz", t=log.time, **{names[0]: log.q[:, ORDER], names[1]: log.effort[:, ORDER]})
    study = study_of(tmp_path / "log.npz", LogFormat())
    for (found,) in (errors(study), errors_of_identification(study, case)):
        assert not errors(applied(study, str(tmp_path / "log.npz"), found.remedy))

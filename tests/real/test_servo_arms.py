"""Real arms without torque: closed-loop error on motion that was not used for training."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from armid.doctor import CHECKS
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.export.servos.mujoco_rollout import SAME, compare_roll_outs
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.robot import load_robot
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.diagnosis import diagnose_recording
from armid.study.servos.choice import ServoChoice
from armid.study.servos.identification import identify_servo_study

TRAINING = {
    "chirp_sweep": 2000 / 6000,
    "multisine": 1500 / 6000,
    "large_amplitude": 2000 / 6652,
    "workspace_sweep": 1500 / 5465,
}
"""Share of each recording that trains."""

HELD_OUT = ("lissajous_pattern", "trapezoidal_profile", "hold_under_gravity", "custom_motion")

COVERAGE = (0.90, 0.99)
"""Range of the share of the rows of validation inside the 95 % band, over all joints."""

OF_DESCRIPTION, OF_COMMAND = 0.60, 0.42
"""Largest error relative to that of the community's description of the SO-101, and to that of command = position."""

COMMAND_CODES = {code for check in CHECKS.values() if check.needs_command for code in check.effects}
"""Faults of commands; these recordings have none."""

GO2_ERROR = 7.0e-3
"""Largest error [rad] of the Go2: another program's output error reaches 6.6 mrad with as many unknowns."""


@pytest.mark.long
def test_so101(shared_data, tmp_path):
    folder = shared_data / "so101_sage"
    recordings = [RecordingChoice(f"{name}.parquet", part=(0.0, share)) for name, share in TRAINING.items()]
    recordings += [RecordingChoice(f"{name}.parquet", "validate") for name in HELD_OUT]
    study = Study(RobotChoice("so101_new_calib.xml"), ModelChoice(), tuple(recordings), folder=str(folder))
    result = identify_servo_study(study)
    assert result.score is not None
    assert result.score.described is not None
    assert result.score.model.total < OF_DESCRIPTION * result.score.described.total
    assert result.score.model.total < OF_COMMAND * result.score.command.total
    assert not any(each.severity == "error" for each in result.findings)
    judge_band_and_file(result, tmp_path)
    assert not any(each.code in COMMAND_CODES for each in result.findings)


@pytest.mark.long
def test_go2_on_a_stand(shared_data, tmp_path):
    folder = shared_data / "go2_stand"
    text = re.sub(r"<freejoint[^>]*/>", "", (folder / "go2.xml").read_text())  # the trunk is held
    (tmp_path / "go2.xml").write_text(text)
    path, rate = str(folder / "first70.parquet"), LogFormat()
    recordings = (
        RecordingChoice(path, reading=rate, part=(0.0, 50 / 70)),
        RecordingChoice(path, "validate", rate, (50 / 70, 1.0)),
    )
    servo = ServoChoice(stiffness=20.0, damping=1.5)
    study = Study(RobotChoice(str(tmp_path / "go2.xml")), ModelChoice(), recordings, servo=servo)
    result = identify_servo_study(study)
    assert result.score is not None
    assert result.score.model.total < GO2_ERROR
    assert not any(each.code in COMMAND_CODES for each in result.findings)
    judge_band_and_file(result, tmp_path)


def judge_band_and_file(result, tmp_path):
    """The band holds about 95 % of the rows, and MuJoCo moves the written file like armid, over all of validation."""
    low, high = COVERAGE
    assert low < result.score.coverage.mean() < high
    path = tmp_path / "written.xml"
    path.write_bytes(servo_mjcf(result.estimate.model, result.estimate.parameters))
    compared = compare_roll_outs(path, result.estimate.model, result.estimate.parameters, result.validation)
    assert compared is not None
    assert compared.total < SAME


@pytest.mark.parametrize("name", ["so101_new_calib.xml", "so101_new_calib.urdf"])
def test_servos_of_the_description(shared_data, name):
    """Only an MJCF states servos."""
    from armid.robot import load_robot
    from armid.robot.described_drive import DescribedServo

    robot = load_robot(shared_data / "so101_sage" / name)
    servos = {joint.drive.servo and replace(joint.drive.servo, command_range=None) for joint in robot.joints}
    assert servos == ({DescribedServo(17.8)} if name.endswith("xml") else {None})


@pytest.mark.parametrize("name", [*TRAINING, *HELD_OUT])
def test_the_doctor_finds_no_fault_of_commands_of_the_so101(shared_data, name):
    folder = shared_data / "so101_sage"
    robot = load_robot(folder / "so101_new_calib.xml")
    raw = load_recording(folder / f"{name}.parquet", LogFormat(), robot)
    codes = {each.code for each in diagnose_recording(robot, raw, LogFormat())}
    assert not codes & COMMAND_CODES


def test_the_doctor_finds_no_fault_of_commands_of_the_go2(shared_data, tmp_path):
    folder = shared_data / "go2_stand"
    (tmp_path / "go2.xml").write_text(re.sub(r"<freejoint[^>]*/>", "", (folder / "go2.xml").read_text()))
    robot = load_robot(tmp_path / "go2.xml")
    raw = load_recording(folder / "first70.parquet", LogFormat(), robot)
    codes = {each.code for each in diagnose_recording(robot, raw, LogFormat())}
    assert not codes & COMMAND_CODES

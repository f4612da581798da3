"""Descriptions that give the mass of some links: what is compared with them, and which torque is checked."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import limits_of
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import Robot, load_robot
from armid.robot.missing_inertia import joints_with_unknown_load, links_without_inertia
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.diagnosis import diagnose
from armid.study.identify import identify
from armid.study.plans.design_options import DesignConstraints
from armid.study.plans.torque_constraint import judged_torque
from labs import URDF, small_recording

BODY = '<visual><geometry><sphere radius="0.05"/></geometry></visual>'


def described(folder: Path, unknown: tuple[int, ...], light: tuple[int, ...] = (), body: str = BODY) -> Path:
    """The small arm; some links have geometry but no mass, others are nearly without mass."""
    parts = URDF.split("<inertial>")
    for i in range(1, 4):
        inertial, rest = parts[i].split("</inertial>")
        if i in light:
            inertial = re.sub(r'mass value="\d"', 'mass value="1e-9"', inertial)
            inertial = re.sub(r'(i..)="[^"]*"', r'\1="0"', inertial).replace('xyz="0.02', 'xyz="0')
        parts[i] = body + rest if i in unknown else f"<inertial>{inertial}</inertial>{rest}"
    path = folder / "partly.urdf"
    path.write_text("".join(parts))
    return path


def arm(folder: Path, unknown: tuple[int, ...], light: tuple[int, ...] = (), body: str = BODY) -> Robot:
    return load_robot(described(folder, unknown, light, body))


def test_a_link_with_geometry_but_no_mass_is_unknown_and_one_without_either_is_a_frame(tmp_path: Path):
    assert links_without_inertia(arm(tmp_path, (1, 2))) == (0, 1)
    assert links_without_inertia(arm(tmp_path, (1, 2), body="")) == ()
    assert links_without_inertia(arm(tmp_path, ())) == ()
    assert links_without_inertia(arm(tmp_path, (1, 2, 3))) == ()  # the description gives no mass at all
    assert joints_with_unknown_load(arm(tmp_path, (2,))) == ("joint_1", "joint_2")


@pytest.mark.parametrize("light", [(), (3,)], ids=["one-link", "one-frame"])
def test_a_sound_log_is_not_compared_with_part_of_the_masses(tmp_path: Path, light: tuple[int, ...]):
    path = described(tmp_path, (1, 2), light)
    assert DynamicsModel(load_robot(path)).nominal_parameters() is None
    log = {"log": small_recording(1), "check": small_recording(2)}
    study = Study(
        RobotChoice(str(path)), ModelChoice(), (RecordingChoice("log"), RecordingChoice("check", role="validate"))
    )
    assert not [f for each in diagnose(study, given=log) for f in each.findings if f.severity != "info"]
    found = identify(study, given=log)
    assert found.validation.verdict == "pass"
    assert not any("description" in check.name for check in found.validation.checks)


def test_torque_is_checked_where_all_moved_masses_are_known(tmp_path: Path):
    robot = arm(tmp_path, (2,))
    model = DynamicsModel(robot, (RigidBody(),))
    goal = CriterionGoal(model, find_base_parameters(model))
    torque, findings = judged_torque(goal, limits_of(robot, {}), DesignConstraints(torque_margin=0.1))
    (told,) = [f for f in findings if f.code == "torque-unknown"]
    assert (told.severity, told.channel) == ("warning", "joint_1, joint_2") and told.evidence.endswith(": link_2")
    assert torque is not None and torque.labels == ("joint_3",)
    nothing, findings = judged_torque(
        CriterionGoal(*both(arm(tmp_path, (3,)))), limits_of(robot, {}), DesignConstraints(torque_margin=0.1)
    )
    assert nothing is None and [f.code for f in findings] == ["torque-unknown"]


def both(robot: Robot):
    model = DynamicsModel(robot, (RigidBody(),))
    return model, find_base_parameters(model)


def test_masses_of_meshes_that_are_missing_are_said_to_be_unknown_not_absent(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="no.stl"/></asset><worldbody><body name="a">'
        '<joint name="j" range="-60 60" actuatorfrcrange="-9 9"/><geom type="mesh" mesh="m" mass="2"/></body>'
        "</worldbody></mujoco>"
    )
    model = DynamicsModel(load_robot(path), (RigidBody(),))
    goal = CriterionGoal(model, find_base_parameters(model))
    _, findings = judged_torque(
        goal, limits_of(model.robot, {("j", "velocity"): 1.0}), DesignConstraints(torque_margin=0.1)
    )
    (said,) = [each for each in findings if each.code == "torque-unknown"]
    assert "has no masses" not in said.evidence and f"{tmp_path / 'no.stl'} does not exist" in said.evidence
    assert said.channel == "a" and "--after" in said.remedy

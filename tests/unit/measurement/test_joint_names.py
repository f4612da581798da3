"""A log that names another arm's joints is told so and is never read in their order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from armid.errors import Finding, RecordingError
from armid.measurement.columns.column_selection import Selection, select
from armid.measurement.columns.joint_assignment import in_joint_order
from armid.measurement.columns.joint_name_comparison import stated_joints
from armid.measurement.joint_states import Publisher, joined
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.remedy import Remedy
from armid.robot import load_robot
from armid.study.remedy_translation import as_option

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
SEVEN = ("base", "upperarm", "forearm", "wr1", "wr2", "wr3", "flange")
IIWA = load_robot("iiwa14-r820")


def columns(joints: Sequence[str], form: str = "{joint}_{quantity}") -> list[str]:
    quantities = ("position", "velocity", "effort")
    return ["time", *(form.format(joint=joint, quantity=quantity) for quantity in quantities for joint in joints)]


def read(joints: Sequence[str], log_format: LogFormat | None = None, form: str = "{joint}_{quantity}") -> Selection:
    return select(columns(joints, form), log_format or LogFormat(), Path("log.csv"), IIWA)


def effort_possible_in(names: Sequence[str]) -> Finding:
    found = select(["time", *names], LogFormat(), Path("log.csv"), IIWA).findings
    (finding,) = (each for each in found if each.code == "effort-possible")
    return finding


@pytest.mark.parametrize("form", ["{joint}_{quantity}", "{quantity}.{joint}", "actual_{quantity}/{joint}"])
def test_another_arms_names_are_listed_beside_the_arms(form: str):
    with pytest.raises(RecordingError) as caught:
        read(UR, form=form)
    positions = ", ".join(form.format(joint=joint, quantity="position") for joint in UR)
    expected = f"The log has positions {positions}; {IIWA.name} has A1, A2, A3, A4, A5, A6, A7: none match."
    assert expected in str(caught.value)
    assert "description of the recorded arm" in caught.value.remedy


def test_as_many_joints_are_not_read_by_their_order():
    with pytest.raises(RecordingError, match="none match") as caught:
        read(SEVEN)
    (part,) = [each for each in Remedy.read(caught.value.remedy).parts if not isinstance(each, str)]
    option = as_option(part.text)
    assert option is not None and f"q={','.join(f'{joint}_position' for joint in SEVEN)}" in option
    read(SEVEN, LogFormat(**part.keys))  # the lines that the error offers are accepted


def test_a_part_of_the_names_is_counted():
    with pytest.raises(RecordingError, match="4 of 7 match") as caught:
        read(("A1", "A2", "A3", "A4", "wrist", "hand", "flange"))
    assert "--lock A5 --lock A6 --lock A7" in caught.value.remedy


@pytest.mark.parametrize(
    "form", ["{joint}_{quantity}", "{quantity}.{joint}", "actual_{quantity}/{joint}", "/{joint}/{quantity}"]
)
def test_joints_without_a_column_are_named(form: str):
    with pytest.raises(
        RecordingError, match="No column holds the position of A7; the log has positions of 6"
    ) as caught:
        read([f"A{k}" for k in range(1, 7)], form=form)
    assert "--lock A7 " in caught.value.remedy and "--only A1,A2,A3,A4,A5,A6" in caught.value.remedy


def test_a_limb_whose_first_joint_was_not_recorded_is_selected_by_its_pattern():
    robot = load_robot("ur5e")
    with pytest.raises(RecordingError, match="No column holds the position of shoulder_pan_joint, shoul") as caught:
        select(columns(UR[3:]), LogFormat(), Path("log.csv"), robot)
    assert "--only 'wrist_*'" in caught.value.remedy
    select(columns(UR[3:]), LogFormat(), Path("log.csv"), robot.lock(UR[:3]))


def test_joints_without_effort_are_named():
    finding = effort_possible_in([name for name in columns([f"A{k}" for k in range(1, 8)]) if name != "A7_effort"])
    assert "not A7." in finding.evidence and "log the effort of A7" in finding.remedy


@pytest.mark.parametrize("torques", ["A{}_load", "m{}"])
def test_a_current_that_one_joint_lacks_does_not_hide_columns_that_may_hold_all_torques(torques: str):
    """Torques of all joints are no reason to log again or to lock the joint."""
    names = [f"A{k}_position" for k in range(1, 8)]
    names += [*(f"A{k}_current" for k in range(1, 7)), *(torques.format(k) for k in range(1, 8))]
    finding = effort_possible_in(names)
    assert Remedy.read(finding.remedy).keys == {"columns": {"effort": torques}}
    assert "torque or current" in finding.remedy and "lock" not in finding.remedy
    assert "not A7." in finding.evidence


def test_torque_of_some_joints_and_current_of_the_others_are_no_effort_of_all():
    names = [f"A{k}_position" for k in range(1, 8)]
    names += [*(f"A{k}_torque" for k in range(1, 5)), *(f"A{k}_current" for k in range(5, 8))]
    finding = effort_possible_in(names)
    assert "not A5, A6, A7." in finding.evidence and "log the effort of A5, A6, A7" in finding.remedy


def test_numbered_names_of_another_arm_are_a_warning():
    (finding,) = read([f"panda_joint{k}" for k in range(1, 8)]).findings
    assert finding.severity == "warning" and "none match" in finding.evidence
    assert "to the joints by number" in finding.evidence
    with pytest.raises(RecordingError, match="none match"):
        read([f"panda_joint{k}" for k in range(1, 7)])


@pytest.mark.parametrize("name", ["joint{}", "axis_{}", "J{}", "A{}", "lbr_A{}"])
def test_numbers_alone_and_the_arms_own_names_are_read(name: str):
    assert [finding.severity for finding in read([name.format(k) for k in range(1, 8)]).findings] == ["info"]


def test_a_gripper_beside_numbered_joints_is_no_other_arm():
    assert len(read([*(f"joint{k}" for k in range(1, 8)), "left_finger", "right_finger"]).q) == 7


def test_named_channels_of_another_arm():
    q = np.zeros((5, 6))
    with pytest.raises(RecordingError, match="none match") as caught:
        in_joint_order(Recording(time=np.arange(5.0), q=q, joint_names=UR), LogFormat(), IIWA)
    assert "description of the recorded arm" in caught.value.remedy


def test_joint_states_of_another_arm():
    with pytest.raises(RecordingError, match="none match"):
        joined([Publisher(UR)], IIWA.joint_names, (), Path("bag"), "/joint_states")


def test_the_joint_is_what_the_quantity_leaves_of_a_name():
    assert stated_joints(["wrist_1_joint_position", "position.elbow", "shoulderPos [deg]", "tool_x"], "q") == {
        "wrist_1_joint": "wrist_1_joint_position",
        "elbow": "position.elbow",
        "shoulder": "shoulderPos [deg]",
    }


def test_columns_are_shown_as_they_are_called():
    names = ["hip_roll_angle", "hip_pitch_angle", "knee_angle", "elbow_yaw_angle"]
    with pytest.raises(RecordingError, match="none match") as caught:
        select(
            ["time", *names, *(name.replace("angle", "torque") for name in names)], LogFormat(), Path("log.csv"), IIWA
        )
    assert f"The log has positions {', '.join(names)};" in str(caught.value)

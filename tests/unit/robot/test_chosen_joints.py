"""One arm of many: joints that are chosen by names, patterns or the tip, and joints that follow others."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from armid.cli.main import app
from armid.cli.options import robot_choice
from armid.errors import ArmidError, RobotError
from armid.excitation.limits.joint_limits import limits_of
from armid.export.input_digest_check import find_source
from armid.export.write import export_run
from armid.maths.inertia import vector_to_com_inertia
from armid.robot import load_robot
from armid.robot.loading import held_of
from armid.robot.readers.urdf import outline
from armid.study.config import load_choice, parse_robot
from armid.toml_writing import to_toml
from exports import run_of

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'


def joint(name, parent, child, kind="revolute", inside="", lower=-1.0, upper=2.0):
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="3" effort="4"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 0 0.3"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/>{limit}{inside}</joint><link name="{child}">{INERTIAL.format(len(child))}</link>'
    )


MIMIC = '<mimic joint="{}" multiplier="{}" offset="{}"/>'

TWO_ARMS = (
    '<robot name="two"><link name="world"/>'
    + joint("root", "world", "base", "floating")
    + joint("torso", "base", "chest", "prismatic", lower=0.1, upper=0.4)
    + "".join(
        joint(f"{side}_1", "chest", f"{side}_upper")
        + joint(f"{side}_2", f"{side}_upper", f"{side}_fore", lower=0.5)
        + joint(f"{side}_finger", f"{side}_fore", f"{side}_tip", "prismatic", lower=0.0, upper=0.1)
        + joint(f"{side}_other", f"{side}_fore", f"{side}_pad", "prismatic", MIMIC.format(f"{side}_finger", -1, 0.02))
        for side in ("left", "right")
    )
    + "</robot>"
)


@pytest.fixture
def two(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(TWO_ARMS)
    return path


LEFT = ("left_1", "left_2")


@pytest.mark.parametrize(
    "chosen",
    [
        {"tip": "left_fore"},
        {"only": ["left_[12]"]},
        {"only": "left_?"},
        {"lock": ["root", "torso", "right_*", "*_finger"]},
        {"only": ["left_*"], "lock": {"left_finger": 0.0, "left_other": 0.02}},
        {"tip": "left_tip", "lock": "left_finger"},
        {"tip": "right_pad", "only": "left_[12]"},
    ],
    ids=str,
)
def test_several_ways_to_the_same_arm(two, chosen):
    robot = load_robot(two, **chosen)
    assert set(LEFT) == set(robot.joint_names) - {"torso"}
    assert ("torso" in robot.joint_names) == ("tip" in chosen and "only" not in chosen)
    assert robot.tip.name == chosen.get("tip", robot.tip.name)


def test_held_joints_are_those_of_an_arm_locked_by_hand(two):
    """Masses and places of what is held do not depend on how it was said; held within the limits, nearest to zero."""
    by_hand = load_robot(
        two,
        locked={"root": 0.0, "torso": 0.1, "right_1": 0.0, "right_2": 0.5, "right_finger": 0.0, "right_other": 0.02,
                "left_finger": 0.0, "left_other": 0.02},
    )  # fmt: skip
    by_pattern = load_robot(two, only=["left_[12]"])
    assert by_hand.joint_names == by_pattern.joint_names == LEFT
    for field in ("parent", "axis", "rotation", "translation"):
        np.testing.assert_array_equal(getattr(by_hand.tree, field), getattr(by_pattern.tree, field))
    np.testing.assert_allclose(by_hand.inertial_vector, by_pattern.inertial_vector, rtol=1e-15)
    held = held_of(two, only=["left_[12]"])
    assert held["torso"] == 0.1 and held["right_2"] == 0.5 and held["right_other"] == 0.02
    mass = vector_to_com_inertia(by_pattern.inertial_vector[1])[0]
    assert mass == len("left_fore") + len("left_tip") + len("left_pad")


def test_what_was_held_is_said(two):
    found = {finding.code: finding for finding in load_robot(two, only=["left_[12]"]).findings}
    assert found["joints-held"].severity == "info"
    assert "torso at 0.1" in found["joints-held"].evidence and "right_2 at 0.5" in found["joints-held"].evidence
    locked = (
        "are locked, 2 of them because they mimic others, at position 0 unless the list shows another (rad or m): "
    )
    assert locked in found["joints-held"].evidence
    assert not found["joints-held"].remedy
    assert "left_other at 0.02" in found["joint-follows"].evidence
    by_tip = {finding.code: finding for finding in load_robot(two, tip="left_fore").findings}
    assert "--lock" in by_tip["joints-held"].remedy  # the torso is on the way
    assert not {"joints-held"} & {finding.code for finding in load_robot(two, lock=["root"]).findings}


def test_joints_that_were_locked_by_name_count_among_those_that_are_held(two):
    robot = load_robot(two, only=["left_[12]"], lock=["root", "right_2=0.4"])
    (said,) = (finding.evidence for finding in robot.findings if finding.code == "joints-held")
    every = load_robot(two, lock=["root"])
    joints = len({*every.described_joints, "root"} | {held.name for held in every.held})
    assert said.startswith(f"2 of {joints} joints move; the other {joints - 2} are locked"), said
    assert "root, right_2 at 0.4 (by name), " in said and said.count("right_2") == 1


def test_a_locked_joint_is_not_said_to_be_missing(two):
    robot = load_robot(two, only=["left_[12]"], lock=["root", "right_2"])
    with pytest.raises(RobotError, match="'right_2' of two is locked and does not move") as caught:
        limits_of(robot, {("right_2", "position"): (-1.0, 1.0)})
    assert "left_1, left_2" in caught.value.possible and "do not lock it" in caught.value.remedy
    with pytest.raises(RobotError, match="has no joint 'right_9'"):
        robot.joint_index("right_9")


def test_a_position_outside_of_the_limits_is_said(two):
    """And a joint locked without a position is held inside of them, with the value beside its name."""
    found = {each.code: each for each in load_robot(two, only=["left_[12]"], lock=["torso=9"]).findings}
    assert (
        found["lock-outside-limits"].channel == "torso"
        and "locked at 9, outside" in found["lock-outside-limits"].evidence
    )
    assert "torso at 9 (by name)" in found["joints-held"].evidence
    kept = {each.code: each for each in load_robot(two, only=["left_[12]"], lock=["torso"]).findings}
    assert "lock-outside-limits" not in kept and "torso at 0.1 (by name)" in kept["joints-held"].evidence


def test_a_follower_of_a_joint_that_moves_is_held_and_said(two):
    robot = load_robot(two, lock={"root": 0.0, "right_finger": 0.05})
    assert "left_finger" in robot.joint_names and not any("other" in name for name in robot.joint_names)
    moving, held = [finding for finding in robot.findings if finding.code == "joint-follows"]
    assert moving.channel == "left_finger" and "the model keeps them locked" in moving.evidence
    assert "right_other at -0.03" in held.evidence and "move with it" not in held.evidence


def test_a_row_of_followers(tmp_path):
    path = tmp_path / "row.urdf"
    inside = [MIMIC.format("a", 2, 0.1), MIMIC.format("b", 3, 0), MIMIC.format("gone", 1, 0.3)]
    path.write_text(
        '<robot name="row"><link name="base"/>'
        + joint("a", "base", "A")
        + joint("b", "A", "B", inside=inside[0])
        + joint("c", "B", "C", inside=inside[1])
        + joint("d", "A", "D", inside=inside[2])
        + joint("e", "A", "E")
        + "</robot>"
    )
    assert held_of(path, lock={"a": 0.2}) == pytest.approx({"a": 0.2, "b": 0.5, "c": 1.5, "d": 0.3})
    assert load_robot(path).joint_names == ("a", "e")


MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="base"><freejoint name="free"/>
<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>
<body name="one"><joint name="turn" axis="0 0 1" range="0.2 1"/>INERTIAL
<body name="two"><joint name="bend" axis="0 1 0"/><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/>
<site name="hand" pos="0 0 1"/>
<body name="l"><joint name="l" type="slide" ref="0.1" range="0.3 0.5"/>INERTIAL
</body><body name="r"><joint name="r" type="slide" ref="0.2"/>INERTIAL</body>
</body></body></body></worldbody><equality>EQUALITY</equality></mujoco>"""
BODY = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
TIED = '<joint joint1="r" joint2="l" polycoef="0.01 2 3 0 0"/>'


def mjcf(tmp_path, equality):
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.replace("INERTIAL", BODY).replace("EQUALITY", equality))
    return path


def test_mjcf_by_body_and_by_site(tmp_path):
    path = mjcf(tmp_path, TIED)
    with pytest.raises(RobotError, match=r"joint 'free' is of kind 'free'(.|\n)*--lock free(.|\n)*--tip LINK"):
        load_robot(path)
    assert load_robot(path, tip="two").joint_names == load_robot(path, tip="hand").joint_names == ("turn", "bend")
    held = held_of(path, only=["bend"])
    # r - 0.2 = 0.01 + 2 (l - 0.1) + 3 (l - 0.1)² with l at 0.3, next to zero within its range.
    assert held == pytest.approx({"free": 0.0, "turn": 0.2, "l": 0.3, "r": 0.2 + 0.01 + 0.4 + 0.12})


def test_all_joints_to_lock_are_named_at_once(tmp_path):
    path = mjcf(tmp_path, TIED)
    box = f'<body name="box"><freejoint name="loose"/>{BODY}</body>'
    path.write_text(path.read_text().replace("</worldbody>", f"{box}</worldbody>"))
    with pytest.raises(RobotError, match="'free', 'loose' do not have exactly one") as caught:
        load_robot(path)
    assert "--lock free,loose" in caught.value.remedy
    assert load_robot(path, lock=["free", "loose"]).n == load_robot(path, only=["turn", "bend", "l"]).n == 3


def test_a_part_of_an_mjcf_says_that_it_is_one(tmp_path):
    path = tmp_path / "part.xml"
    path.write_text("<mujocoinclude><body/></mujocoinclude>")
    with pytest.raises(RobotError, match="give the file that includes it"):
        load_robot(path)


def test_a_joint_tied_to_a_constant(tmp_path):
    path = mjcf(tmp_path, '<joint joint1="r" polycoef="0.03"/>')
    assert held_of(path, lock=["free"]) == pytest.approx({"free": 0.0, "r": 0.23})


@pytest.mark.parametrize("kind", ["connect", "weld"])
def test_a_loop_stands_in_nobodys_way_where_nothing_of_it_moves(tmp_path, kind):
    path = mjcf(tmp_path, f'<{kind} body1="l" body2="r" anchor="0 0 0"/>')
    with pytest.raises(RobotError, match="closes a loop over l, r") as caught:
        load_robot(path, lock=["free"])
    assert "--tip LINK" in caught.value.remedy
    assert load_robot(path, tip="two").joint_names == ("turn", "bend")


def test_what_drags_the_hand_of_a_simulation_is_no_loop(tmp_path):
    path = mjcf(tmp_path, '<weld body1="handle" body2="two"/>')
    path.write_text(path.read_text().replace("<worldbody>", '<worldbody><body name="handle" mocap="true"/>'))
    robot = load_robot(path, lock=["free"])
    assert robot.joint_names == ("turn", "bend", "l", "r")
    assert [f.channel for f in robot.findings if f.code == "mocap-ignored"] == ["handle - two"]
    path.write_text(path.read_text().replace(' mocap="true"', ""))
    with pytest.raises(RobotError, match="closes a loop over bend, turn"):
        load_robot(path, lock=["free"])


def test_a_tendon_couples_only_joints_that_move(tmp_path):
    path = mjcf(tmp_path, '<tendon tendon1="pull"/>')
    tendon = '<tendon><fixed name="pull"><joint joint="l" coef="1"/><joint joint="r" coef="-1"/></fixed></tendon>'
    path.write_text(path.read_text().replace("<equality>", f"{tendon}<equality>"))
    with pytest.raises(RobotError, match="'tendon', which couples l, r"):
        load_robot(path, lock=["free"])
    assert load_robot(path, tip="two").joint_names == ("turn", "bend")


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"only": ["leg_*"]}, r"no joint that matches 'leg_\*' to move(.|\n)*left_1, left_2"),
        ({"lock": ["root", "lefty_*"]}, r"no joint that matches 'lefty_\*' to lock(.|\n)*Possible: root"),
        ({"lock": ["root", "tosro"]}, r"no joint 'tosro' to lock(.|\n)*did you mean 'torso'"),
        ({"tip": "left_for"}, r"no frame 'left_for' for the tip(.|\n)*did you mean 'left_fore'"),
        ({"tip": "base"}, r"all of its .* joints are locked"),
        ({"lock": ["*"]}, r"all of its .* joints are locked"),
        ({"lock": ["torso=low"]}, r"'low' is not a number"),
    ],
    ids=str,
)
def test_what_fits_nothing_is_refused_with_what_there_is(two, chosen, message):
    with pytest.raises(RobotError, match=message):
        load_robot(two, **chosen)


def test_a_name_goes_before_a_pattern_and_a_later_pattern_before_an_earlier_one(two):
    held = held_of(two, lock={"left_1": 0.4, "*_1": 0.2, "right_*": 0.05, "root": 0.0})
    assert (held["left_1"], held["right_1"], held["right_2"]) == (0.4, 0.05, 0.05)


def test_a_study_and_the_command_line_say_the_same(two):
    table = {"description": str(two), "only": ["left_*"], "lock": ["left_finger=0.03"]}
    study = load_choice(parse_robot(table))
    assert study.joint_names == LEFT
    former = load_choice(parse_robot({"description": str(two), "locked": {"root": 0.0, "right_*": 0.0}}))
    assert "torso" in former.joint_names
    assert "only" in to_toml({"robot": table})
    options = ["--only", "left_*", "--lock", "left_finger=0.03", "--json"]
    result = CliRunner().invoke(app, ["base", str(two), *options])
    assert result.exit_code == 0, result.output
    names = json.loads(result.stdout)["removed"] + json.loads(result.stdout)["zero_columns"]
    assert {name.rpartition("_")[2] for name in names} == {"1", "2"}


@pytest.mark.parametrize("chosen", [{"only": ["left_[12]"]}, {"tip": "left_fore", "lock": ["torso"]}], ids=str)
def test_a_run_remembers_the_choice(two, tmp_path, chosen):
    """The choice of a study is found again in the run's record, for an export, say, without a word."""
    run = run_of(tmp_path / "run", two, locked=held_of(two, **chosen))
    record = tmp_path / "run" / "study.json"
    robot = {"description": str(two), "gravity": None, "lock": [], "tip": None, "only": [], **chosen}
    record.write_text(json.dumps({"robot": robot, "folder": ".", "recordings": []}))
    assert set(find_source(run).locked) == set(load_outline(two)) - set(LEFT)
    exported = export_run(run, "urdf", tmp_path / "out.urdf")
    assert exported.edited and all(check.ok for check in exported.checks)
    again = load_robot(tmp_path / "out.urdf", **chosen)
    wanted = run.estimate.fit.standard.values[run.model.inertial_columns].reshape(-1, 10)
    assert again.inertial_vector == pytest.approx(wanted, abs=1e-9)


def load_outline(path):
    return outline(path.read_text(), source=str(path)).names


def test_many_held_joints_are_counted(tmp_path):
    path = tmp_path / "many.urdf"
    chain = "".join(joint(f"j{k}", f"l{k}", f"l{k + 1}", lower=0.2 if k == 30 else -1.0) for k in range(40))
    path.write_text(f'<robot name="many"><link name="l0"/>{chain}</robot>')
    (found,) = [f for f in load_robot(path, only="j1").findings if f.code == "joints-held"]
    assert "the other 39 are locked" in found.evidence
    assert "j30 at 0.2" in found.evidence and found.evidence.endswith("and 34 more")
    assert len(found.evidence) < 240  # two lines of a terminal


def test_commas_and_repeated_options(two):
    for options in (
        ["--lock", "root,torso=0.2,right_*"],
        ["--lock", "root", "--lock", "torso=0.2", "--lock", "right_*"],
    ):
        result = CliRunner().invoke(app, ["base", str(two), *options, "--only", "left_1,left_2", "--json"])
        assert result.exit_code == 0, result.output
    with pytest.raises(ArmidError, match="--tip-box"):
        robot_choice(str(two), None, None, tip="0,0,0,1,1,1")


def test_limits_by_pattern(two):
    robot = load_robot(two, only=["left_[12]"])
    limits = limits_of(robot, {("left_1", "velocity"): 0.5, ("*", "velocity"): 0.8, ("left_?", "effort"): 7.0})
    assert limits.velocity.tolist() == [0.5, 0.8] and limits.effort.tolist() == [7.0, 7.0]
    with pytest.raises(ArmidError, match="no joint 'leg_"):
        limits_of(robot, {("leg_*", "velocity"): 0.5})


def test_one_option_where_no_joint_has_a_velocity_limit(tmp_path):
    path = mjcf(tmp_path, TIED)
    path.write_text(path.read_text().replace('name="bend"', 'name="bend" range="-1 1"'))
    with pytest.raises(ArmidError) as caught:
        limits_of(load_robot(path, tip="two"))
    assert "--limit '*.velocity=1.0'" in caught.value.remedy
    assert limits_of(load_robot(path, tip="two"), {("*", "velocity"): 1.0}).velocity.tolist() == [1.0, 1.0]

"""Bodies of neighbouring links that overlap as they are drawn, and start poses that are hard to find."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.collision.closest_approach import ClosestApproach
from armid.excitation.collision.collision_model import make_collision_model
from armid.excitation.collision.ignored_pairs import ignored_of_srdf, parse_ignored
from armid.excitation.collision.required_distances import LEFT_OUT
from armid.excitation.collision.unchecked_contacts import EVERY, contacts_found, left_out_contacts
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.preflight import Preflight
from armid.excitation.start_pose import TorqueHolds, choose_start
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.preflight_page import render_preflight
from armid.robot import Robot, load_robot
from armid.robot.collision_body_names import BodyPair
from armid.study.plans.design import design_plan
from armid.study.plans.design_options import DesignConstraints, DesignGoal, SearchBudget
from armid.study.plans.design_writing import plan_record
from armid.study.plans.poses_and_sweeps import MovesGoal, design_moves
from armid.study.plans.preflight_text import mark_of, report_record, report_text
from armid.study.plans.start_pose_and_bodies import place_motion

pytestmark = pytest.mark.collision


def wheel(folder: Path, share: float) -> Robot:
    """Two links on one axis, two joints apart, whose bodies overlap in a share of all poses."""
    radius = 0.1 * math.sin(0.5 * math.pi * share)
    body = f'<collision><origin xyz="0.1 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="-{3}" upper="{3}" velocity="1" effort="9"/></joint>'
    )
    text = (
        f'<robot name="wheel"><link name="hub">{body}</link><link name="between"/><link name="rim">{body}</link>'
        + joint.format("one", "hub", "between", math.pi)
        + joint.format("two", "between", "rim", math.pi)
        + "</robot>"
    )
    path = folder / "wheel.urdf"
    path.write_text(text)
    return load_robot(path)


@pytest.mark.parametrize(
    ("share", "pose", "left_out"), [(0.82, 0.0, True), (0.82, math.pi, False), (0.6, math.pi, False)]
)
def test_neighbours_whose_bodies_overlap_in_most_poses_and_in_the_given_one_are_left_out_with_a_finding(
    tmp_path, share, pose, left_out
):
    robot = wheel(tmp_path, share)
    limits = limits_of(robot)
    start = np.array([pose, 0.0]) - 0.05
    placed = place_motion(robot, limits, DesignConstraints(clearance=0.005), start)
    findings = [each for each in placed.findings if each.code == "pairs-touching-mostly"]
    assert len(findings) == left_out
    if left_out:
        assert "hub - rim (8" in findings[0].evidence
        assert abs(placed.collision.skipped[0].share - share) < 0.1


@pytest.mark.parametrize(("share", "left_out"), [(0.75, False), (0.94, True)])
def test_neighbours_that_overlap_in_most_poses_are_kept_apart_where_that_leaves_a_start_with_room(
    tmp_path, share, left_out
):
    """Others are left out with a finding; those that are kept apart do not overlap in the start pose."""
    robot = wheel(tmp_path, share)
    placed = place_motion(robot, limits_of(robot), DesignConstraints(clearance=0.005), None)
    assert [each.code for each in placed.findings].count("pairs-touching-mostly") == left_out
    assert left_out or abs(placed.start.sum()) > share * math.pi  # angle from which on the spheres are apart


def test_a_start_pose_far_from_the_usual_one_is_found(tmp_path):
    """Only poses beyond those that are looked at first can be held."""
    robot = wheel(tmp_path, 0.3)
    limits = limits_of(robot)
    cell = make_collision_model(robot, limits)
    found = choose_start(cell, limits, lambda q: q[:, 0] > 2.3)
    assert found.pose[0] > 2.3 and cell.excess_distance(found.pose[None])[0] > 0.0


def test_where_no_start_pose_is_found_the_error_says_what_stands_in_the_way(tmp_path):
    """Shares of random poses by joint and by pair, and the options that help."""
    robot = wheel(tmp_path, 0.6)
    limits = limits_of(robot)
    cell = make_collision_model(robot, limits)
    far = TorqueHolds(("one", "two"), lambda q: np.column_stack([np.full(len(q), 2.0), np.zeros(len(q))]), 0.9)
    with pytest.raises(ArmidError) as caught:
        choose_start(cell, limits, far)
    text = str(caught.value)
    assert "100 % need too much torque (one 100 %)" in text
    assert re.search(r"in [67]\d % bodies are too close \(hub - rim [67]\d %: \d+\.\d mm required, 0\.0 to ", text)
    for option in ("--start", "JOINT.effort=VALUE", "--ignore-pair A,B", "--srdf FILE", "a smaller --clearance"):
        assert option in text


@pytest.mark.parametrize("given", [("hub,rim",), ("r*,h?b",)])
def test_pairs_are_left_out_by_name_or_pattern(tmp_path, given):
    robot = wheel(tmp_path, 0.6)
    limits = limits_of(robot)
    rules = DesignConstraints(clearance=0.005, ignored=tuple(map(parse_ignored, given)))
    placed = place_motion(robot, limits, rules, np.zeros(2))  # the bodies are in one another there
    assert [(each.pair, each.reason) for each in placed.collision.skipped] == [("hub - rim", "--ignore-pair")]
    assert [each.code for each in placed.findings if "hub - rim" in each.evidence] == ["pairs-ignored"]


def test_an_srdf_says_what_is_left_out(tmp_path):
    robot = wheel(tmp_path, 0.6)
    path = tmp_path / "wheel.srdf"
    path.write_text(
        '<robot name="wheel"><disable_collisions link1="rim" link2="hub"/>'
        '<disable_collisions link1="x" link2="hub"/></robot>'
    )
    cell = make_collision_model(robot, limits_of(robot), ignored=ignored_of_srdf(path))
    assert cell.ignored == {0: "wheel.srdf"} and cell.required.of(LEFT_OUT).all()
    path.write_text('<robot name="wheel"/>')
    with pytest.raises(ArmidError, match="disables no collisions"):
        ignored_of_srdf(path)
    with pytest.raises(ArmidError, match=r"(?s)no body is called 'rin'.*hub, rim"):
        make_collision_model(robot, limits_of(robot), ignored=[parse_ignored("hub,rin")])
    with pytest.raises(ArmidError, match="these are not two names"):
        parse_ignored("hub")


@pytest.mark.parametrize(("given", "share"), [(("hub,rim",), 0.6), ((), 0.82)])
def test_pairs_that_are_left_out_and_touch_in_the_plan_are_named_with_the_time(tmp_path, given, share):
    """The wheel turns from one side to the other: its bodies meet where the sum of the angles is small enough."""
    robot = wheel(tmp_path, share)
    rules = DesignConstraints(clearance=0.005, ignored=tuple(map(parse_ignored, given)))
    start = np.zeros(2) - 0.05
    placed = place_motion(robot, limits_of(robot), rules, start)
    assert len(placed.collision.skipped) == 1
    times = np.linspace(0.0, 10.0, 2001)
    turning = np.column_stack([np.linspace(math.pi, 0.0, len(times)), np.zeros(len(times))])
    (contact,) = left_out_contacts(placed.collision, robot, times, turning)
    first = (1.0 - share) * 10.0  # bodies overlap below this share of half a turn
    assert first <= contact.time <= first + 2 * EVERY * times[1] and not contact.throughout
    assert contact.account.startswith("hub - rim (")
    finding = contacts_found([contact])
    assert finding is not None and (finding.code, finding.severity) == (
        "left-out-pairs-touch",
        "warning" if given else "info",
    )
    assert f"hub - rim ({'--ignore-pair' if given else '8'}" in finding.evidence
    assert f"at {contact.time:.2f} s" in finding.evidence
    apart = np.full((100, 2), 0.5 * math.pi) + 0.1
    assert left_out_contacts(placed.collision, robot, times[:100], apart) == ()
    (contact,) = left_out_contacts(placed.collision, robot, times[:100], np.zeros((100, 2)))
    assert contact.throughout and "all the time: hub - rim" in contacts_found([contact]).evidence


def test_a_plan_names_left_out_pairs_that_touch_in_it(tmp_path):
    robot = wheel(tmp_path, 0.6)
    model = DynamicsModel(robot, (RigidBody(),))
    rules = DesignConstraints(clearance=0.005, ignored=(parse_ignored("hub,rim"),))
    goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 10.0, 4, np.zeros(2))
    series = design_plan(goal, rules, SearchBudget(1e-3, 1, 0))
    moves = design_moves(model, MovesGoal("sweeps", start=np.zeros(2)), rules)
    for designed in (series, moves):  # they overlap in the start pose
        assert ("left-out-pairs-touch", "warning") in {(each.code, each.severity) for each in designed.findings}
        assert designed.preflight.touching[0].time == 0.0
        assert mark_of(designed.preflight) == "!" and report_text(designed).startswith("! ")
        assert "<b>! every limit holds" in render_preflight(designed)
        assert report_record(designed)["mark"] == plan_record(designed)["mark"] == "!"


def test_bodies_that_no_pose_keeps_apart_are_named_with_both_distances_and_the_options_to_take(tmp_path):
    """Three joints on one axis, so that the bodies are no neighbours; 8.5 mm are between them in every pose."""
    body = '<collision><origin xyz="0 0 {}"/><geometry><sphere radius="0.05"/></geometry></collision>'
    joints = "".join(
        f'<joint name="{k}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="9"/></joint>'
        for k in range(3)
    )
    path = tmp_path / "axle.urdf"
    path.write_text(
        f'<robot name="axle"><link name="link0">{body.format(0)}</link><link name="link1"/><link name="link2"/>'
        f'<link name="link3">{body.format(0.1085)}</link>{joints}</robot>'
    )
    robot = load_robot(path)
    cell = make_collision_model(robot, limits_of(robot))
    strict = replace(cell, required=replace(cell.required, margin=np.array([0.02])))
    with pytest.raises(ArmidError) as caught:
        choose_start(strict, limits_of(robot))
    text = str(caught.value)
    assert "link0 - link3 100 %: 20.0 mm required, 8.5 to 8.5 mm there" in text
    assert "--ignore-pair link0,link3" in text and "--clearance 0.008 (in metres)" in text
    assert choose_start(make_collision_model(robot, limits_of(robot), margin=0.008), limits_of(robot)).usual


def test_a_clearance_beyond_half_of_the_reach_is_refused():
    robot = load_robot("ur5e")
    with pytest.raises(ArmidError, match=r"(?s)is 5 m, but ur5e reaches only 1\.2 m.*5 mm are 0\.005"):
        make_collision_model(robot, limits_of(robot), margin=5.0)


def swinging(folder: Path, near: float, far: float) -> Robot:
    """Two bodies, two joints apart, whose distance is between two values [m] and turns about a common axis."""
    radius, offset = 0.03, 0.5 * (far - near)
    middle = 0.5 * (near + far) + 2.0 * radius
    body = '<collision><origin xyz="{0} 0 {1}"/><geometry><sphere radius="{2}"/></geometry></collision>'
    joint = (
        '<joint name="{0}" type="{3}"><origin xyz="0 0 {6}"/><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="{4}" upper="{5}" velocity="1" effort="9"/></joint>'
    )
    path = folder / "swinging.urdf"
    path.write_text(
        f'<robot name="swinging"><link name="low">{body.format(0, 0.5, radius)}</link><link name="between"/>'
        f'<link name="high">{body.format(0, middle, radius)}</link>'
        + joint.format("turn", "low", "between", "revolute", -3, 3, 0.5)
        + joint.format("slide", "between", "high", "prismatic", -offset, offset, 0)
        + "</robot>"
    )
    return load_robot(path)


@pytest.mark.parametrize("gap", [(0.004, 0.012), (0.02, 0.045), (0.0, 0.07), (0.0319, 0.032), (-0.02, 0.03)])
def test_a_larger_clearance_never_leads_to_a_smaller_required_distance(tmp_path, gap):
    """Up to the clearance by default, pairs that exceed it in a quarter of the poses keep all of it."""
    robot = swinging(tmp_path, *gap)
    asked = np.array([0.002, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.035, 0.04, 0.05, 0.07])
    models = [make_collision_model(robot, limits_of(robot), margin=margin) for margin in asked]
    assert all(len(cell.pairs) == 1 for cell in models)
    required = np.array([cell.required.margin[0] for cell in models])
    assert (np.diff(required) >= 0.0).all() and (required <= asked).all() and required[-1] < asked[-1]
    if np.quantile(gap, 0.75) > 0.02:
        np.testing.assert_array_equal(required[asked <= 0.02], asked[asked <= 0.02])


def test_pairs_that_are_closer_than_the_clearance_are_told():
    def approach(name: str, distance: float, asked: float) -> ClosestApproach:
        return ClosestApproach(BodyPair("arm", name), distance, 1.0, asked)

    far, kept, reduced = approach("far", 0.3, 0.04), approach("kept", 0.041, 0.017), approach("near", 0.018, 0.017)
    told = Preflight((), (far, kept, reduced), (), None, clearance=0.04)
    assert told.sentence == (
        "every limit holds, and bodies keep apart, 1 pair at 17.0 mm or more instead of the clearance of 40 mm"
    )
    assert told.reduced_clearance is not None and told.reduced_clearance.code == "clearance-reduced"
    assert "arm - near 18 mm (at least 17.0 mm required)" in told.reduced_clearance.evidence
    assert "kept" not in told.reduced_clearance.evidence
    whole = Preflight((), (far, kept), (), None, clearance=0.04)
    assert whole.sentence == "every limit holds, and bodies keep apart" and whole.reduced_clearance is None

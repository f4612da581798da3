"""Accounts of a plan: what was judged, what was not, with which units, from where."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from armid.excitation.collision.ignored_pairs import parse_ignored
from armid.excitation.design.objective import CriterionGoal
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.preflight_page import render_preflight
from armid.robot import load_robot
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.preflight_text import report_record, report_text

pytestmark = pytest.mark.collision

JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="0.2 0 0"/>
<axis xyz="0 {4}"/><limit lower="-1" upper="1" velocity="1"{5}/></joint>"""

BODY = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def planned(folder, *, effort="", inertial="", dynamics=""):
    """A plan of a turning, a sliding and a turning joint; the link after the first has no body."""
    effort = f' effort="{effort}"' if effort else ""
    path = folder / "arm.urdf"
    path.write_text(
        f'<robot name="arm"><link name="base">{BODY}</link><link name="bare">{inertial}</link>'
        f'<link name="slide">{BODY}{inertial}</link><link name="hand">{BODY}{inertial}</link>'
        + JOINT.format("turn", "revolute", "base", "bare", "0 1", effort).replace("<axis", f"{dynamics}<axis")
        + JOINT.format("slider", "prismatic", "bare", "slide", "1 0", effort)
        + JOINT.format("wrist", "revolute", "slide", "hand", "0 1", effort)
        + "</robot>"
    )
    model = DynamicsModel(load_robot(path), (RigidBody(),))
    goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 10.0, 4)
    rules = DesignConstraints(clearance=0.01, ignored=(parse_ignored("base,hand"),))
    return design_plan(goal, rules, SearchBudget(1e-3, 1, 0))


@pytest.fixture(scope="module")
def weightless(tmp_path_factory):
    return planned(tmp_path_factory.mktemp("weightless"))


def evidence(designed, code):
    """Evidence of all findings of a code."""
    return [each.evidence for each in designed.findings if each.code == code]


def test_torque_that_nothing_limits_is_said_not_to_be_judged(weightless, tmp_path):
    (said,) = evidence(weightless, "torque-unjudged")
    assert said == "no torque is checked, because no effort limit is given, and no mass is known"
    text, record = report_text(weightless), report_record(weightless)
    assert (
        "may use 100 % of each velocity limit; its torque is not checked" in text and record["torque_share"] is None
    )
    judged = planned(tmp_path, effort="90", inertial=INERTIAL)
    assert not evidence(judged, "torque-unjudged")
    assert (
        "only 90 % of each torque limit, because predicted torques are uncertain; the torque bounds"
        in report_text(judged)
    )
    assert "only 90 % of each torque limit" in render_preflight(judged)
    assert report_record(judged)["torque_share"] == pytest.approx(0.9)


def test_the_page_says_from_which_friction_the_drawn_torque_is_computed(tmp_path):
    made = planned(tmp_path, effort="90", inertial=INERTIAL, dynamics='<dynamics damping="2" friction="3"/>')
    page = render_preflight(made)
    assert "from its viscous friction (turn 2 N·m·s/rad), Coulomb friction (turn 3 N·m)" in page
    assert "without friction" not in page and "torque of the earlier run" not in page


def test_masses_that_are_missing_are_said_where_torque_is_not_judged(tmp_path):
    (said,) = evidence(planned(tmp_path, effort="90"), "torque-unknown")
    assert said.startswith("torque is not checked and not limited, because the description of arm has no masses")


def test_friction_that_takes_all_torque_is_said_and_the_other_joints_are_judged(tmp_path):
    made = planned(tmp_path, effort="90", inertial=INERTIAL, dynamics='<dynamics friction="85"/>')
    (said,) = evidence(made, "friction-beyond-effort")
    assert "as large as the 90 % of the effort limit" in said and said.endswith("turn (85 of 90 N·m)")
    assert {each.label for each in made.preflight.margins if each.limit == "torque"} == {"slider", "wrist"}


def test_links_without_bodies_are_named_in_one_finding(weightless):
    (said,) = evidence(weightless, "links-without-bodies")
    assert said.endswith(": bare")


def test_units_stand_with_each_joint(weightless):
    text = report_text(weightless)
    assert "torque noise of 1 N·m, 1 N, 1 N·m at" in text
    assert " N·m or N" not in text and " N·m or N" not in render_preflight(weightless)
    assert report_record(weightless)["torque_units"] == ["N·m", "N", "N·m"]


def test_the_start_pose_stands_in_every_account(weightless):
    start = "turn 0 rad, slider 0 m, wrist 0 rad"
    record = report_record(weightless)
    assert f"start pose: {start}\n" in report_text(weightless) and f"Start pose: {start}." in render_preflight(
        weightless
    )
    assert record["start"] == pytest.approx({"turn": 0.0, "slider": 0.0, "wrist": 0.0}, abs=1e-9)  # rounding of sums


def test_pairs_that_are_left_out_come_with_the_findings_that_say_so(weightless):
    text, page = report_text(weightless), render_preflight(weightless)
    for account in (text, page.replace('<span class="names">', "")):
        assert account.count("--ignore-pair: base - hand") == 1 and "info pairs-ignored" in account
    assert "info pairs-ignored: 1 pair of bodies is not checked, as requested: --ignore-pair (base - hand)" in text


def test_a_row_of_bodies_says_what_was_measured(weightless):
    assert {each["measured"] for each in report_record(weightless)["approaches"]} == {"bodies"}
    bounds = [each for each in report_record(weightless)["limits"] if each["limit"] == "collision"]
    assert bounds and all("as in the search" in each["measured"] for each in bounds)
    assert "mm; bodies)" in report_text(weightless)
    assert re.search(r"<td[^>]*>bodies</td>", render_preflight(weightless))


def test_the_headline_names_the_closest_approach_and_not_the_bodies_of_the_search(weightless):
    """Capsules and hulls are nearer than the bodies in them, here by 50 mm."""
    report = weightless.preflight
    report = replace(report, approaches=tuple(replace(a, distance=a.distance + 0.05) for a in report.approaches))
    nearest = min(report.approaches, key=lambda each: each.distance - each.required_distance)
    page = render_preflight(replace(weightless, preflight=report))
    head = page[: page.index("Every limit")]
    assert f"{1000 * nearest.distance:.0f} mm distance" in head and nearest.pair in head
    assert head.count("mm distance") == 1

"""Soft limits of a description: a plan keeps within them, and says so, unless the user gives other limits."""

from __future__ import annotations

import numpy as np
import pytest

from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import (
    described_limits,
    limits_of,
    limits_wider_than_described,
    soft_limits_used,
)
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.preflight_page import render_preflight
from armid.robot import load_robot
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.poses_and_sweeps import MovesGoal, design_moves
from armid.study.plans.preflight_text import report_text

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)
SOFT = '<safety_controller k_position="20" k_velocity="20" {}/>'


def arm(folder, **inside):
    """An arm of revolute joints limited to -1 and 2 rad, with a safety controller of these attributes each."""
    joints, links, parent = "", '<link name="base"/>', "base"
    for k, (name, attributes) in enumerate(inside.items()):
        controller = "" if attributes is None else SOFT.format(attributes)
        joints += (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
            f'<origin xyz="0.3 0 0"/><axis xyz="0 {k} 1"/>'
            f'<limit lower="-1" upper="2" velocity="2" effort="90"/>{controller}</joint>'
        )
        links += f'<link name="{name}_link">{INERTIAL}</link>'
        parent = f"{name}_link"
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joints}</robot>')
    return load_robot(path)


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    return arm(
        tmp_path_factory.mktemp("soft"),
        both='soft_lower_limit="-0.4" soft_upper_limit="0.5"',
        upper='soft_lower_limit="-3" soft_upper_limit="1.5"',
        outside='soft_lower_limit="-2" soft_upper_limit="3"',
        plain=None,
    )


def test_a_plan_is_limited_by_the_tighter_of_limits_and_soft_limits(soft):
    limits = limits_of(soft)
    assert limits.lower.tolist() == [-0.4, -1.0, -1.0, -1.0] and limits.upper.tolist() == [0.5, 1.5, 2.0, 2.0]
    described = described_limits(soft)  # checks of recordings ask where a joint can be
    assert described.lower.tolist() == [-1.0] * 4 and described.upper.tolist() == [2.0] * 4


def test_joints_that_soft_limits_bound_are_named_with_both_ranges(soft):
    finding = soft_limits_used(soft, limits_of(soft))
    assert finding is not None and (finding.code, finding.severity) == ("soft-limits", "info")
    assert finding.evidence.endswith("both -0.4 to 0.5 rad (limit: -1 to 2), upper -1 to 1.5 rad (limit: -1 to 2)")
    assert "--limit" in finding.remedy


def test_given_limits_replace_soft_ones(soft):
    limits = limits_of(soft, {("both", "position"): (-0.9, 1.9), ("upper", "position"): (-0.2, 0.2)})
    assert limits.lower.tolist()[:2] == [-0.9, -0.2] and limits.upper.tolist()[:2] == [1.9, 0.2]
    assert soft_limits_used(soft, limits) is None


@pytest.mark.parametrize(
    ("attributes", "told"),
    [
        ("", False),
        ('soft_upper_limit="1"', False),
        ('soft_lower_limit="0" soft_upper_limit="0"', True),
        ('soft_lower_limit="1" soft_upper_limit="-1"', True),
        ('soft_lower_limit="2.5" soft_upper_limit="3"', True),
    ],
)
def test_soft_limits_that_leave_no_range_are_not_used(tmp_path, attributes, told):
    robot = arm(tmp_path, j=attributes)
    limits = limits_of(robot)
    assert (limits.lower[0], limits.upper[0]) == (-1.0, 2.0) and soft_limits_used(robot, limits) is None
    assert [each.code for each in robot.findings if "soft" in each.evidence] == ["limits-unknown"] * told


def test_soft_limits_of_a_continuous_joint_are_not_used(tmp_path):
    path, controller = tmp_path / "wheel.urdf", SOFT.format('soft_lower_limit="-1" soft_upper_limit="1"')
    path.write_text(
        f'<robot name="wheel"><link name="base"/><link name="rim">{INERTIAL}</link><joint name="turn" '
        'type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 0 1"/><limit velocity="2" '
        f'effort="9"/>{controller}</joint></robot>'
    )
    robot = load_robot(path)
    assert robot.joints[0].kind == "continuous" and limits_of(robot).upper[0] == np.inf


def test_designed_motions_stay_within_soft_limits_and_say_so(soft):
    model = DynamicsModel(soft, (RigidBody(),))
    goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 10.0, 4)
    series = design_plan(goal, DesignConstraints(), SearchBudget(1e-3, 1, 0))
    poses = design_moves(model, MovesGoal("poses", 4), DesignConstraints())
    for designed, q in ((series, series.plan.sample(200.0).q), (poses, poses.plan.poses)):
        assert (q >= designed.limits.lower - 1e-9).all() and (q <= designed.limits.upper + 1e-9).all()  # rounding
        assert designed.limits.upper.tolist() == [0.5, 1.5, 2.0, 2.0]
        assert "soft-limits" in {finding.code for finding in designed.findings}
        assert "keeps within them: both -0.4 to 0.5 rad" in report_text(designed)


def test_limits_wider_than_described_are_named_with_both_values(soft):
    given = {
        ("both", "position"): (-0.9, 2.5),
        ("both", "velocity"): 3.0,
        ("upper", "effort"): 100.0,
        ("plain", "position"): (-1.0, 2.0),
        ("plain", "effort"): 90.0,
        ("outside", "velocity"): 1.0,
    }
    finding = limits_wider_than_described(soft, limits_of(soft, given))
    assert finding is not None and finding.severity == "warning" and finding.channel == "both, upper"
    assert finding.evidence.endswith(
        "both: position -0.9 to 2.5 rad (described: -1 to 2), velocity 3 rad/s (described: 2); "
        "upper: effort 100 N·m (described: 90)"
    )
    assert limits_wider_than_described(soft, limits_of(soft)) is None
    assert limits_wider_than_described(soft, limits_of(soft, {("both", "position"): (-0.9, 1.9)})) is None


@pytest.mark.parametrize("kind", ["series", "sweeps"])
def test_the_verdict_of_a_plan_says_that_limits_are_wider_than_described(soft, kind):
    model = DynamicsModel(soft, (RigidBody(),))
    constraints = DesignConstraints(given={("plain", "velocity"): 2.5})
    if kind == "series":
        goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 10.0, 4)
        designed = design_plan(goal, constraints, SearchBudget(1e-3, 1, 0))
    else:
        designed = design_moves(model, MovesGoal(kind), constraints)
    assert [f.severity for f in designed.findings if f.code == "limit-beyond-description"] == ["warning"]
    assert "; limits of plain are wider than described" in designed.preflight.sentence
    assert designed.preflight.verdict != "fail" and not report_text(designed).startswith("✓")
    assert '<p class="verdict pass">' not in render_preflight(designed)

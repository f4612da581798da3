"""Bodies that keep joints well below their limits are named, with the cost and the options that release them."""

from __future__ import annotations

import numpy as np
import pytest

from armid.excitation.design.objective import CriterionGoal
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.study.plans.design import design_plan
from armid.study.plans.design_options import DesignConstraints, DesignGoal, SearchBudget

MASS = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    """Plans of an arm between two walls that leave 40 degrees and nowhere else to start, with and without them."""
    rod = '<collision><origin xyz="0.3 0 0"/><geometry><box size="0.5 0.02 0.02"/></geometry></collision>'
    wall = '<collision><origin xyz="0 {} 0"/><geometry><box size="1.2 0.8 2"/></geometry></collision>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>'
        '<axis xyz="{4}"/><limit lower="-2" upper="2" velocity="2" effort="90"/></joint>'
    )
    away = 0.4 + 0.5 * np.sin(0.35)
    path = tmp_path_factory.mktemp("walls") / "walls.urdf"
    path.write_text(
        f'<robot name="walls"><link name="base">{wall.format(away)}{wall.format(-away)}</link>'
        f'<link name="between">{MASS}</link><link name="arm">{MASS}{rod}</link>'
        + joint.format("tilt", "base", "between", 0, "0 1 0")
        + joint.format("turn", "between", "arm", 0, "0 0 1")
        + "</robot>"
    )
    model = DynamicsModel(load_robot(path), (RigidBody(),))
    goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 10.0, 4, np.zeros(2))
    return [
        design_plan(goal, DesignConstraints(clearance=margin), SearchBudget(None, 1, 0, rounds=1))
        for margin in (0.02, None)
    ]


@pytest.mark.collision
def test_the_pair_that_holds_a_joint_is_named_with_its_cost_and_options(plans):
    (found,) = [each for each in plans[0].findings if each.code == "motion-restrained"]
    assert "turn" in found.channel and found.severity == "warning"
    assert "the distance of arm - base" in found.evidence and "20.0 mm required" in found.evidence
    for option in ("--ignore-pair 'arm,base'", "--clearance below 0.02", "--start"):
        assert option in found.remedy


@pytest.mark.collision
def test_joints_that_come_up_to_their_limits_are_held_by_nothing(plans):
    assert not [each for each in plans[1].findings if each.code == "motion-restrained"]

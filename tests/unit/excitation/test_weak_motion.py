"""Plans that cannot identify an arm: which joints, why, and one verdict in every account."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.excitation.design.multistart import random_start
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.sqp import DescentProblem, about_start
from armid.excitation.limits.joint_limits import limits_of, motion_channels
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.start_pose import usual_pose
from armid.excitation.weak_motion import deviations_in_free_motion, weak_motion
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.preflight_page import render_preflight
from armid.robot import load_robot
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.preflight_text import report_record, report_text


def problem_of(name, **more):
    robot = load_robot(name)
    model = DynamicsModel(robot, (RigidBody(),))
    limits = limits_of(robot)
    basis = SeriesBasis(2.0 * np.pi / 20.0, 10, usual_pose(limits))
    goal = CriterionGoal(model, find_base_parameters(model), **more)
    return DescentProblem(goal, basis, motion_channels(limits)), limits


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14-r820"])
def test_random_motions_at_the_limits_identify_and_a_twentieth_of_them_does_not(name):
    problem, limits = problem_of(name)
    for seed in range(3):
        x = random_start(problem, problem.fine, np.random.default_rng(seed))
        assert weak_motion(problem, x, limits) is None
        small = weak_motion(problem, about_start(problem.basis, x, 0.05), limits)
        assert small is not None and small.code == "motion-weak" and small.severity == "warning"


def test_the_measure_depends_on_no_unit_of_noise_and_falls_with_repetitions():
    problem, limits = problem_of("ur5e")
    x = random_start(problem, problem.fine, np.random.default_rng(0))
    deviations = deviations_in_free_motion(problem, x, limits)
    for change, factor in ({"noise": np.full(6, 40.0)}, 1.0), ({"repetitions": 9}, 1.0 / 3.0):
        other = replace(problem, goal=replace(problem.goal, **change))
        # Rounding of an inverse whose condition number is some ten thousand.
        np.testing.assert_allclose(deviations_in_free_motion(other, x, limits), factor * deviations, rtol=1e-9)


def test_a_joint_that_hardly_moves_is_named_and_no_limit_is_blamed():
    """Neither the inertia of a shoulder that is not lifted nor that about the axis below can be told from others."""
    problem, limits = problem_of("ur5e")
    x = random_start(problem, problem.fine, np.random.default_rng(0)).reshape(6, -1).copy()
    x[1] *= 0.01
    found = weak_motion(problem, (0.6 * x).ravel(), limits, settled=False)
    assert found.channel == "shoulder_lift_joint, shoulder_pan_joint"
    assert "Slowest joints: shoulder_lift_joint 1 %" in found.evidence and "would exceed" not in found.evidence
    assert "the search reached its time limit" in found.evidence and "a longer --budget" in found.remedy


@pytest.fixture(scope="module")
def held():
    """A plan of an arm whose second joint can just hold it, without collision checks."""
    robot = load_robot("ur5e")
    model = DynamicsModel(robot, (RigidBody(),))
    start = np.array([0.0, -0.1, 0.1, 0.0, 0.5, 0.0])
    base = find_base_parameters(model)
    still = abs(model.gravity_torque(start[None], model.nominal_parameters()).ravel()[1])
    given = {("shoulder_lift_joint", "effort"): float(still / 0.97)}
    rules = DesignConstraints(given=given, torque_margin=0.0, clearance=None)
    goal = DesignGoal(CriterionGoal(model, base), 20.0, 10, start)
    return design_plan(goal, rules, SearchBudget(1e-3, 1, 0))


def test_every_account_says_what_a_weak_plan_is(held):
    """One verdict, one sentence and one finding on screen, in the text, on the page and in the record."""
    report, finding = held.preflight, held.preflight.weak
    assert report.verdict == "weak" and finding in held.findings
    assert "torque of shoulder_lift_joint" in finding.evidence
    assert "97 % of the torque limit of shoulder_lift_joint" in finding.evidence
    assert "--limit JOINT.effort=VALUE" in finding.remedy and "--start" in finding.remedy
    unchecked = "collisions not checked: the check was left out (--no-collision)"
    sentence = (
        f"every limit holds (torque without friction and rotor inertia); {unchecked}; but the motion is too weak"
    )
    text, page, record = report_text(held), render_preflight(held), report_record(held)
    assert text.startswith(f"! {sentence}") and "usable only up to 3" in text
    assert f'<p class="verdict fail"><b>! {sentence}' in page and "usable only up to 3" in page
    assert record["verdict"] == "weak" and record["said"].startswith(sentence)
    assert [each["code"] for each in record["findings"]].count("motion-weak") == 1

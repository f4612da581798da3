"""Remarks: a gravity that is none, a motion that tells little apart."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest

import cranes
from armid import DynamicsModel, accumulate_information, find_base_parameters, load_robot
from armid.checked_array import Array
from armid.doctor.checks.dynamics.excitation_weak import WEAK_CONDITION
from armid.errors import Finding
from armid.estimation.estimators import PhysicallyConsistent, WeightedLeastSquares
from armid.estimation.least_squares import solve
from armid.estimation.problem import EstimationProblem, standard_of
from armid.estimation.run_estimator import estimate
from armid.excitation.thesis_plans import builtin_plan
from armid.information.information import stack, total
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.maths.linalg import scaled_condition
from armid.maths.rotations import homogeneous, rotation_x
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import Robot
from armid.study.plausibility.estimate_findings import (
    excitation_finding,
    far_findings,
    gravity_finding,
    negative_finding,
    weak_finding,
)
from problems import one_run, raw


@cache
def measured() -> tuple[DynamicsModel, Motion, Array]:
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb()))
    motion = builtin_plan("thesis-a1").sample(50.0)
    return model, motion, model.torque(motion, thesis_truth(model))


def test_gravity_of_another_unit_is_remarked():
    robot = load_robot("ur5e")
    assert gravity_finding(robot) is None
    found = gravity_finding(robot.with_gravity((0.0, 0.0, -981.0)))
    assert found is not None and "981" in found.evidence


def test_a_motion_that_tells_little_apart_is_remarked():
    model, motion, torque = measured()
    base = find_base_parameters(model)
    torque = torque + 0.1 * np.random.default_rng(0).normal(size=torque.shape)
    whole = raw(one_run(motion, torque, 50.0))
    assert excitation_finding(accumulate_information(model, base, whole), model, whole) is None
    short = raw(one_run(motion[slice(0, 100)], torque[:100], 50.0))  # two seconds from rest
    found = excitation_finding(accumulate_information(model, base, short), model, short)
    assert found is not None and found.code == "excitation-weak"
    assert any(name in found.evidence for name in base.names)


def with_turned_frames(robot: Robot, angle: float) -> Robot:
    """The same arm with frames of the links that are turned about their x axes [rad]; the torque does not change."""
    turn = homogeneous(rotation_x(angle), [0.0, 0.0, 0.0])
    joints = tuple(
        replace(
            joint,
            axis=turn[:3, :3].T @ joint.axis,
            placement=(turn.T if joint.parent >= 0 else np.eye(4)) @ joint.placement @ turn,
        )
        for joint in robot.joints
    )
    return replace(robot, joints=joints)


@pytest.mark.parametrize("angle", [11.0, 14.0, 30.0])
def test_weak_excitation_does_not_depend_on_the_frames_of_the_links(angle: float):
    """Frames at odd angles give base parameters that no motion separates well; the motion is not to blame."""
    model, motion, torque = measured()
    turned = replace(model, robot=with_turned_frames(model.robot, math.radians(angle)))
    base = find_base_parameters(turned)
    assert base.count == find_base_parameters(model).count
    torque = torque + 0.1 * np.random.default_rng(0).normal(size=torque.shape)
    whole = raw(one_run(motion, torque, 50.0))
    information = accumulate_information(turned, base, whole)
    assert scaled_condition(stack(total(information))[0]) > WEAK_CONDITION
    assert excitation_finding(information, turned, whole) is None
    assert len(solve(information, np.ones(model.n)).values) == base.count
    short = raw(one_run(motion[slice(0, 100)], torque[:100], 50.0))
    assert excitation_finding(accumulate_information(turned, base, short), turned, short) is not None


@pytest.mark.parametrize("angle", [0.0, 14.0])
@pytest.mark.parametrize("amplitude", [0.0, 1e-4, 1e-3])
def test_a_joint_that_hardly_moves_is_weak_excitation_in_any_frames(angle: float, amplitude: float):
    """Its viscous and its smoothed Coulomb friction are the same function of time."""
    model, motion, _ = measured()
    robot = with_turned_frames(model.robot, math.radians(angle))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.02)))
    scale = np.where(np.arange(model.n) == 3, amplitude, 1.0)
    still = replace(motion, q=motion.q * scale, dq=motion.dq * scale, ddq=motion.ddq * scale)
    observations = raw(one_run(still, np.zeros_like(still.q), 50.0))
    information = accumulate_information(model, find_base_parameters(model), observations)
    assert excitation_finding(information, model, observations) is not None


def weak(
    seconds: float,
    prior: Literal["mass", "log-det"] | None,
    *,
    slowly: float = 1.0,
    chosen: bool = False,
    weight: float | Literal["auto"] = "auto",
):
    """Return what is remarked of so many seconds of the motion, with a prior or by plain least squares."""
    model, motion, _ = measured()
    part = motion[slice(100, 100 + int(50.0 * seconds))]
    part = Motion(part.time, slowly * part.q, slowly * part.dq, slowly * part.ddq)
    torque = model.torque(part, thesis_truth(model))
    torque = torque + 0.3 * np.random.default_rng(0).normal(size=torque.shape)
    base = find_base_parameters(model)
    observations = raw(one_run(part, torque, 50.0, block_rows=50))
    problem = EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base
    )
    method = WeightedLeastSquares() if prior is None else PhysicallyConsistent(prior=prior, weight=weight)
    fit = method.solve(problem)
    return weak_finding(problem.information, observations, fit, chosen=chosen)


def test_enough_motion_is_not_remarked_as_weak():
    assert weak(20.0, "mass") is None and weak(20.0, "log-det") is None and weak(20.0, None, chosen=True) is None


def test_what_refuses_weak_data_by_itself_is_not_remarked():
    assert weak(3.0, None) is None


def test_few_rows_are_remarked_with_what_to_record():
    """Half a second has 175 rows for 57 parameters, of which three each would be 171."""
    found = weak(0.4, "mass")
    assert found is not None and (found.code, found.severity) == ("weak-data", "warning")
    assert "140 rows are too few for 57 parameters" in found.evidence and "base parameters" in found.evidence
    assert "record 1 s or more instead of 0.4 s" in found.remedy


def test_few_blocks_are_remarked_where_segments_would_have_to_be_left_out():
    assert (found := weak(3.0, "log-det")) is not None
    assert "3 blocks of rows" in found.evidence and "the weight of the prior" in found.evidence
    assert "at least 5 are needed" in found.evidence and "record 5 s" in found.remedy
    given = weak(3.0, "log-det", weight=1.0)
    assert given is None or "blocks" not in given.evidence  # nothing had to be judged
    assert (found := weak(3.0, None, chosen=True)) is not None and found.severity == "warning"
    assert "select friction" in found.evidence
    assert "at least 8 are needed" in found.evidence and "record 8 s" in found.remedy
    assert "rows for each parameter" not in found.evidence


def test_a_motion_that_hardly_moves_is_remarked_however_long_it_is():
    """Twenty seconds within a hundredth of the range: the prior decides, and a longer recording would not help."""
    found = weak(20.0, "log-det", slowly=0.01)
    assert found is not None and "by the log-det prior and by physical constraints" in found.evidence
    assert "record" not in found.remedy and "fast and over a wide range" in found.remedy


def test_masses_that_nothing_says_are_named_with_the_prior_that_keeps_them():
    """Torques see no mass of the first link: by the mass prior it is next to none, by log-det the described one."""
    model, motion, torque = measured()
    base = find_base_parameters(model)
    observations = raw(one_run(motion, torque, 50.0, block_rows=50))
    problem = EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base
    )
    (light,) = far_findings(problem.standard, PhysicallyConsistent(prior="mass").solve(problem))
    assert "M_1" in light.evidence and 'prior = "log-det"' in light.remedy and "do not determine" in light.evidence
    assert far_findings(problem.standard, PhysicallyConsistent(prior="log-det").solve(problem)) == []
    assert far_findings(problem.standard, WeightedLeastSquares().solve(problem)) == []


def test_masses_that_the_data_determine_are_told_apart_from_those_they_do_not():
    """The slide's force shows the trolley's mass; no torque shows that of the tower, which turns about a vertical."""
    problem = cranes.problem()
    assert problem.standard is not None and problem.standard.nominal is not None
    trolley, nominal = problem.standard.inertial[1, 0], problem.standard.nominal.copy()
    nominal[trolley] /= 50.0
    described_too_light = replace(problem.standard, nominal=nominal)
    fit = PhysicallyConsistent(prior="mass").solve(problem)
    known, unknown = far_findings(described_too_light, fit)
    assert known.evidence.startswith("The data determine these masses, but") and "M_2" in known.evidence
    assert "M_1" not in known.evidence and "prior" not in known.remedy and "same arm" in known.remedy
    assert unknown.evidence.startswith("The data do not determine these masses") and "M_1" in unknown.evidence
    assert "M_2" not in unknown.evidence and 'prior = "log-det"' in unknown.remedy


def test_masses_are_looked_up_by_name_where_friction_has_copies():
    """Friction of two recordings stands among the standard parameters twice, so places are not those of the model."""
    model, motion, torque = measured()
    base = find_base_parameters(model)
    observations = raw(one_run(motion, torque, 50.0, block_rows=50))
    problem = EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base
    )
    fit = PhysicallyConsistent(prior="mass").solve(problem)
    alone, kept = far_findings(problem.standard, fit), fit.standard
    assert alone and kept is not None
    twice = replace(
        kept,
        names=("FV_1[1]", *kept.names),
        units=("N·m·s/rad", *kept.units),
        status=("identified", *kept.status),
        values=np.concatenate([[0.7], kept.values]),
        covariance=np.pad(kept.covariance, ((1, 0), (1, 0))),
        intervals=np.vstack([[0.6, 0.8], kept.intervals]),
        resolution=np.concatenate([[1.0], kept.resolution]),
    )
    assert far_findings(problem.standard, replace(fit, standard=twice)) == alone


def test_negative_friction_is_named_with_its_joint_and_a_possible_wrong_sign():
    model, motion, torque = measured()
    base = find_base_parameters(model)
    torque = torque + 0.1 * np.random.default_rng(0).normal(size=torque.shape)

    def found(signs: list[int]) -> Finding | None:
        observations = raw(one_run(motion, torque * np.array(signs), 50.0))
        problem = EstimationProblem(accumulate_information(model, base, observations), observations)
        return negative_finding(model, estimate(problem, WeightedLeastSquares()))

    finding = found([1, 1, 1, 1, -1, 1, 1])
    assert finding is not None and model.robot.joint_names[4] in finding.channel
    assert "FS_5" in finding.evidence and "wrong sign" in finding.evidence
    assert found([1] * 7) is None
    compensated = found([-1] * 7)
    assert compensated is not None and "without this compensation" in compensated.evidence

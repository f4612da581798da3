"""Torque of a run in the design of a motion: it is the torque that the run predicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.estimate_record import Estimate
from armid.estimation.fit_result import Fit
from armid.excitation.certification import fine_grid, margins
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.sqp import DescentProblem
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.memoryless_model import slipping
from armid.model.motion import Motion
from armid.model.terms import (
    Coulomb,
    Hysteresis,
    LoadCoulomb,
    LoadViscous,
    Offset,
    RigidBody,
    RotorInertia,
    Stribeck,
    Term,
    Viscous,
)
from armid.robot import load_robot
from armid.runs.design_torque_model import estimated_torque
from armid.runs.run import Run
from armid.runs.validation_and_prediction import predict
from armid.study.plans.design_options import DesignConstraints, constrained_limits
from armid.study.plans.poses_and_sweeps import CHECK_RATE, MovesGoal, design_moves
from armid.study.plans.torque_constraint import judged_torque, torque_lacks
from trees import random_states

ROUNDING = 1e-9
"""Relative error of torques that are sums of the same columns in another order."""

REVERSAL = 0.01
"""Largest relative excess of the predicted peak over that with hysteresis that slips at once: just after a reversal,
real hysteresis keeps the sign it had before, while the rest of the torque changes little."""

ROBOT = load_robot("ur5e")
DRIVES = (RigidBody(), Viscous(), Coulomb(0.02), Offset(), RotorInertia())
LADEN = (*DRIVES, Stribeck(), LoadCoulomb(0.02), LoadViscous())


def run_of(terms: tuple[Term, ...]) -> Run:
    """A run whose drives have as much inertia and friction as those of a geared arm."""
    load = ROBOT.inertial_vector if any(isinstance(term, LoadCoulomb) for term in terms) else None
    model = DynamicsModel(ROBOT, terms, load)
    rng = np.random.default_rng(5)
    sizes = {"RigidBody": 0.0, "rotor-inertia": 0.8, "load-coulomb": 0.05, "load-viscous": 0.05}
    theta = np.array([sizes.get(p.kind, 3.0) * rng.uniform(0.5, 1.0) for p in model.parameters])
    assert ROBOT.inertial_vector is not None
    theta[model.inertial_columns] = ROBOT.inertial_vector.ravel()
    base = find_base_parameters(model)
    b, n = base.count, model.n
    fit = Fit(
        base.names, base.values_of(theta), np.ones(b), np.eye(b), "white", 99.0, np.ones(n), np.full(n, 99), 1.0, 1.0
    )
    estimate = Estimate(ROBOT.name, "wls", (), base, fit)
    return Run("runs/geared", ROBOT, model, estimate, ProcessingOptions(), LogFormat(), ())


def goal() -> CriterionGoal:
    """A goal without rotor inertia, which the command line has by default."""
    model = DynamicsModel(ROBOT, (RigidBody(), Viscous(), Coulomb(), Offset()))
    return CriterionGoal(model, find_base_parameters(model))


def constraints(run: Run) -> DesignConstraints:
    """Limits of torque that the plan can use whatever its drives."""
    estimate = estimated_torque(run, ROBOT)
    assert estimate is not None
    given = {(name, "effort"): 400.0 for name in ROBOT.joint_names}
    return DesignConstraints(given=given, estimate=estimate)  # pyright: ignore[reportArgumentType]


def peaks(run: Run) -> tuple[Array, Array, str]:
    """Largest torque of each joint along a plan, as its certificate and as the run gives it; and what is said."""
    rules = constraints(run)
    torque, findings = judged_torque(goal(), constrained_limits(ROBOT, rules), rules)
    assert torque is not None and torque_lacks(ROBOT, rules, torque) == ""
    basis = SeriesBasis(2.0 * np.pi / 4.0, 3, np.array([0.0, -1.5, 1.0, -1.0, -1.5, 0.0]))
    x = 0.2 * np.random.default_rng(4).normal(size=basis.unknowns)
    problem = DescentProblem(goal(), basis, (torque,))
    found = {each.label: each.value for each in margins(problem, fine_grid(problem), x)}
    predicted = np.abs(predict(run, basis.excitation(x).sample(1000.0))).max(axis=0)
    (said,) = [each.evidence for each in findings if each.code == "torque-estimated"]
    return np.array([found[name] for name in ROBOT.joint_names]), predicted, said


@pytest.mark.parametrize("terms", [DRIVES, LADEN])
def test_the_torque_of_the_preflight_is_the_predicted_torque(terms: tuple[Term, ...]):
    """In every sample of the grid of the certificate; drives that the plan's own model lacks count too."""
    found, predicted, said = peaks(run_of(terms))
    np.testing.assert_allclose(found, predicted, rtol=ROUNDING)
    assert all(term.name in said for term in terms) and "after a long motion" not in said


def test_the_torque_of_the_preflight_covers_hysteresis():
    found, predicted, said = peaks(run_of((*LADEN, Hysteresis((0.001, 0.01)))))
    assert (found > predicted * (1.0 - REVERSAL)).all() and "hysteresis is that after a long motion" in said


@pytest.mark.parametrize("kind", ["poses", "sweeps"])
def test_poses_and_sweeps_have_the_predicted_torque(kind: Literal["poses", "sweeps"]):
    run = run_of(DRIVES)
    model = DynamicsModel(ROBOT, (RigidBody(),))
    found = design_moves(model, MovesGoal(kind, 4), constraints(run))
    margins = [each.value for each in found.preflight.margins if each.limit == "torque"]
    predicted = np.abs(predict(run, found.plan.sample(CHECK_RATE))).max(axis=0)
    assert margins == pytest.approx(predicted.tolist(), rel=ROUNDING)


def test_hysteresis_that_slips_is_what_it_becomes_away_from_reversals():
    """At each joint that has moved in one direction by twice the widest element."""
    model = DynamicsModel(ROBOT, (Hysteresis((0.003, 0.05)), Viscous()))
    t = np.linspace(0.0, 1.0, 200)
    states = [np.outer(x, np.sign(np.arange(6) - 2.5)) for x in (t + t**2, 1.0 + 2.0 * t, np.full(200, 2.0))]
    motion = Motion(t, *states)
    theta = np.random.default_rng(1).uniform(1.0, 2.0, len(model.parameters))
    at = (t + t**2) > 0.1
    np.testing.assert_allclose(
        slipping(model).torque(motion, theta)[at], model.torque(motion, theta)[at], rtol=ROUNDING
    )
    rigid = DynamicsModel(ROBOT, DRIVES)
    assert slipping(rigid) is rigid


def test_a_run_about_another_arm_or_gravity_gives_no_torque():
    run = run_of(DRIVES)
    assert estimated_torque(run, load_robot("ur10e")) is None
    assert estimated_torque(run, load_robot("panda")) is None
    hung = replace(ROBOT, gravity=-ROBOT.gravity)  # needs the same parameters
    turned = replace(ROBOT, gravity=np.array([9.81, 0.0, 0.0]))  # the first joint then carries weight
    assert estimated_torque(run, turned) is None
    found = estimated_torque(run, hung)
    assert found is not None
    q = random_states(np.random.default_rng(2), 20, 6)[0]
    still = Motion.of_states(q, np.zeros_like(q), np.zeros_like(q))
    weightless = np.array([name.symbol == "FO" for name in found.model.base.names])
    theta = np.zeros(len(run.model.parameters))
    theta[found.model.base.kept] = np.where(weightless, 0.0, found.values)
    np.testing.assert_allclose(
        found.model.model.torque(still, theta), -run.model.torque(still, theta), rtol=0.0, atol=ROUNDING
    )

"""The friction ladder on arms whose friction is known: as good as who knows it, and silent where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.estimators import Ridge
from armid.estimation.friction.selection import FrictionSelection, choose_friction
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    Coulomb,
    Hysteresis,
    Offset,
    RigidBody,
    Ripple,
    Stribeck,
    Term,
    Viscous,
)
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

WIDTH, NOISE, RATE, SECONDS, JOINTS = 0.02, 0.05, 100.0, 30.0, 3

PLAIN: tuple[Term, ...] = (RigidBody(), Viscous(), Coulomb(WIDTH), Offset())

RICH: tuple[Term, ...] = (
    *PLAIN,
    Stribeck(0.14, 2.0, WIDTH),
    AsymmetricCoulomb(WIDTH),
    AsymmetricViscous(),
    Hysteresis((0.014, 0.07)),
    Ripple((3.0,)),
)
"""Shapes between those of the ladder's grid."""

SIZES = {
    "viscous": 1.0,
    "coulomb": 1.0,
    "offset": 0.5,
    "stribeck": 0.8,
    "asymmetric-coulomb": 0.3,
    "asymmetric-viscous": 0.3,
    "hysteresis": 0.7,
    "ripple": 0.3,
}
"""Friction of a small arm, as its terms have it [N·m and N·m·s/rad]."""

SIGNED = {"offset", "ripple", "asymmetric-coulomb", "asymmetric-viscous"}

AS_GOOD = 1.2
"""RMS of all joints on unseen motion away from standstill over that of who knows the truth."""

EACH = 1.35
"""The same of each joint: now and then one lacks a part of its hysteresis, as large as the noise."""

MOVING = 0.1
"""Speed from which on a joint is away from standstill [rad/s]: the Stribeck effect has mostly fallen off."""


class Arm:
    """An arm with known friction, and recordings of it."""

    def __init__(self, terms: tuple[Term, ...], seed: int) -> None:
        rng = np.random.default_rng(seed)
        robot = robot_of(structured_tree(rng, JOINTS, prismatic=0.0, branching=0.0))
        self.truth = DynamicsModel(robot, terms)
        self.plain = DynamicsModel(robot, PLAIN)
        self.theta = np.zeros(len(self.truth.parameters))
        self.theta[self.truth.inertial_columns] = random_inertial(rng, JOINTS).ravel()
        for k, parameter in enumerate(self.truth.parameters):
            if parameter.kind in SIZES:
                sign = rng.choice([-1.0, 1.0]) if parameter.kind in SIGNED else 1.0
                self.theta[k] = sign * SIZES[parameter.kind] * rng.uniform(0.5, 1.5)

    def recorded(self, seed: int) -> Observations:
        rng = np.random.default_rng(seed)
        motion = lively_motion(rng, JOINTS, RATE, SECONDS)
        torque = self.truth.torque(motion, self.theta)
        return raw(one_run(motion, torque + NOISE * rng.normal(size=torque.shape), RATE, step=4, block_rows=25))


def unseen_error(model: DynamicsModel, weight: float, training: Observations, other: Observations) -> Array:
    """RMS (n,) on other motion where joints move, the first seconds aside: no model knows its memory there."""
    base = find_base_parameters(model)
    problem = EstimationProblem(accumulate_information(model, base, training), standard_of(model, base), model, base)
    theta = torque_parameters(base, Ridge(weight=weight).solve(problem))
    (run,) = other.runs
    residual = (run.torque - model.torque(run.motion, theta))[300:]
    moving = np.abs(run.motion.dq[300:]) > MOVING
    return np.sqrt(np.sum(residual**2 * moving, axis=0) / moving.sum(axis=0))


def climbed(arm: Arm, seed: int) -> tuple[FrictionSelection, Observations]:
    training = arm.recorded(1000 + seed)
    return choose_friction(arm.plain, training), training


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 8])
def test_the_ladder_is_nearly_as_good_as_who_knows_the_truth(seed: int):
    arm = Arm(RICH, seed)
    ladder, training = climbed(arm, seed)
    assert ladder.prior_weight is not None
    other = arm.recorded(2000 + seed)
    found, known, plain = (
        unseen_error(model, ladder.prior_weight, training, other) for model in (ladder.model, arm.truth, arm.plain)
    )
    assert np.linalg.norm(found) <= AS_GOOD * np.linalg.norm(known), found / known
    assert (found <= EACH * known).all(), found / known
    assert (found < 0.5 * plain).all()  # which would be easy to reach if there were nothing to find


@pytest.mark.parametrize("seed", range(5))
def test_where_friction_is_viscous_and_coulomb_next_to_nothing_is_added(seed: int):
    arm = Arm(PLAIN, seed)
    ladder, training = climbed(arm, seed)
    assert ladder.prior_weight is not None
    assert len(ladder.added) <= 1
    other = arm.recorded(2000 + seed)
    found, known = (unseen_error(m, ladder.prior_weight, training, other) for m in (ladder.model, arm.plain))
    assert (found <= 1.02 * known).all()


def test_what_was_chosen_is_a_model_like_any_other():
    arm = Arm(RICH, 4)
    ladder, training = climbed(arm, 4)
    assert ladder.model.terms == (*PLAIN, *ladder.added)
    base = find_base_parameters(ladder.model)
    assert accumulate_information(ladder.model, base, training).count == base.count
    chosen = {(e.joint, e.candidate.split()[0]) for e in ladder.evidence if e.chosen}
    assert ("joint_1", "hysteresis") in chosen and ("joint_1", "ripple") in chosen
    assert all(e.ratio < 1.0 and e.deviation >= 0.0 for e in ladder.evidence if e.chosen)

"""Every criterion and every limit of a design has the gradient that central differences find."""

from __future__ import annotations

import numpy as np
import pytest

from armid.excitation.design.criteria import CRITERIA
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.limits.constraint_channels import (
    AmplitudeLimit,
    CoefficientLimit,
    RangeLimit,
    States,
    soft_maximum,
)
from armid.excitation.limits.torque_limits import Torque, TorqueModel
from armid.excitation.limits.workspace import Workspace
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.memoryless_model import slipping
from armid.model.terms import (
    Coulomb,
    Coupling,
    Hysteresis,
    LoadCoulomb,
    LoadViscous,
    Offset,
    RigidBody,
    RotorInertia,
    Viscous,
)
from armid.robot import load_robot

RELATIVE = 1e-6
"""Largest relative error of the gradient; differences of step 1e-4 with their error of fourth order are better by
far, apart from rounding."""

STEP = 1e-4
SAMPLES = 48


@pytest.fixture(scope="module", params=["ur5e", "iiwa14-r820"])
def goal(request):
    robot = load_robot(request.param)
    terms = (RigidBody(), Viscous(), Coulomb(), Offset(), RotorInertia())
    model = DynamicsModel(robot, terms)
    base = find_base_parameters(model)
    rng = np.random.default_rng(3)
    prior, prediction = (A @ A.T for A in rng.normal(size=(2, base.count, base.count)))
    return CriterionGoal(model, base, "prediction", rng.uniform(0.2, 1.0, model.n), 50.0, 2, 0.1 * prior, prediction)


def basis_of(goal, *, free=False, literal=True):
    return SeriesBasis(0.9, 5, 0.1 * np.ones(goal.model.n), free=free, literal=literal)


def slope(function, x, d):
    """Derivative along d, by differences of fourth order."""
    up, down, up2, down2 = (function(x + s * STEP * d) for s in (1.0, -1.0, 2.0, -2.0))
    return (8.0 * (up - down) - (up2 - down2)) / (12.0 * STEP)


def rounding(function, x, d):
    """Error of `slope` by rounding, from the scatter of values so close that the function itself does not change.

    The smallest eigenvalue of a badly conditioned matrix has few digits, and how many depends on the processor.
    """
    values = [function(x + s * TINY * d) for s in range(-4, 5)]
    return 18.0 / 12.0 * np.ptp(values) / STEP  # the four values of `slope` with the sum 18 of their weights


TINY = 1e-12
"""Step over which the criteria change by 1e-11 at most, 1e-7 in their slope."""


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("free", [False, True])
def test_criterion(goal, criterion, free):
    sizes = np.random.default_rng(7).uniform(0.5, 2.0, goal.base.count)
    own = CriterionGoal(goal.model, goal.base, criterion, goal.noise, 50.0, 2, goal.prior, goal.prediction, sizes)
    basis = basis_of(goal, free=free)
    objective = Objective(own, basis, SAMPLES, width=0.2, sharpness=12.0)
    rng = np.random.default_rng(1)
    x, d = 0.6 * rng.normal(size=basis.unknowns), rng.normal(size=basis.unknowns)
    value, gradient = objective(x)
    assert value == objective.value(x)
    d = d / np.linalg.norm(d) + gradient / np.linalg.norm(gradient)  # a slope that is not small by chance
    expected = slope(objective.value, x, d)
    assert gradient @ d == pytest.approx(expected, rel=RELATIVE, abs=rounding(objective.value, x, d))


def channels(goal, basis):
    rng = np.random.default_rng(5)
    n, L = basis.n, basis.harmonics
    every, names = tuple(range(n)), goal.model.robot.joint_names
    some = (0, n - 1)
    limits = rng.uniform(1.0, 2.0, n)
    normals = rng.normal(size=(3, 3))
    other = DynamicsModel(goal.model.robot, (RigidBody(), RotorInertia(), Coulomb()))
    described = TorqueModel(other, find_base_parameters(other))
    terms = (RigidBody(), RotorInertia(), Coulomb(), LoadCoulomb(), LoadViscous(), Hysteresis((0.01, 0.1)))
    bodies = goal.model.robot.inertial_vector
    laden = DynamicsModel(goal.model.robot, terms, None if bodies is None else 0.1 * bodies)
    loaded = TorqueModel(slipping(laden), find_base_parameters(laden))
    return {
        "position": RangeLimit("position", 0, every, names, 0.1 * limits, limits),
        "velocity": RangeLimit("velocity", 1, some, (names[0], names[-1]), np.zeros(2), limits[:2]),
        "acceleration": RangeLimit("acceleration", 2, every, names, np.zeros(n), limits),
        "jerk": RangeLimit("jerk", 3, every, names, np.zeros(n), limits),
        "amplitude of position": AmplitudeLimit("position", 0, every, names, limits),
        "amplitude of velocity": AmplitudeLimit("velocity", 1, some, (names[0], names[-1]), limits[:2]),
        "coefficients": CoefficientLimit(
            "coefficients", some, tuple(names[0] for _ in range(4 * L)), rng.uniform(1.0, 2.0, (2, L))
        ),
        "torque": Torque("torque", every, names, rng.normal(size=goal.base.count), 3.0 * limits),
        "torque of another model": Torque(
            "torque", every, names, rng.normal(size=described.base.count), 3.0 * limits, described
        ),
        "torque with load and hysteresis": Torque(
            "torque", every, names, rng.normal(size=loaded.base.count), 3.0 * limits, loaded
        ),
        "workspace": Workspace(
            "workspace", ("a", "b", "c"), normals / np.linalg.norm(normals, axis=1)[:, None], 0.5 * np.ones(3)
        ),
    }


KINDS = (
    "position", "velocity", "acceleration", "jerk", "amplitude of position", "amplitude of velocity",
    "coefficients", "torque", "torque of another model", "torque with load and hysteresis",
    "workspace",
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("literal", [False, True])
def test_limit(goal, kind, literal):
    basis = basis_of(goal, literal=literal)
    objective = Objective(goal, basis, SAMPLES, width=0.3)
    channel = channels(goal, basis)[kind]
    rng = np.random.default_rng(2)
    x, d = 0.6 * rng.normal(size=basis.unknowns), rng.normal(size=basis.unknowns)

    def soft(x):
        return soft_maximum(channel.values(States(objective, x)), 7.0)[0]

    states = States(objective, x)
    _, weights = soft_maximum(channel.values(states), 7.0)
    gradient = channel.pullback(states, weights)
    assert gradient.shape == (len(channel.labels), basis.unknowns)
    # The corners of an absolute value at zero weigh nothing against a highest value.
    assert gradient @ d == pytest.approx(slope(soft, x, d), rel=RELATIVE, abs=1e-6)


def test_law_that_couples_joints():
    """A coordinate of two joints, through the laws' own derivatives."""
    robot = load_robot("ur5e")
    model = DynamicsModel(robot, (RigidBody(), Coupling({"wrist_1_joint": 1.0, "wrist_2_joint": -0.5})))
    goal = CriterionGoal(model, find_base_parameters(model))
    basis = SeriesBasis(1.1, 4, np.zeros(6))
    objective = Objective(goal, basis, SAMPLES, width=0.2, sharpness=8.0)
    rng = np.random.default_rng(4)
    x, d = 0.5 * rng.normal(size=basis.unknowns), rng.normal(size=basis.unknowns)
    assert objective(x)[1] @ d == pytest.approx(slope(objective.value, x, d), rel=RELATIVE)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_hides_between_the_points_of_a_grid(goal, kind):
    """The allowance of `between` covers what a grid of forty times the points finds."""
    basis = basis_of(goal)
    channel = channels(goal, basis)[kind]
    x = 0.6 * np.random.default_rng(6).normal(size=basis.unknowns)
    coarse, fine = (States(Objective(goal, basis, samples), x) for samples in (100, 4000))
    seen = channel.values(coarse).max(axis=0) + channel.between(coarse, basis.period / 100)
    assert (channel.values(fine).max(axis=0) <= seen + 1e-12).all()

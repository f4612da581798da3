"""Consistent estimates on random arms, motions and noise: physical always, and what fails says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.consistency import EPSILON
from armid.estimation.estimators import PhysicallyConsistent
from armid.estimation.problem import Problem, standard_of
from armid.information.stream import inform
from armid.maths.inertia import pseudo_inertia
from armid.model.base import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

RATE = 50.0

KINDS = ("mass", "log-det", "euclidean", "none")

GAP = 1e-6
"""Largest duality gap of a solution, over the size of the objective."""


def random_problem(seed: int, joints: int) -> Problem:
    """An arm with a wrong description and a recording that may be short, weak, noisy or of another sign."""
    rng = np.random.default_rng(seed)
    tree = structured_tree(rng, joints, prismatic=0.1 * rng.integers(2), branching=0.2 * rng.integers(2))
    terms = [RigidBody(), Viscous(), Coulomb(width=0.02)]
    terms += [term for term in (Offset(), RotorInertia()) if rng.random() < 0.5]
    model = DynamicsModel(robot_of(tree), tuple(terms))
    base = find_base_parameters(model)
    truth = rng.uniform(0.0, 1.0, len(model.parameters))
    truth[model.inertial_columns] = random_inertial(rng, joints).ravel() * rng.choice([0.1, 1.0, 10.0])
    motion = lively_motion(rng, joints, RATE, float(rng.choice([3.0, 8.0])))
    weak = rng.choice(["lively", "slow", "some", "still"], p=[0.5, 0.2, 0.2, 0.1])
    if weak == "slow":
        motion = Motion(motion.time, motion.q, 0.01 * motion.dq, 1e-4 * motion.ddq)
    elif weak != "lively":
        moves = (rng.random(joints) < 0.5) * (weak == "some")
        motion = Motion(motion.time, motion.q * moves, motion.dq * moves, motion.ddq * moves)
    torque = model.torque(motion, truth) * rng.choice([1.0, 1.0, 1.0, -1.0])
    torque += rng.choice([0.0, 1e-3, 0.1, 10.0]) * rng.normal(size=torque.shape)
    observations = raw(one_run(motion, torque, RATE, block_rows=25))
    nominal = np.zeros(len(truth))
    nominal[model.inertial_columns] = random_inertial(rng, joints).ravel()
    standard = replace(standard_of(model, base), nominal=nominal)
    return Problem(inform(model, base, observations), standard, model, base)


def assert_physical(problem: Problem, kind: str) -> None:
    """The answer is one, by what can be computed from it alone."""
    fit = PhysicallyConsistent(prior=kind, weight=1.0).estimate(problem)  # pyright: ignore[reportArgumentType]
    standard, found = problem.standard, fit.standard
    assert standard is not None and found is not None
    least = np.linalg.eigvalsh(pseudo_inertia(found.values[standard.inertial])).min()
    assert least >= EPSILON
    assert found.proof.smallest_eigenvalue == pytest.approx(least)
    assert (found.values[standard.nonnegative] >= 0.0).all()
    assert found.proof.gap <= GAP
    np.testing.assert_allclose(fit.values, standard.regrouping @ found.values, atol=1e-9 * np.abs(fit.values).max())
    assert np.isfinite(found.deviation).all() and np.isfinite(found.intervals).all()
    assert (found.intervals[:, 0] <= found.values).all() and (found.values <= found.intervals[:, 1]).all()


@pytest.mark.parametrize("seed", range(12))
def test_random_problems_have_physical_answers(seed: int):
    assert_physical(random_problem(seed, 2 + seed % 6), KINDS[seed % 4])


@pytest.mark.long
def test_five_hundred_random_problems_have_physical_answers_or_none():
    """From six to thirty joints. What cannot be solved is refused: data that no body explains, without noise.

    Such data are wrong by a million of their deviations, of which double precision leaves a certificate no digits.
    """
    refused: list[int] = []
    for seed in range(500):
        rng = np.random.default_rng(10_000 + seed)
        joints = int(rng.integers(6, 10)) if rng.random() < 0.9 else int(rng.integers(10, 31))
        try:
            assert_physical(random_problem(seed, joints), KINDS[seed % 4])
        except EstimationError as error:
            assert error.remedy and "gap" in error.problem
            refused.append(seed)
    assert len(refused) <= 40, refused

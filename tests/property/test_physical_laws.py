"""Consistent estimates on random arms, motions and noise: physical always, and none refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armid.errors import UnsolvedError
from armid.estimation.consistency.cones import EPSILON
from armid.estimation.consistency.consistent_fit import BodyConstraints, ConsistentProgram
from armid.estimation.estimators import PhysicallyConsistent
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.maths.inertia import pseudo_inertia
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

RATE = 50.0

KINDS = ("mass", "log-det", "euclidean", "none")

PARTS = 20

GAP = 1e-6
"""Largest duality gap of a solution, over the size of the objective."""


def random_problem(seed: int, joints: int) -> EstimationProblem:
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
    return EstimationProblem(accumulate_information(model, base, observations), standard, model, base)


def whole_problem(noise: float, sign: float) -> EstimationProblem:
    """Three joints in lively motion, described as they are, with a torque that may have another sign."""
    rng = np.random.default_rng(3)
    model = DynamicsModel(robot_of(structured_tree(rng, 3)), (RigidBody(), Viscous(), Coulomb(width=0.02)))
    base = find_base_parameters(model)
    truth = rng.uniform(0.2, 1.0, len(model.parameters))
    truth[model.inertial_columns] = random_inertial(rng, 3).ravel()
    motion = lively_motion(rng, 3, RATE, 8.0)
    torque = sign * model.torque(motion, truth)
    torque += noise * rng.normal(size=torque.shape)
    nominal = np.zeros(len(truth))
    nominal[model.inertial_columns] = truth[model.inertial_columns]
    standard = replace(standard_of(model, base), nominal=nominal)
    return EstimationProblem(
        accumulate_information(model, base, raw(one_run(motion, torque, RATE, block_rows=25))), standard, model, base
    )


def assert_physical(problem: EstimationProblem, kind: str) -> Fit:
    """The answer is one, by what can be computed from it alone."""
    fit = PhysicallyConsistent(prior=kind, weight=1.0).solve(problem)  # pyright: ignore[reportArgumentType]
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
    return fit


@pytest.mark.parametrize("seed", range(12))
def test_random_problems_have_physical_answers(seed: int):
    assert_physical(random_problem(seed, 2 + seed % 6), KINDS[seed % 4])


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_five_hundred_random_problems_have_physical_answers(part: int):
    """From six to thirty joints, in parts that can be run one at a time, `-k "[7]"`; none is refused."""
    for seed in range(part, 500, PARTS):
        rng = np.random.default_rng(10_000 + seed)
        joints = int(rng.integers(6, 10)) if rng.random() < 0.9 else int(rng.integers(10, 31))
        assert_physical(random_problem(seed, joints), KINDS[seed % 4])


def raised_noise(fit: Fit) -> list[str]:
    """Severities of what is said of noise that was raised."""
    return [finding.severity for finding in fit.findings if finding.code == "noise-raised"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", [0.0, 1e-3, 1.0])
def test_noise_is_not_raised_where_bodies_explain_the_torque(kind: str, noise: float):
    """Not without noise either, nor is there then a price, of which rounding would make thousands of percent."""
    fit = assert_physical(whole_problem(noise, 1.0), kind)
    assert not raised_noise(fit)
    assert not {finding.code for finding in fit.findings} & {"price-of-consistency", "not-physical"}


def test_noise_is_raised_where_none_does_and_it_is_said():
    """Torque of another sign that is known to a millionth; what is wrong with it is in the words."""
    fit = assert_physical(random_problem(37, 9), "log-det")
    (said,) = [finding for finding in fit.findings if finding.code == "noise-raised"]
    assert said.severity == "warning" and "No physically consistent arm explains" in said.evidence
    assert "joint" in said.evidence and "sign" in said.remedy


@pytest.mark.parametrize(("sign", "severity"), [(1.0, "info"), (-1.0, "warning")])
def test_what_is_said_of_raised_noise_is_true_whatever_made_the_search_fail(
    monkeypatch: pytest.MonkeyPatch, sign: float, severity: str
):
    """A search that fails for reasons of its own is no evidence that no body explains the data."""
    solve, failures = ConsistentProgram.solve, iter([True])

    def once(*args: Any, **options: Any) -> BodyConstraints:
        if next(failures, False):
            raise UnsolvedError("The search stumbled.")
        return solve(*args, **options)

    monkeypatch.setattr(ConsistentProgram, "solve", once)
    assert raised_noise(assert_physical(whole_problem(1e-3, sign), "mass")) == [severity]


def test_a_search_that_never_ends_is_refused_with_what_to_do(monkeypatch: pytest.MonkeyPatch):
    def never(*_: Any, **__: Any) -> BodyConstraints:
        raise UnsolvedError("The search stumbled.")

    monkeypatch.setattr(ConsistentProgram, "solve", never)
    with pytest.raises(UnsolvedError) as caught:
        assert_physical(whole_problem(1e-3, 1.0), "mass")
    assert "0.1 of the torque" in caught.value.problem and "sign" in caught.value.remedy

"""Friction selection: gains against direct estimates, candidates and terms, and data that are too few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.crossvalidation import folds, held_out_squares
from armid.estimation.estimators import Ridge
from armid.estimation.friction import selection as module
from armid.estimation.friction.body_prior import STRENGTHS, predicts_as_well, weight_for_estimate
from armid.estimation.friction.candidates import (
    Candidate,
    CandidateModel,
    allowed_candidates,
    candidate_model,
    describe,
    terms_of,
)
from armid.estimation.friction.forward_selection import (
    HeldOutTrial,
    SelectedCandidate,
    SelectionPath,
    select_forward,
)
from armid.estimation.friction.heldout_gains import GainPrior, make_folds
from armid.estimation.friction.selection import choose_friction
from armid.estimation.friction.shape_fit import refine_shapes
from armid.estimation.problem import build_problem
from armid.estimation.whitened_system import WhitenedSystem, whiten
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, select
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import TERMS, Coulomb, Hysteresis, Offset, RigidBody, Ripple, Sigmoid, Stribeck, Viscous
from armid.model.terms.selection_candidates import automatic_choice
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

RATE = 50.0

NEAR = 0.1
"""Difference of a refined shape's logarithm from the truth: three deviations at this noise; the grid's is 0.34."""

EXACT = 1e-6
"""Relative difference of gains by products of columns and by estimates on the stacked rows."""


def arm() -> DynamicsModel:
    tree = structured_tree(np.random.default_rng(2), 3, prismatic=0.0, branching=0.0)
    return DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(0.02), Offset()))


def recorded(model: DynamicsModel, seconds: float = 24.0, seed: int = 5) -> Observations:
    rng = np.random.default_rng(seed)
    motion = lively_motion(rng, model.n, RATE, seconds)
    theta = rng.uniform(0.2, 1.0, len(model.parameters))
    theta[model.inertial_columns] = random_inertial(rng, model.n).ravel()
    torque = model.torque(motion, theta)
    return raw(one_run(motion, torque + 0.1 * rng.normal(size=torque.shape), RATE, step=2, block_rows=25))


def test_a_gain_is_what_the_error_on_the_segment_loses():
    model, observations = arm(), recorded(arm())
    base = find_base_parameters(model)
    wide = candidate_model(model, base, [frozenset({Candidate("stribeck", 0.1), Candidate("ripple", 3.0)})] * 3)
    information = accumulate_information(wide.model, wide.base, observations)
    b = information.count
    weights = np.array([1.0, 2.0, 0.5])
    fold = np.arange(information.blocks) // 6
    segments = make_folds(information, fold, weights, GainPrior(np.zeros(b), np.zeros((b, b))))
    kept = np.flatnonzero(wide.in_model)
    reduced = segments.reduced(kept, np.zeros(b), refit_all=True)
    for joint in range(3):
        columns = wide.columns[joint, Candidate("ripple", 3.0)]
        gains = reduced.gains(joint, columns, 0.0)
        assert gains is not None
        with_ = segments.errors(np.sort(np.append(kept, columns)), np.zeros(b)) * weights**2
        without = segments.errors(kept, np.zeros(b)) * weights**2
        np.testing.assert_allclose(without, reduced.squares, rtol=EXACT)
        lost = without - with_
        assert np.abs(gains[0] - lost[:, joint]).max() < EXACT * without[:, joint].max()
        assert np.abs(gains[1] - lost.sum(axis=1)).max() < EXACT * without.sum(axis=1).max()


def test_a_segment_and_its_neighbours_do_not_train():
    model, observations = arm(), recorded(arm())
    base = find_base_parameters(model)
    information = accumulate_information(model, base, observations)
    fold = np.arange(information.blocks) // 6
    b = information.count
    segments = make_folds(information, fold, np.ones(3), GainPrior(np.zeros(b), np.zeros((b, b))))
    kept, none = np.arange(b), np.zeros(b)
    others = np.flatnonzero((np.arange(information.blocks) < 5) | (np.arange(information.blocks) > 12))
    alone = make_folds(select(information, others), np.zeros(len(others), dtype=np.int64), np.ones(3), segments.prior)
    values = alone.whole.solve(kept, none)
    found = segments.training[1].solve(kept, none)
    np.testing.assert_allclose(found, values, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(
        segments.errors(kept, none)[1], held_out_squares(select(information, fold == 1), values), rtol=1e-5
    )


def test_what_does_not_repeat_on_another_recording_is_not_selected():
    """A ripple in the longer of two recordings: its own blocks confirm it, the other recording does not."""
    model = arm()
    truth = DynamicsModel(model.robot, (*model.terms, Ripple((3.0,), joints=(model.robot.joint_names[1],))))
    theta = np.random.default_rng(1).uniform(0.2, 1.0, len(truth.parameters))
    theta[truth.inertial_columns] = random_inertial(np.random.default_rng(2), model.n).ravel()

    def run(recording: int, ripple: float) -> ObservedRun:
        rng = np.random.default_rng(5 + recording)
        motion = lively_motion(rng, model.n, RATE, (42.0, 6.0)[recording])
        values = theta.copy()
        values[[parameter.kind == Ripple.name for parameter in truth.parameters]] = ripple
        torque = truth.torque(motion, values) + 0.1 * rng.normal(size=motion.q.shape)
        return replace(one_run(motion, torque, RATE, step=2, block_rows=25), recording=recording)

    def has_ripple(*runs: ObservedRun) -> bool:
        return any(isinstance(term, Ripple) for term in choose_friction(model, raw(*runs)).added)

    assert has_ripple(run(0, 0.5)) and has_ripple(run(0, 0.5), run(1, 0.5))
    assert not has_ripple(run(0, 0.5), run(1, 0.0))


def test_joints_with_the_same_shapes_share_a_term():
    model = arm()
    wave, effect = Candidate("ripple", 3.0), Candidate("stribeck", 0.1)
    chosen = [frozenset({wave, Candidate("ripple", 2.0), effect}), frozenset({effect}), frozenset({wave})]
    names = model.robot.joint_names
    assert set(terms_of(model, chosen)) == {
        Ripple((2.0, 3.0), joints=(names[0],)),
        Ripple((3.0,), joints=(names[2],)),
        Stribeck(0.1, 2.0, 0.02, (names[0], names[1])),
    }
    assert describe((wave, Candidate("ripple", 2.0), Candidate("load-coulomb"))) == "ripple 2, 3 + load-coulomb"


def test_pieces_do_not_change_the_models_own_parameters():
    model = arm()
    base = find_base_parameters(model)
    wide = candidate_model(model, base, [frozenset({Candidate("hysteresis", 0.01)})] * 3)
    assert tuple(np.array(wide.base.names)[wide.in_model]) == base.names
    assert wide.base.count == base.count + 3


def test_a_width_whose_memory_is_not_known_early_is_no_candidate():
    model = arm()
    (run,) = recorded(model).runs
    small = replace(run.motion, q=0.02 * run.motion.q)
    allowed = allowed_candidates(model, raw(replace(run, motion=small)))
    widths = [{piece.shape for piece in pieces if piece.term == Hysteresis.name} for pieces in allowed]
    assert all(0.001 in own and 0.1 not in own for own in widths)
    separate = allowed_candidates(model, raw(replace(run, consecutive=False)))
    assert not any(piece.term == Hysteresis.name for pieces in separate for piece in pieces)
    assert not any(piece.term == "load-coulomb" for pieces in allowed for piece in pieces)  # no load is known


def test_a_ripple_of_which_the_angles_show_less_than_a_period_is_no_candidate():
    model = arm()
    (run,) = recorded(model).runs
    turn = replace(run.motion, q=run.motion.q * (1.8 / np.ptp(run.motion.q, axis=0)))
    allowed = allowed_candidates(model, raw(replace(run, motion=turn)))
    assert all({piece.shape for piece in own if piece.term == "ripple"} == {4.0, 5.0, 6.0} for own in allowed)


def test_weights_and_method_are_those_of_the_model_without_the_choice():
    """Selected friction on one joint changes no weight, so it cannot push the error to other joints."""
    model = arm()
    truth = DynamicsModel(model.robot, (*model.terms, Stribeck(0.14, 2.0, 0.02, (model.robot.joint_names[1],))))
    observations = recorded(truth)
    ladder = choose_friction(model, observations)
    problem = build_problem(model, observations)
    expected = 1.0 / whiten(problem.information).weights
    # Within the recorded speeds, a sigmoid about zero has the shape of the Stribeck law: either is right.
    assert any(isinstance(term, Stribeck | Sigmoid) for term in ladder.added)
    np.testing.assert_allclose(ladder.noise, expected, rtol=0.05)  # rows with unknown memory do not count
    assert ladder.noise[1] > 0.12  # the noise after the choice is 0.1


def test_the_weight_of_the_bodies_is_chosen_with_the_selected_friction(monkeypatch: pytest.MonkeyPatch):
    """Without this friction its torque counts as noise, and a wrong description seems accurate beside it."""
    model = arm()
    law = Stribeck(0.14, 2.0, 0.02, (model.robot.joint_names[1],))
    observations = recorded(DynamicsModel(model.robot, (*model.terms, law)))
    judged: list[Array] = []

    def weight(errors: Array, *, contradicted: bool) -> float:
        judged.append(errors)
        return weight_for_estimate(errors, contradicted=contradicted)

    monkeypatch.setattr(module, "weight_for_estimate", weight)
    ladder = choose_friction(model, observations)
    assert ladder.added
    plain = whiten(build_problem(model, observations).information, noise=ladder.noise)
    residual = float(plain.squares @ plain.weights**2)
    assert judged[0].sum(axis=1).min() < residual  # no model without the friction is better than its own residual


def test_a_contradicted_description_gets_the_smallest_weight_within_a_standard_error():
    folds_, count = 8, len(STRENGTHS)
    excess = 0.05 * np.abs(np.arange(count) - 8.0)[:, None] * np.linspace(-2.0, 3.0, folds_)
    errors = 1.0 + excess
    errors[-3:] += 1.0  # far outside one standard error
    best = int(np.argmin(errors.sum(axis=1)))
    assert weight_for_estimate(errors, contradicted=False) == STRENGTHS[best]
    assert weight_for_estimate(errors, contradicted=True) == STRENGTHS[-4] < STRENGTHS[best]


def test_the_better_estimator_of_bodies_is_found():
    problem = build_problem(arm(), recorded(arm()))
    true, heavy = Ridge("zero", weight=1e-4), Ridge("zero", weight=1e9)
    assert predicts_as_well(problem, true, heavy) and predicts_as_well(problem, true, true)
    assert not predicts_as_well(problem, heavy, true)


@pytest.mark.parametrize("true_width", [None, 0.03])
def test_no_width_of_hysteresis_stays_without_gain(true_width: float | None):
    """Not even the widest, which is never removed for itself; the true width stays, and few others."""
    model = arm()
    truth = model if true_width is None else DynamicsModel(model.robot, (*model.terms, Hysteresis((true_width,))))
    observations, base = recorded(truth), find_base_parameters(model)
    widths = tuple(Candidate("hysteresis", width) for width in (0.003, 0.01, 0.03, 0.1))
    wide = candidate_model(model, base, [frozenset(widths)] * 3)
    information = accumulate_information(wide.model, wide.base, observations)
    b = information.count
    segments = make_folds(information, folds(information, 8), np.ones(3), GainPrior(np.zeros(b), np.zeros((b, b))))
    taken = tuple(SelectedCandidate("hysteresis", j, widths, 0.003) for j in range(3))
    trials = tuple(HeldOutTrial(each.joint, each.family, each.candidates, 0.1, 0.1, True) for each in taken)
    start = SelectionPath(taken, np.arange(b), np.zeros(b), trials)
    path = select_forward(segments, segments, wide, [frozenset(widths)] * 3, (), start)
    shapes = [{candidate.shape for candidate in own} for own in path.chosen(3)]
    if true_width is None:
        assert shapes == [set[float]()] * 3
    else:
        assert all(true_width in own and len(own) <= 2 for own in shapes)


def test_a_velocity_law_that_the_speeds_do_not_show_whole_is_no_candidate():
    model = arm()
    (run,) = recorded(model).runs
    slow = replace(run.motion, dq=run.motion.dq * (0.3 / np.abs(run.motion.dq).max(axis=0)))
    allowed = allowed_candidates(model, raw(replace(run, motion=slow)))
    found = {(piece.term, piece.shape) for pieces in allowed for piece in pieces}
    assert ("stribeck", 0.05) in found and ("stribeck", 0.4) not in found
    assert not any(term == "piecewise-viscous" and knot > 0.2 for term, knot in found)
    assert all(Candidate("stribeck", 0.4) in pieces for pieces in allowed_candidates(model, recorded(model)))


@pytest.mark.parametrize(
    "term", [name for name, kind in TERMS.items() if (auto := automatic_choice(kind)) and auto.log_slope]
)
def test_a_slope_is_the_derivative_by_the_logarithm_of_the_shape(term: str):
    model, shape, change = arm(), 0.1, 1e-5
    (run,) = recorded(model).runs
    base = find_base_parameters(model)

    def column(piece: Candidate) -> Array:
        wide = candidate_model(model, base, [frozenset({piece})] * 3)
        theta = np.zeros(len(wide.model.parameters))
        theta[wide.base.kept[wide.columns[1, piece]]] = 1.0
        return wide.model.torque(run.motion, theta)[:, 1]

    above, below = (column(Candidate(term, float(shape * np.exp(sign * change)))) for sign in (1.0, -1.0))
    np.testing.assert_allclose(
        column(Candidate(term, shape, slope=True)), (above - below) / (2.0 * change), atol=1e-8
    )


def test_shapes_go_from_the_grid_to_where_the_truth_is():
    truth = DynamicsModel(arm().robot, (*arm().terms, Stribeck(0.14, 2.0, 0.02)))
    observations, model = recorded(truth), arm()
    base = find_base_parameters(model)

    def widen(pieces: Sequence[frozenset[Candidate]]) -> tuple[CandidateModel, Information]:
        wide = candidate_model(model, base, pieces)
        return wide, accumulate_information(wide.model, wide.base, observations)

    taken = tuple(SelectedCandidate("velocity", j, (Candidate("stribeck", 0.1),), 0.0) for j in range(3))
    trials = tuple(HeldOutTrial(each.joint, each.family, each.candidates, 0.5, 0.1, True) for each in taken)
    found = SelectionPath(taken, np.arange(base.count), np.zeros(base.count), trials)
    nothing = GainPrior(np.zeros(base.count), np.zeros((base.count, base.count)))
    refined = refine_shapes(found, widen, nothing, np.ones(3), [frozenset[Candidate]()] * 3)
    shapes = [each.candidates[0].shape for each in refined.selected]
    assert np.abs(np.log(np.array(shapes) / 0.14)).max() < NEAR
    assert [trial.candidates for trial in refined.trials] == [each.candidates for each in refined.selected]


def test_a_joint_that_stands_still_gets_nothing():
    model = arm()
    (run,) = recorded(model).runs
    q = run.motion.q.copy()
    q[:, 1] = 0.3
    allowed = allowed_candidates(model, raw(replace(run, motion=replace(run.motion, q=q))))
    assert not allowed[1] and allowed[0] and allowed[2]


def test_a_few_seconds_are_no_evidence():
    model = arm()
    ladder = choose_friction(model, recorded(model, seconds=3.0))
    assert ladder.model is model and not ladder.added and ladder.prior_weight is None
    assert "blocks" in ladder.why


def test_a_prior_without_a_known_unit_is_not_handed_on(monkeypatch: pytest.MonkeyPatch):
    calls = iter(range(10))

    def unsettled(information: Information, *, noise: tuple[float, ...] = ()) -> WhitenedSystem:
        if next(calls):  # the first is for the model without what was chosen
            raise EstimationError("The joints' weights do not settle.")
        return whiten(information, noise=noise)

    monkeypatch.setattr(module, "whiten", unsettled)
    ladder = choose_friction(arm(), recorded(arm()))
    assert ladder.evidence and ladder.prior_weight is None
    assert "determined by the method" in ladder.why and "do not settle" in ladder.why

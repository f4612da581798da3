"""The recursive estimate: the batch estimate without forgetting, and what forgetting may and may not do."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.problem import EstimationProblem
from armid.estimation.recursive.forgetting import RETURN, discount, retained_rows
from armid.estimation.recursive.recursive_estimate import (
    ForgettingOptions,
    RecursiveState,
    begin,
    fit,
    resume,
    update,
)
from armid.estimation.run_estimator import estimate
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, select, stack, total
from armid.lab.inverse_dynamics_recording import Sensors
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.model.base_parameters import BaseParameters, find_base_parameters
from labs import small_model, small_recording, small_truth

EXACT = 1e-10
"""Relative: rounding of factors merged one by one, times a condition number of hundreds."""

SENSORS = Sensors(position=0.0, torque=0.2, rate=100.0)


@cache
def base() -> BaseParameters:
    return find_base_parameters(small_model())


@cache
def informed(seed: int, repetitions: int = 4) -> Information:
    """Noisy information in blocks of a second; filtered rows pull together."""
    recording = small_recording(seed, repetitions, SENSORS)
    observations, _ = process_recordings([recording], ProcessingOptions(cutoff=10.0, decimate=50.0))
    return accumulate_information(small_model(), base(), observations)


def through(state: RecursiveState, information: Information, seconds: float = 1.0) -> RecursiveState:
    for k in range(information.blocks):
        state = update(state, select(information, np.array([k])), seconds)
    return state


def gram(state: RecursiveState) -> np.ndarray:
    return state.whole[:, :-1].T @ state.whole[:, :-1]


@pytest.mark.parametrize("fixed", [False, True])
def test_without_forgetting_it_is_the_batch_estimate(fixed: bool):
    information = informed(1)
    batch = WeightedLeastSquares().solve(EstimationProblem(information))
    found = fit(through(begin(information, weights=batch.weights if fixed else None), information))
    scale = np.abs(batch.values).max()
    np.testing.assert_allclose(found.values, batch.values, atol=EXACT * scale)
    np.testing.assert_allclose(found.white_deviation, batch.white_deviation, rtol=EXACT)
    np.testing.assert_allclose(found.residual_rms, batch.residual_rms, rtol=EXACT)
    np.testing.assert_array_equal(found.rows, batch.rows)


def test_without_forgetting_it_does_not_matter_how_rows_are_cut():
    information = informed(1)
    weights = np.array([5.0, 5.0, 5.0])
    one = update(begin(information, weights=weights), information, 0.0)
    np.testing.assert_allclose(
        through(begin(information, weights=weights), information).values, one.values, atol=EXACT * 10
    )


def test_a_block_that_brings_no_time_is_only_added():
    """And what is forgotten is asked of the block that brings the time: cut in two, the first part shows less."""
    information = informed(1)
    weights = np.array([5.0, 5.0, 5.0])
    first, more = select(information, np.arange(20)), select(information, np.arange(20, 24))
    known = update(begin(information, ForgettingOptions(5.0), weights=weights), first, 1.0)
    A, _ = stack(total(more), weights)
    whole = gram(known) + A.T @ A
    np.testing.assert_allclose(gram(update(known, more, 0.0)), whole, rtol=0.0, atol=EXACT * np.abs(whole).max())
    together = update(known, more, 2.0)
    apart = update(update(known, select(more, np.arange(2)), 2.0), select(more, np.arange(2, 4)), 0.0)
    np.testing.assert_allclose(apart.rows, together.rows, rtol=EXACT)
    # Directions that its first part does not show enough are forgotten less: no direction loses more information.
    kept = np.linalg.eigvalsh(gram(apart) - gram(together))
    assert kept[0] > -EXACT * np.abs(whole).max() and kept[-1] > 0.0
    assert (np.abs(apart.values - together.values) < 0.2 * fit(together).deviation).all()


def test_forgetting_is_exponential_where_the_motion_goes_on():
    """Periods of one motion: the estimate is least squares with rows that weigh what is left of them."""
    whole = informed(1, 6)
    periods = [total(select(whole, np.arange(8 * k + 4, 8 * k + 12))) for k in range(5)]
    weights, tau = np.array([5.0, 4.0, 6.0]), 20.0
    state = begin(whole, ForgettingOptions(tau), weights=weights)
    for period in periods:
        state = update(state, period, 8.0)
    parts = [stack(period, weights) for period in periods]
    left = [np.exp(-0.5 * 8.0 * (4 - k) / tau) for k in range(5)]
    A = np.concatenate([w * a for w, (a, _) in zip(left, parts, strict=True)])
    y = np.concatenate([w * y for w, (_, y) in zip(left, parts, strict=True)])
    np.testing.assert_allclose(gram(state), A.T @ A, rtol=0.0, atol=EXACT * np.abs(A.T @ A).max())
    np.testing.assert_allclose(state.values, np.linalg.lstsq(A, y)[0], atol=1e-8)
    np.testing.assert_allclose(state.rows, sum(w**2 * p.rows[0] for w, p in zip(left, periods, strict=True)))


def test_what_is_not_shown_is_not_forgotten():
    """An hour of rows that say nothing leaves estimate and information as they were."""
    information = informed(1)
    state = through(begin(information, ForgettingOptions(5.0), weights=np.full(3, 5.0)), information)
    still = select(information, np.array([0]))
    zero = tuple(type(joint)(joint.parameters, 0.0 * joint.R) for joint in still.joints)
    silent = Information(still.names, zero, 0 * still.rows, still.run, still.recording)
    later = state
    for _ in range(60):
        later = update(later, silent, 60.0)
    np.testing.assert_allclose(gram(later), gram(state), atol=1e-9 * np.abs(gram(state)).max())
    np.testing.assert_allclose(later.values, state.values, atol=1e-8)
    assert later.covariance is not None and state.covariance is not None
    np.testing.assert_allclose(later.covariance, state.covariance, atol=1e-12)


def without(part: Information, joints: list[int]) -> Information:
    """A block in which some joints have no rows."""
    R = [type(x)(x.parameters, (0.0 if j in joints else 1.0) * x.R) for j, x in enumerate(part.joints)]
    rows = part.rows.copy()
    rows[:, joints] = 0
    return Information(part.names, tuple(R), rows, part.run, part.recording)


@pytest.mark.parametrize("resting", [[0, 1, 2], [1]])
def test_noise_is_known_after_a_rest_as_before(resting: list[int]):
    """Five minutes at rest with a memory of ten seconds: weights and what is usual stay; motion is no surprise."""
    information = informed(1)
    state = through(begin(information, ForgettingOptions(10.0)), information)
    later = state
    for k in range(300):
        later = update(later, without(select(information, np.array([1 + k % 30])), resting), 1.0)
    # The others' rows move the estimate a little, and with it the residual of the joint's earlier rows.
    np.testing.assert_allclose(later.weights[resting], state.weights[resting], rtol=0.05)
    for name in ("level", "blocks", "power", "expected"):
        after, before = getattr(later.innovations, name), getattr(state.innovations, name)
        np.testing.assert_allclose(after[resting], before[resting], rtol=EXACT)
    assert not later.innovations.normalized_innovation[resting].any()
    # What moves again after that is as usual as it was: two is hardly reached by motion of a kind.
    again = update(later, select(information, np.array([5])), 1.0)
    assert (again.innovations.normalized_innovation < 2.0).all()
    assert np.isfinite(fit(again).residual_rms).all()


def test_one_joint_alone_does_not_make_the_others_drift():
    """Five minutes in which only the last joint's parameters show, with a memory of ten seconds."""
    information, truth = informed(1), base().values_of(small_truth())
    others = np.array([not name.endswith("_3") for name in information.names])
    state = before = through(begin(information, ForgettingOptions(10.0), weights=np.full(3, 5.0)), information)
    rng = np.random.default_rng(3)
    halfway = None
    for k in range(300):
        part, joints = select(information, np.array([1 + k % 30])), []
        for joint in part.joints:
            shown = np.append(~others[joint.parameters], False)
            R = np.where(shown, joint.R, 0.0)
            R[0, :, -1] = R[0, :, :-1] @ truth[joint.parameters] + 0.2 * rng.standard_normal(R.shape[1])
            joints.append(type(joint)(joint.parameters, R))
        state = update(state, Information(part.names, tuple(joints), part.rows, part.run, part.recording), 1.0)
        halfway = state if k == 150 else halfway
    assert before.covariance is not None and state.covariance is not None and halfway is not None
    assert halfway.covariance is not None
    variance = np.diag(state.covariance)
    assert (np.abs(state.values - truth) <= 4.0 * np.sqrt(variance)).all()
    # What the others were known by together with the last joint's is as sure as that is now, and no less with time.
    assert (variance[others] <= 6.0 * np.diag(before.covariance)[others]).all()
    np.testing.assert_allclose(variance[others], np.diag(halfway.covariance)[others], rtol=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_information_given_up_is_a_multiple_of_what_came(seed: int):
    rng = np.random.default_rng(seed)
    b = 7
    whole = np.linalg.qr(rng.normal(size=(20, b + 1)) * 10.0 ** rng.uniform(-3, 3, b + 1), mode="r")[:b]
    block = np.zeros((b, b + 1))
    block[:3] = rng.normal(size=(3, b + 1)) * 1e-2
    changing = rng.random(b) < 0.7
    changing[seed] = True
    changing |= seed == 0
    kept = retained_rows(whole, np.linalg.qr(block, mode="r"), 0.3, changing)
    size = np.linalg.norm(whole[:, :-1], axis=0)
    H, K, G = (x[:, :-1].T @ x[:, :-1] / np.outer(size, size) for x in (whole, kept, block))
    lost = 0.3 * H - K
    assert np.linalg.eigvalsh(lost).min() > -1e-12
    own = np.ix_(changing, changing)
    assert np.linalg.eigvalsh((RETURN * G - lost)[own]).min() > -1e-12
    # What is kept stands about the estimate, and the others keep all that is known of them.
    values = np.linalg.solve(whole[:, :-1], whole[:, -1])
    np.testing.assert_allclose(kept[:, :-1] @ values, kept[:, -1], atol=1e-9 * np.abs(whole[:, -1]).max())
    if not changing.all():
        after = np.linalg.inv(0.7 * H + K)[np.ix_(~changing, ~changing)]
        np.testing.assert_allclose(after, np.linalg.inv(H)[np.ix_(~changing, ~changing)], rtol=1e-6)


def test_a_renewal_adds_the_jump_to_the_covariance_and_moves_nothing():
    rng = np.random.default_rng(0)
    whole = np.linalg.qr(rng.normal(size=(20, 6)), mode="r")[:5]
    changing, jump = np.array([True, False, True, False, True]), np.array([3.0, 9.0, 0.1, 9.0, 20.0])
    left = discount(whole, changing, jump)
    for _ in range(3):
        again = discount(left, changing, jump)
    before, after, twice = (np.linalg.inv(x[:, :-1].T @ x[:, :-1]) for x in (whole, left, again))
    added = np.diag(np.where(changing, jump, 0.0) ** 2)
    np.testing.assert_allclose(after, before + added, atol=1e-10)
    np.testing.assert_allclose(twice, before + 2.0 * added, atol=1e-9)
    values = np.linalg.solve(whole[:, :-1], whole[:, -1])
    np.testing.assert_allclose(np.linalg.solve(left[:, :-1], left[:, -1]), values, atol=1e-10)


@pytest.mark.parametrize(("tau", "least"), [(np.inf, 0.90), (8.0, 0.88), (4.0, 0.85)])
def test_intervals_hold_the_truth(tau: float, least: float):
    """95 % are meant; filtered rows pull two to three times as white ones, and few blocks say so late."""
    truth = base().values_of(small_truth())
    inside = []
    for seed in range(20):
        found = fit(through(begin(informed(seed), ForgettingOptions(tau)), informed(seed)))
        ends = found.intervals
        inside.append(np.mean((ends[:, 0] <= truth) & (truth <= ends[:, 1])))
    assert least <= np.mean(inside) <= 0.99


def test_the_effective_number_of_samples_is_twice_the_memory():
    """White noise, one motion over and over: the variance is that of 2 τ seconds, no more and no less."""
    information, tau = informed(1, 6), 40.0
    period = total(select(information, np.arange(8, 16)))
    state = begin(information, ForgettingOptions(tau), weights=np.full(3, 5.0))
    for _ in range(60):
        state = update(state, period, 8.0)
    _, plain = stack(period, np.full(3, 5.0)), state
    A = stack(period, np.full(3, 5.0))[0]
    left = np.exp(-8.0 / tau)
    expected = np.linalg.inv(A.T @ A) * (1.0 - left) / (1.0 + left)
    assert plain.covariance is not None
    ratio = np.diag(plain.covariance) / np.diag(expected)
    # The same noise in every period is no surprise, so nothing but the floor of white noise is counted.
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-3)


def test_it_goes_on_from_an_earlier_estimate():
    """As one estimate from both, but for the share of noise that each recording shows of its own."""
    first, second = informed(1), informed(2)
    earlier = estimate(EstimationProblem(first))
    state = resume(second, earlier)
    np.testing.assert_allclose(state.values, earlier.values, atol=1e-8)
    found = fit(through(state, second))
    assert (np.diag(found.covariance) < np.diag(earlier.covariance)).all()
    truth = base().values_of(small_truth())
    assert np.sqrt(np.mean((found.values - truth) ** 2 / np.diag(found.covariance))) < 1.5


def test_bad_input_is_one_message():
    information = informed(1)
    other = Information(
        tuple(f"x{k}" for k in range(information.count)),
        information.joints, information.rows, information.run, information.recording,
    )  # fmt: skip
    with pytest.raises(EstimationError, match="above 0 s"):
        ForgettingOptions(0.0)
    with pytest.raises(EstimationError, match="must not be negative"):
        update(begin(information), information, -1.0)
    with pytest.raises(EstimationError, match="so far determine"):
        fit(begin(information))
    with pytest.raises(EstimationError, match="differ from those of the new blocks"):
        resume(other, WeightedLeastSquares().solve(EstimationProblem(information)))
    with pytest.raises(EstimationError, match="shape"):
        begin(information, ForgettingOptions(changing=np.ones(3, dtype=np.bool_)))

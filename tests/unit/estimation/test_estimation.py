"""Least squares on factors: against dense rows, textbook deviations, rank, intervals, friction by recording."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.estimate_record import Estimate, standard_parameters, torque_parameters
from armid.estimation.estimators import OrdinaryLeastSquares, WeightedLeastSquares
from armid.estimation.fit_result import POORLY_IDENTIFIED, Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.least_squares import Solution
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.uncertainty.covariance_choice_thresholds import FEWEST_BLOCKS
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, merge, select, total
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RigidBody, RotorInertia, Viscous
from informed import NOISE, RATE, Arm, branching_arm, dense, recorded
from problems import one_run, raw
from trees import chain, robot_of

OLS, WLS = OrdinaryLeastSquares(), WeightedLeastSquares()

SAME = 1e-9
"""Relative difference of two ways to compute one number: rounding times a condition number of a few hundred."""

SETTLED = 1e-7
"""The same where the iteration of weights ends at a relative change of 1e-9."""

UNEQUAL = np.array([1.0, 0.1, 3.0, 0.4])
"""Noise of the four joints."""


@cache
def arm() -> Arm:
    return branching_arm()


def noisy_rows(seed: int = 1, noise: Array | float = NOISE, **kinds: object) -> tuple[Information, Array, Array]:
    """Information, dense rows (N, n, b) and torque (N, n) of one recording."""
    motion, torque = recorded(arm(), seed, noise=0.0)
    torque = torque + noise * np.random.default_rng(seed + 100).normal(size=torque.shape)
    run = replace(one_run(motion, torque, RATE), **kinds)  # pyright: ignore[reportArgumentType]
    rows = dense(arm(), run)
    return accumulate_information(arm()[0], arm()[1], raw(run)), rows[:, :, :-1], rows[:, :, -1]


def least_squares(rows: Array, torque: Array) -> tuple[Array, Array, Array]:
    """Solution, textbook covariance (2.46) and residuals of stacked rows (N, n, b)."""
    b = rows.shape[2]
    A, y = rows.reshape(-1, b), torque.reshape(-1)
    values = np.linalg.lstsq(A, y, rcond=None)[0]
    residual = y - A @ values
    variance = residual @ residual / (len(y) - b)  # (2.44), with the square that it lacks
    return values, variance * np.linalg.inv(A.T @ A), residual.reshape(torque.shape)


def assert_same(found: Array, expected: Array, tolerance: float = SAME) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


# Against dense rows --------------------------------------------------------------------------------------------


def test_ols_is_lstsq_of_the_stacked_rows_with_textbook_deviations():
    information, rows, torque = noisy_rows()
    fit = OLS.solve(EstimationProblem(information))
    values, covariance, residual = least_squares(rows, torque)
    assert_same(fit.values, values)
    np.testing.assert_allclose(fit.deviation, np.sqrt(np.diag(covariance)), rtol=SETTLED)
    np.testing.assert_allclose(fit.relative_deviation, 100 * fit.deviation / np.abs(values), rtol=SETTLED)
    np.testing.assert_allclose(fit.residual_rms, np.sqrt(np.mean(residual**2, axis=0)), rtol=SAME)
    assert (fit.rows == len(rows)).all()


def test_wls_is_dense_reweighted_least_squares():
    """Weights are the deviations of the joints' residuals, each with the degrees of freedom that it spent."""
    information, rows, torque = noisy_rows(noise=UNEQUAL)
    fit = WLS.solve(EstimationProblem(information))
    deviation = np.ones(4)
    for _ in range(8):
        weighted = rows / deviation[:, None]
        values = np.linalg.lstsq(weighted.reshape(-1, rows.shape[2]), (torque / deviation).ravel(), rcond=None)[0]
        inverse = np.linalg.inv(np.tensordot(weighted, weighted, ([0, 1], [0, 1])))
        spent = (weighted @ inverse * weighted).sum(axis=(0, 2))
        deviation = np.sqrt(((torque - rows @ values) ** 2).sum(axis=0) / (len(rows) - spent))
    assert spent.sum() == pytest.approx(len(fit.names))
    assert_same(fit.values, values, SETTLED)
    np.testing.assert_allclose(fit.deviation, np.sqrt(np.diag(inverse)), rtol=SETTLED)
    np.testing.assert_allclose(deviation, UNEQUAL, rtol=0.1)  # which it was after
    better = np.linalg.norm((fit.values - arm()[2]) / fit.deviation)
    plain = np.linalg.norm((OLS.solve(EstimationProblem(information)).values - arm()[2]) / fit.deviation)
    assert better < 0.5 * plain


def test_masked_rows_count_for_nothing():
    mask = np.random.default_rng(0).random((1200, 4)) < 0.7
    information, rows, torque = noisy_rows(mask=mask)
    fit = OLS.solve(EstimationProblem(information))
    A, y = rows[mask], torque[mask]
    values = np.linalg.lstsq(A, y, rcond=None)[0]
    assert_same(fit.values, values)
    variance = np.sum((y - A @ values) ** 2) / (len(y) - len(values))
    np.testing.assert_allclose(fit.deviation, np.sqrt(variance * np.diag(np.linalg.inv(A.T @ A))), rtol=SETTLED)
    np.testing.assert_array_equal(fit.rows, mask.sum(axis=0))


@pytest.mark.parametrize("long", [False, True])
@pytest.mark.parametrize("method", [OLS, WLS])
def test_a_joint_of_which_no_row_counts_is_left_out(
    monkeypatch: pytest.MonkeyPatch, method: OrdinaryLeastSquares | WeightedLeastSquares, long: bool
):
    """The other joints' rows show its links' parameters, as far as they are theirs too; so also by products."""
    if long:
        monkeypatch.setattr("armid.information.accumulate.GRAM_ROWS", 100)
    model = DynamicsModel(arm()[0].robot, (RigidBody(),))
    base = find_base_parameters(model)
    motion, _ = recorded(arm(), 1)
    truth = np.random.default_rng(5).normal(size=base.count)
    torque = model.regressor(motion)[:, :, base.kept] @ truth + NOISE * np.random.default_rng(6).normal(
        size=motion.q.shape
    )
    run = one_run(motion, torque, RATE)
    fit = method.solve(
        EstimationProblem(accumulate_information(model, base, raw(replace(run, mask=run.mask & (np.arange(4) != 2)))))
    )
    assert fit.rows.tolist() == [1200, 1200, 0, 1200]
    assert (np.abs(fit.values - truth) < 5 * fit.deviation).all()


def test_condition_numbers_are_those_of_the_stacked_regressor():
    information, rows, _ = noisy_rows()
    stacked = rows.reshape(-1, rows.shape[2])
    fit = WLS.solve(EstimationProblem(information))
    assert fit.condition == pytest.approx(np.linalg.cond(stacked), rel=SAME)
    scaled = stacked / np.linalg.norm(stacked, axis=0)
    assert fit.scaled_condition == pytest.approx(np.linalg.cond(scaled), rel=SAME)


# Rank ----------------------------------------------------------------------------------------------------------


def with_still_joint(joint: int) -> Information:
    motion, torque = recorded(arm(), 1)
    q, dq, ddq = motion.q.copy(), motion.dq.copy(), motion.ddq.copy()
    q[:, joint], dq[:, joint], ddq[:, joint] = 0.3, 0.0, 0.0
    run = one_run(Motion(motion.time, q, dq, ddq), torque, RATE)
    return accumulate_information(arm()[0], arm()[1], raw(run))


@pytest.mark.parametrize(("joint", "unseen"), [(2, "FV_3, FS_3"), (3, "FV_4, FS_4")])
@pytest.mark.parametrize("method", [OLS, WLS])
def test_parameters_that_stand_alone_are_named_each_by_itself(method, joint: int, unseen: str):
    with pytest.raises(EstimationError) as caught:
        method.solve(EstimationProblem(with_still_joint(joint)))
    assert caught.value.problem.endswith(f"31 of 33 base parameters; they do not determine {unseen}.")
    assert "moves the joints" in caught.value.remedy


def test_parameters_that_only_show_together_are_named_as_sets():
    """Joint 1 stands still: gravity's part of its torque is constant and cannot be told from the offset."""
    with pytest.raises(EstimationError) as caught:
        OLS.solve(EstimationProblem(with_still_joint(0)))
    problem = caught.value.problem
    assert "26 of 33" in problem and "XXR_1, FV_1, FS_1;" in problem
    assert "MXR_1 and FO_1 separately" in problem and "MYR_1 and FO_1 separately" in problem
    assert problem.count(" separately") == 33 - 26 - 3


def test_fewer_rows_than_parameters_are_refused():
    motion, torque = recorded(arm(), 1)
    few = accumulate_information(arm()[0], arm()[1], raw(one_run(motion[slice(0, 8)], torque[:8], RATE)))
    with pytest.raises(EstimationError, match="32 usable rows, which cannot determine 33 base parameters"):
        OLS.solve(EstimationProblem(few))


def test_as_many_rows_as_parameters_solve_exactly():
    """A single joint, two unknowns, two samples: an equation, not an estimate."""
    robot = robot_of(chain("R", [np.eye(3)], [[0.0, 0.0, 0.0]], [0.0, 0.0, -9.81]))
    model = DynamicsModel(robot, (RotorInertia(), Viscous()))
    base = find_base_parameters(model)
    motion = Motion([0.0, 0.1], [[0.0], [0.1]], [[1.0], [2.0]], [[0.5], [-1.0]])
    fit = OLS.solve(
        EstimationProblem(accumulate_information(model, base, raw(one_run(motion, np.array([[2.0], [1.0]]), 10.0))))
    )
    found = dict(zip(fit.names, fit.values, strict=True))
    # 0.5 IA + FV = 2 and -IA + 2 FV = 1
    assert found == pytest.approx({"IA_1": 1.5, "FV_1": 1.25})


def test_weights_that_do_not_settle_are_an_error():
    information, _, _ = noisy_rows(noise=UNEQUAL)
    with pytest.raises(EstimationError, match="did not converge in 2 iterations") as caught:
        WeightedLeastSquares(iterations=2).solve(EstimationProblem(information))
    assert "ols" in caught.value.remedy


# The mark of poor identification -------------------------------------------------------------------------------


def fit_with(values: list[float], deviation: list[float]) -> Fit:
    b = len(values)
    names = tuple("abcdef"[:b])
    return Fit(names, values, deviation, np.diag(deviation) ** 2, "white", 9.0, [0.0], np.array([10]), 1.0, 1.0)


def test_a_relative_deviation_above_the_bound_is_poor_whatever_the_others_are():
    fit = fit_with([2.0, -1.0, 0.5, 0.01], [0.0002, 0.199, 0.101, 0.0001])
    np.testing.assert_allclose(fit.relative_deviation, [0.01, 19.9, 20.2, 1.0])
    assert POORLY_IDENTIFIED == 20.0
    assert fit.poorly_identified.tolist() == [False, False, True, False]


def test_a_value_of_zero_is_infinitely_uncertain_and_poor():
    fit = fit_with([2.0, 0.0], [0.02, 0.1])
    assert fit.relative_deviation.tolist() == [1.0, np.inf]
    assert fit.poorly_identified.tolist() == [False, True]


# Intervals -----------------------------------------------------------------------------------------------------


def test_intervals_are_those_of_student():
    values, covariance, one = np.array([1.0, -2.0]), np.diag([0.04, 1.0]), np.ones(1)
    fit = Fit(("a", "b"), values, np.ones(2), covariance, "block", 5.0, one, np.ones(1, dtype=np.int64), 1.0, 1.0)
    # t(0.975; 5) = 2.570582 from printed tables.
    np.testing.assert_allclose(fit.intervals, [[1 - 0.5141164, 1 + 0.5141164], [-4.570582, 0.570582]], atol=1e-6)


def test_few_blocks_fall_back_to_white_residuals_and_say_so():
    motion, torque = recorded(arm(), 1)
    rows_each = motion.samples // (FEWEST_BLOCKS - 1) + 1
    few = accumulate_information(arm()[0], arm()[1], raw(one_run(motion, torque, RATE, block_rows=rows_each)))
    assert few.blocks == FEWEST_BLOCKS - 1
    fit = estimate(EstimationProblem(few), OLS)
    assert fit.covariance_kind == "white" and (fit.freedom == 4 * motion.samples - 33).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), fit.deviation)
    rows_each = motion.samples // FEWEST_BLOCKS
    enough = accumulate_information(arm()[0], arm()[1], raw(one_run(motion, torque, RATE, block_rows=rows_each)))
    assert estimate(EstimationProblem(enough), OLS).covariance_kind == "block"


def test_blocks_of_which_no_row_counts_are_no_blocks():
    """All rows stand in three of 24 blocks, whose gradients all but cancel: their scatter says nothing."""
    mask = np.repeat(np.isin(np.arange(1200) // 50, (2, 10, 17))[:, None], 4, axis=1)
    information, _, _ = noisy_rows(mask=mask)
    fit = estimate(EstimationProblem(information), OLS)
    assert information.blocks == 24 and fit.covariance_kind == "white"
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), fit.deviation)


@pytest.mark.parametrize("method", [OLS, WLS], ids=["ols", "wls"])
def test_block_covariance_is_the_jackknife_of_dense_estimates(method: OrdinaryLeastSquares | WeightedLeastSquares):
    """Each block of rows left out in turn, weights as they are."""
    information, rows, torque = noisy_rows(noise=UNEQUAL)
    fit = estimate(EstimationProblem(information), method)
    weights = fit.weights
    A, y = rows * weights[:, None], torque * weights
    changes = []
    for block in range(24):
        keep = np.arange(1200) // 50 != block
        without = np.linalg.lstsq(A[keep].reshape(-1, 33), y[keep].ravel(), rcond=None)[0]
        changes.append(without - fit.values)
    expected = np.cov(np.array(changes).T, bias=True) * 23
    assert fit.covariance_kind == "block" and (fit.freedom == 23).all()
    assert_same(fit.covariance, expected, SETTLED)


CORRELATION = 0.95
"""From row to row at 100 Hz: residuals remember a fifth of a second, as those of arms do."""


def test_intervals_cover_where_residuals_are_correlated():
    """First-order autoregressive noise, 24 s in blocks of 1 s, 30 recordings of 7 parameters."""
    robot = robot_of(chain("RR", [np.eye(3)] * 2, [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]], [0.0, -9.81, 0.0]))
    model = DynamicsModel(robot, (RigidBody(), Viscous()))
    base = find_base_parameters(model)
    pair = (model, base, np.random.default_rng(8).normal(size=base.count))
    motion, clean = recorded(pair, 4, seconds=24.0, noise=0.0)
    block, white = [], []
    for seed in range(30):
        noise = np.random.default_rng(seed).normal(size=clean.shape)
        for k in range(1, len(noise)):
            noise[k] = CORRELATION * noise[k - 1] + np.sqrt(1 - CORRELATION**2) * noise[k]
        information = accumulate_information(model, base, raw(one_run(motion, clean + noise, RATE, block_rows=100)))
        fit = WLS.solve(EstimationProblem(information))
        for ends, inside in ((estimate_covariance(fit, information).intervals, block), (fit.intervals, white)):
            inside.append((ends[:, 0] <= pair[2]) & (pair[2] <= ends[:, 1]))
    assert np.mean(white) < 0.5  # what the textbook covers of 95 %
    assert np.mean(block) > 0.85


# Friction of its own for each recording --------------------------------------------------------------------------


def two_recordings(frictions: tuple[Array, Array]) -> tuple[Information, Array, Array]:
    """Information on two recordings, dense rows with the friction columns of each apart, and torque."""
    model, base, _ = arm()
    own = friction_columns()
    parts, rows, sides = [], [], []
    for index, friction in enumerate(frictions):
        motion, _ = recorded(arm(), 10 + index, seconds=8.0)
        columns = model.regressor(motion)[:, :, base.kept]
        torque = columns @ friction + NOISE * np.random.default_rng(index).normal(size=motion.q.shape)
        parts.append(replace(one_run(motion, torque, RATE), recording=index))
        apart = [columns[:, :, own] * (index == k) for k in range(2)]
        rows.append(np.concatenate([columns[:, :, ~own], *apart], axis=2))
        sides.append(torque)
    return accumulate_information(model, base, raw(*parts)), np.concatenate(rows), np.concatenate(sides)


def friction_columns() -> NDArray[np.bool_]:
    model, base, _ = arm()
    return np.array([model.parameters[k].kind != RigidBody.name for k in base.kept])


def warm_and_cold() -> tuple[Array, Array]:
    """True parameters of two recordings: the same links, 40 % more friction when cold."""
    warm, own = arm()[2], friction_columns()
    return warm, np.where(own, 1.4 * warm, warm)


def test_friction_of_each_recording_is_a_dense_problem_with_columns_of_its_own():
    information, rows, torque = two_recordings(warm_and_cold())
    apart = separate_by_recording(information, friction_columns())
    fit = OLS.solve(EstimationProblem(apart))
    values, covariance, _ = least_squares(rows, torque)
    assert_same(fit.values, values)
    np.testing.assert_allclose(fit.deviation, np.sqrt(np.diag(covariance)), rtol=SETTLED)
    names, own = np.array(arm()[1].names), friction_columns()
    assert fit.names == (*names[~own], *(f"{n}[1]" for n in names[own]), *(f"{n}[2]" for n in names[own]))


def test_friction_of_each_recording_is_recovered():
    warm, cold = warm_and_cold()
    information, _, _ = two_recordings((warm, cold))
    own = friction_columns()
    apart = WLS.solve(EstimationProblem(separate_by_recording(information, own)))
    truth = np.concatenate([warm[~own], warm[own], cold[own]])
    assert (np.abs(apart.values - truth) < 5 * apart.deviation).all()
    together = WLS.solve(EstimationProblem(information))
    assert np.linalg.norm(together.residual_rms) > 1.5 * np.linalg.norm(apart.residual_rms)


def test_one_recording_or_nothing_of_its_own_changes_nothing():
    information, _, _ = noisy_rows()
    assert separate_by_recording(information, friction_columns()) is information
    two, _, _ = two_recordings(warm_and_cold())
    assert separate_by_recording(two, np.zeros(33, dtype=bool)) is two


def test_recordings_keep_their_blocks_and_merge_first_or_last():
    """Separating what was merged is the same as separating with blocks of other recordings in between."""
    information, _, _ = two_recordings(warm_and_cold())
    first = np.flatnonzero(information.recording == 0)
    shuffled = [k for pair in zip(first, np.flatnonzero(information.recording == 1), strict=False) for k in pair]
    mixed = merge([select(information, np.array([k])) for k in shuffled])
    apart = separate_by_recording(mixed, friction_columns())
    np.testing.assert_array_equal(apart.recording, mixed.recording)
    np.testing.assert_array_equal(apart.rows, mixed.rows)
    expected = OLS.solve(EstimationProblem(separate_by_recording(information, friction_columns())))
    assert_same(OLS.solve(EstimationProblem(apart)).values, expected.values)


# The estimate --------------------------------------------------------------------------------------------------


def estimate_of(fit: Fit) -> Estimate:
    return Estimate("arm", "ols", (), arm()[1], fit)


def test_torque_parameters_give_the_torque_of_the_base_parameters():
    information, rows, _ = noisy_rows()
    fit = OLS.solve(EstimationProblem(information))
    motion, _ = recorded(arm(), 1)
    torque = arm()[0].torque(motion, torque_parameters(arm()[1], fit))
    assert_same(torque, rows @ fit.values)


def test_of_several_frictions_the_mean_is_used():
    information, _, _ = two_recordings(warm_and_cold())
    own, base = friction_columns(), arm()[1]
    fit = OLS.solve(EstimationProblem(separate_by_recording(information, own)))
    theta = torque_parameters(base, fit)[base.kept]
    shared = int((~own).sum())
    np.testing.assert_array_equal(theta[~own], fit.values[:shared])
    np.testing.assert_allclose(theta[own], fit.values[shared:].reshape(2, -1).mean(axis=0))


def test_only_parameters_that_stand_alone_have_a_value_of_their_own():
    information, _, _ = noisy_rows()
    estimate = estimate_of(OLS.solve(EstimationProblem(information)))
    listed = {each["name"]: each for each in standard_parameters(estimate)}
    assert tuple(listed) == arm()[1].standard_names
    row = estimate.fit.names.index("FV_2")
    assert listed["FV_2"] == {
        "name": "FV_2",
        "value": estimate.fit.values[row],
        "unit": "N·m·s/rad",
        "interval95": estimate.intervals[row].tolist(),
        "status": "identified",
    }
    for name in ("M_1", "MX_1", "XX_1", "M_4"):  # without effect, kept in a group, kept in a group, removed
        assert (listed[name]["value"], listed[name]["status"]) == (None, "not identifiable"), name


# Uncertain torque scales --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [OLS, WLS], ids=["ols", "wls"])
def test_intervals_know_of_uncertain_drive_gains(method: OrdinaryLeastSquares | WeightedLeastSquares):
    """The share of the gains is the scatter of estimates from torques scaled at random."""
    information, _, _ = noisy_rows()
    deviation = np.array([0.1, 0.0, 0.05, 0.02])
    plain = estimate(EstimationProblem(information), method)
    unsure = replace(information, scale_deviation=deviation)
    added = estimate(EstimationProblem(unsure), method).covariance - plain.covariance
    rng = np.random.default_rng(2)
    shifts = []
    for _ in range(400):
        scale = 1.0 + deviation * rng.normal(size=4)
        joints = []
        for joint, by in zip(information.joints, scale, strict=True):
            R = joint.R.copy()
            R[:, :, -1] *= by
            joints.append(replace(joint, R=R))
        whole = total(replace(information, joints=tuple(joints)))
        shifts.append(Solution(whole, plain.weights).values - plain.values)
    found = np.mean(np.square(shifts), axis=0)
    # 400 draws of four normal numbers: their variance is known to 7 %, so to 30 % with room.
    np.testing.assert_allclose(np.diag(added), found, rtol=0.3, atol=1e-9 * found.max())

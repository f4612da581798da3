"""Folds are segments of one run, and the error of parameters on a fold is that of its rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.crossvalidation import (
    folds,
    held_out_error,
    held_out_squares,
    one_standard_error,
    split,
    training_information,
)
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.least_squares import solve
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, select, stack, total
from informed import RATE, branching_arm, dense, recorded
from problems import one_run, raw

ARM = branching_arm()

SAME = 1e-9
"""Relative difference of two ways to one number: rounding times a condition number of a few hundred."""


def information_of(*seconds: float) -> Information:
    """A run for each duration."""
    runs = [one_run(*recorded(ARM, k, seconds=each), RATE) for k, each in enumerate(seconds)]
    return accumulate_information(ARM[0], ARM[1], raw(*runs))


def test_folds_are_segments_of_one_run_with_about_the_same_rows():
    information = information_of(12.0, 30.0, 8.0)
    fold = folds(information)
    assert (np.diff(fold) >= 0).all() and len(np.unique(fold)) == fold.max() + 1 == 5
    rows = np.array([information.rows[fold == k].sum() for k in range(5)])
    assert rows.max() <= 1.5 * rows.min()
    assert all(len(np.unique(information.run[fold == k])) == 1 for k in range(5))


def test_a_short_run_joins_a_neighbour():
    information = information_of(20.0, 1.0, 20.0, 1.0)
    fold = folds(information, 4)
    assert len(np.unique(fold)) == 4
    for run in (1, 3):
        assert np.isin(fold[information.run == run], fold[information.run != run]).all()


@pytest.mark.parametrize("count", [1, 3, 1000])
def test_there_are_no_more_folds_than_asked_for_or_than_blocks(count: int):
    information = information_of(10.0)
    assert len(np.unique(folds(information, count))) == min(count, information.blocks)


def test_every_fold_has_rows_where_blocks_have_none():
    information = information_of(20.0)
    rows = information.rows.copy()
    rows[5:25] = 0
    fold = folds(replace(information, rows=rows), 5)
    assert all(rows[fold == k].any() for k in np.unique(fold))


def test_parts_are_what_they_are_made_of():
    information = information_of(12.0, 6.0)
    fold = folds(information)
    parts = split(information, fold)
    assert len(parts) == len(np.unique(fold))
    for k, part in enumerate(parts):
        near = training_information(information, fold == k)
        for kept, blocks in ((part.held_out, fold == k), (part.training, (fold != k) & ~near)):
            expected = total(select(information, blocks))
            np.testing.assert_array_equal(kept.rows, expected.rows)
            for a, b in zip(kept.joints, expected.joints, strict=True):
                np.testing.assert_allclose(a.R[0].T @ a.R[0], b.R[0].T @ b.R[0], rtol=SAME, atol=SAME)


def test_blocks_beside_a_fold_in_its_run_do_not_train():
    information = information_of(12.0, 12.0)
    first, last = np.flatnonzero(information.run == 0)[[0, -1]]
    fold = np.zeros(information.blocks, dtype=np.int64)
    fold[first + 5 : first + 8] = 1
    fold[last + 1 :] = 2  # a run of its own, which knows nothing of the one before
    trained = {k: part.training.rows.sum() for k, part in enumerate(split(information, fold))}
    expected = {1: [first + 4, first + 5, first + 6, first + 7, first + 8], 2: np.flatnonzero(fold == 2)}
    for k, without in expected.items():
        assert trained[k] == information.rows.sum() - information.rows[without].sum()


def test_nothing_is_split_where_a_fold_has_only_neighbours():
    information = information_of(12.0)
    assert split(select(information, np.arange(2)), np.arange(2)) == ()


def apart(*seconds: float) -> Information:
    """Every recording with friction of its own."""
    together = information_of(*seconds)
    together = replace(together, recording=together.run)
    return separate_by_recording(together, np.array([name[0] == "F" for name in together.names]))


@pytest.mark.parametrize("seconds", [(8.0,) * 6, (4.0, 20.0), (30.0, 6.0, 6.0)])
def test_every_fold_trains_on_each_recording_that_has_parameters_of_its_own(seconds: tuple[float, ...]):
    information = apart(*seconds)
    fold = folds(information)
    assert len(np.unique(fold)) >= 2
    for recording in range(len(seconds)):
        segment = fold[information.recording == recording]
        assert (np.diff(segment) >= 0).all() and len(np.unique(segment)) == len(np.unique(fold))
    for part in split(information, fold):
        A, _ = stack(part.training)
        assert (np.abs(A).max(axis=0) > 0.0).all()  # no parameter is judged that no row has shown


def test_a_recording_too_short_to_leave_a_part_out_is_refused_where_it_has_parameters_of_its_own():
    information = apart(12.0, 12.0)
    few = np.concatenate([np.flatnonzero(information.recording == 0), np.flatnonzero(information.recording == 1)[:3]])
    with pytest.raises(EstimationError, match="too short to leave out a part of it"):
        folds(select(information, few))


def test_one_fold_leaves_nothing_to_train_on():
    information = information_of(3.0)
    assert split(information, np.zeros(information.blocks, dtype=np.int64)) == ()


def test_squares_are_those_of_the_rows():
    motion, torque = recorded(ARM, 3)
    run = one_run(motion, torque, RATE)
    rows = dense(ARM, run)
    values = np.random.default_rng(1).normal(size=ARM[1].count)
    information = accumulate_information(ARM[0], ARM[1], raw(run))
    expected = np.sum((rows[:, :, -1] - rows[:, :, :-1] @ values) ** 2, axis=0)
    np.testing.assert_allclose(held_out_squares(information, values), expected, rtol=SAME)
    weights = np.array([1.0, 2.0, 0.5, 3.0])
    found = held_out_error(information, values, weights)
    assert found == pytest.approx(weights**2 @ expected / rows[:, :, 0].size, rel=SAME)


def test_an_estimate_errs_more_on_what_it_has_not_seen():
    information = information_of(12.0, 12.0)
    weights = np.ones(information.n)
    for part in split(information, folds(information)):
        values = np.asarray(solve(part.training, weights).values)
        A, y = stack(part.held_out)
        own = np.asarray(np.linalg.lstsq(A, y, rcond=None)[0], dtype=np.float64)
        assert held_out_error(part.held_out, values, weights) > held_out_error(part.held_out, own, weights)


def test_the_simplest_candidate_within_one_standard_error_is_taken():
    level = np.array([1.0, 5.0, 2.0, 9.0])  # folds differ far more than candidates
    excess = np.array([[0.5, 0.6, 0.4, 0.5], [0.2, -0.2, 0.1, -0.05], [0.0, 0.0, 0.0, 0.0], [0.1, 0.1, 0.1, 0.1]])
    assert one_standard_error(level + excess) == 1
    assert one_standard_error((level + excess)[[0, 2, 3]]) == 1  # the best itself
    assert one_standard_error((level + excess)[:, :1]) == 2  # one fold has no standard error


def test_a_candidate_that_failed_is_not_taken():
    errors = np.array([[1.0, np.inf], [1.0, 1.2], [0.9, 1.1]])
    assert one_standard_error(errors) in (1, 2)

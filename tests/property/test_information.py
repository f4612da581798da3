"""Information keeps everything an estimate needs, however recordings are cut, masked and merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.dataclass_files import load, save
from armid.errors import ArmidError
from armid.information import accumulate
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, merge, select, stack, total
from armid.maths.linalg import condition, scaled_condition
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from informed import EXACT, RATE, assert_products, assert_says, branching_arm, dense, recorded, solved
from problems import one_run, raw

EPSILON = float(np.finfo(float).eps)

REORDERED = 100.0
"""Estimates from the same rows in another order may differ by so many ε times the condition number."""


@pytest.fixture(scope="module")
def arm():
    return branching_arm()


# Unfiltered ----------------------------------------------------------------------------------------------------


def test_noise_free_data_give_the_truth_back(arm):
    model, base, truth = arm
    motion, torque = recorded(arm, 1, noise=0.0)
    information = accumulate_information(model, base, raw(one_run(motion, torque, RATE)))
    assert information.names == base.names
    assert information.rows.sum(axis=0).tolist() == [motion.samples] * model.n
    for weights in (None, np.array([1.0, 3.0, 0.1, 10.0])):
        assert np.linalg.norm(solved(information, weights) - truth) <= 1e-9 * np.linalg.norm(truth)


def test_information_is_that_of_the_dense_rows(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 2)
    run = one_run(motion, torque, RATE, block_rows=130)
    information = accumulate_information(model, base, raw(run))
    rows = dense(arm, run)
    assert information.blocks == 10
    assert_says(information, rows)
    for block in range(10):
        assert_says(select(information, np.array([block])), rows[run.block == block])


@pytest.mark.parametrize(("step", "offset"), [(1, 0), (3, 0), (4, 2), (50, 17)])
def test_open_bands_keep_the_rows_of_the_output_grid(arm, step, offset):
    model, base, _ = arm
    motion, torque = recorded(arm, 3)
    run = one_run(motion, torque, RATE, step=step, offset=offset, block_rows=7)
    assert_says(accumulate_information(model, base, raw(run)), dense(arm, run)[offset::step])


@pytest.mark.parametrize("by_gram", [False, True])
@pytest.mark.parametrize("chunk", [1, 64, 333, 10_000])
def test_chunks_and_threads_do_not_matter(arm, monkeypatch, chunk, by_gram):
    """Blocks longer and shorter than a chunk; a block in several chunks is put together again."""
    model, base, _ = arm
    motion, torque = recorded(arm, 4, seconds=8.0)
    run = one_run(motion, torque, RATE, block_rows=150)
    monkeypatch.setattr(accumulate, "GRAM_ROWS", 0 if by_gram else 10**9)
    plain = accumulate_information(model, base, raw(run))
    monkeypatch.setattr(accumulate, "CHUNK", chunk)
    pieced = accumulate_information(model, base, raw(run), threads=3)
    assert np.array_equal(plain.rows, pieced.rows)
    assert plain.made_by == pieced.made_by
    rows = dense(arm, run)
    for block in range(plain.blocks):
        assert_says(select(pieced, np.array([block])), rows[run.block == block])
    limit = REORDERED * EPSILON * condition(stack(plain)[0])
    assert np.linalg.norm(solved(pieced) - solved(plain)) <= limit * np.linalg.norm(solved(plain))


def test_merge_in_any_order_and_chunking(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 5, seconds=20.0)
    whole = accumulate_information(model, base, raw(one_run(motion, torque, RATE, block_rows=motion.samples)))
    expected = solved(whole)
    limit = REORDERED * EPSILON * condition(stack(whole)[0]) * np.linalg.norm(expected)
    rng = np.random.default_rng(0)
    for pieces in (2, 5, 40):
        cuts = np.sort(rng.choice(np.arange(1, motion.samples), pieces - 1, replace=False))
        parts = [
            accumulate_information(model, base, raw(one_run(motion[slice(a, b)], torque[a:b], RATE, block_rows=11)))
            for a, b in zip([0, *cuts], [*cuts, motion.samples], strict=True)
        ]
        shuffled = [parts[k] for k in rng.permutation(pieces)]
        middle = pieces // 2
        for merged in (
            merge(parts),
            merge(shuffled),
            merge([merge(parts[:middle]), merge(parts[middle:])]),
            merge([total(merge(shuffled[:middle])), total(merge(shuffled[middle:]))]),
            total(merge(shuffled)),
        ):
            assert np.linalg.norm(solved(merged) - expected) <= limit
            assert np.array_equal(merged.rows.sum(axis=0), whole.rows.sum(axis=0))


def test_merge_is_associative_to_the_bit(arm):
    model, base, _ = arm
    a, b, c = (accumulate_information(model, base, raw(one_run(*recorded(arm, seed), RATE))) for seed in (1, 2, 3))
    left, right = merge([merge([a, b]), c]), merge([a, merge([b, c])])
    for x, y in zip(left.joints, right.joints, strict=True):
        assert np.array_equal(x.R, y.R)
    assert np.array_equal(left.rows, right.rows)


def test_information_about_other_parameters_is_not_merged(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 6)
    mine = accumulate_information(model, base, raw(one_run(motion, torque, RATE)))
    other = DynamicsModel(model.robot, (RigidBody(), Viscous(), Coulomb(width=0.1)))
    its = accumulate_information(other, find_base_parameters(other), raw(one_run(motion, torque, RATE)))
    with pytest.raises(ArmidError, match="same base parameters"):
        merge([mine, its])
    with pytest.raises(ArmidError, match="no information"):
        merge([])


def test_select_takes_blocks_also_twice(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 7)
    run = one_run(motion, torque, RATE, block_rows=100)
    information = accumulate_information(model, base, raw(run))
    rows = dense(arm, run)
    drawn = np.array([3, 3, 0, 11])
    again = select(information, drawn)
    assert again.blocks == 4
    assert_says(again, np.concatenate([rows[run.block == k] for k in drawn]))
    odd = np.arange(12) % 2 == 1
    assert_says(select(information, odd), rows[run.block % 2 == 1])


def test_several_runs_keep_their_names(arm):
    model, base, _ = arm
    runs = [one_run(*recorded(arm, seed), RATE, block_rows=400) for seed in (8, 9, 10)]
    runs[2] = replace(runs[2], recording=1)
    told = []
    information = accumulate_information(model, base, raw(*runs), progress=lambda done, of: told.append((done, of)))
    assert information.run.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert information.recording.tolist() == [0] * 6 + [1] * 3
    assert_says(information, np.concatenate([dense(arm, run) for run in runs]))
    assert told == sorted(told)
    assert told[-1] == (3600, 3600)


def test_masked_rows_do_not_count(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 11)
    run = one_run(motion, torque, RATE, step=2, offset=1)
    mask = np.random.default_rng(0).random(run.mask.shape) < 0.7
    mask[:130] = False
    run = replace(run, mask=mask)
    information = accumulate_information(model, base, raw(run))
    assert_says(information, dense(arm, run)[1::2] * mask[:, :, None])
    assert np.array_equal(information.rows.sum(axis=0), mask.sum(axis=0))
    assert not information.rows[:2].any()


def test_nothing_to_inform_of_is_refused(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 12)
    run = one_run(motion, torque, RATE)
    with pytest.raises(ArmidError, match="No row"):
        accumulate_information(model, base, raw(replace(run, mask=np.zeros_like(run.mask))))
    with pytest.raises(ArmidError, match="No row"):
        accumulate_information(model, base, raw())
    narrow = Motion(motion.time, motion.q[:, :3], motion.dq[:, :3], motion.ddq[:, :3])
    with pytest.raises(ArmidError, match="3 joints"):
        accumulate_information(model, base, raw(one_run(narrow, torque[:, :3], RATE)))


def test_one_row(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 13)
    run = one_run(motion[slice(5, 6)], torque[5:6], RATE)
    for band in (Band(), Band("butterworth", 5.0), Band("fir", 5.0, 4, "periodic")):
        information = accumulate_information(model, base, Observations((run,), band))
        assert information.rows.tolist() == [[1] * model.n]


# The faster way ------------------------------------------------------------------------------------------------


@pytest.fixture
def eager(monkeypatch):
    """Try products of columns on short recordings too."""
    monkeypatch.setattr(accumulate, "GRAM_ROWS", 100)


def test_products_are_kept_where_they_are_exact(arm, eager, monkeypatch):
    model, base, _ = arm
    motion, torque = recorded(arm, 14)
    run = one_run(motion, torque, RATE, block_rows=25)
    quick = accumulate_information(model, base, raw(run))
    assert quick.made_by.method == "products"
    monkeypatch.setattr(accumulate, "GRAM_ROWS", 10**9)
    careful = accumulate_information(model, base, raw(run))
    assert careful.made_by.method == "qr"
    assert_says(quick, dense(arm, run))
    for weights in (None, np.array([1.0, 3.0, 0.1, 10.0])):
        x, y = solved(quick, weights), solved(careful, weights)
        assert np.linalg.norm(x - y) <= EXACT * np.linalg.norm(y)
    # Blocks of a quarter of a second lack rank; their products must be right all the same.
    for a, b in zip(quick.joints, careful.joints, strict=True):
        for R, Q in zip(a.R, b.R, strict=True):
            assert_products(R, Q, EXACT)


def test_products_are_dropped_for_noise_free_data(arm, eager):
    """Their residual would be the root of rounding."""
    model, base, truth = arm
    motion, torque = recorded(arm, 15, noise=0.0)
    information = accumulate_information(model, base, raw(one_run(motion, torque, RATE)))
    assert information.made_by.method == "qr"
    assert np.linalg.norm(solved(information) - truth) <= 1e-11 * np.linalg.norm(truth)


def test_products_are_dropped_for_poor_data(arm, eager):
    model, base, truth = arm
    motion, torque = recorded(arm, 16)
    shrunk = np.array([1.0, 1e-3, 1.0, 1e-3])
    poor = Motion(motion.time, motion.q * shrunk, motion.dq * shrunk, motion.ddq * shrunk)
    torque = model.regressor(poor)[:, :, base.kept] @ truth + torque * 1e-3
    information = accumulate_information(model, base, raw(one_run(poor, torque, RATE)))
    assert scaled_condition(stack(total(information))[0]) > accumulate.GRAM_CONDITION
    assert information.made_by.method == "qr"


def test_products_are_dropped_where_they_cannot_even_see_the_condition(arm, eager):
    """A joint that stands still: rank is missing."""
    model, base, _ = arm
    motion, torque = recorded(arm, 17)
    moving = np.array([1.0, 0.0, 1.0, 1.0])
    still = Motion(motion.time, motion.q * moving, motion.dq * moving, motion.ddq * moving)
    information = accumulate_information(model, base, raw(one_run(still, torque, RATE)))
    assert information.made_by.method == "qr"


# On disk -------------------------------------------------------------------------------------------------------


def test_saved_and_loaded(arm, tmp_path):
    model, base, _ = arm
    information = accumulate_information(model, base, raw(one_run(*recorded(arm, 28), RATE)))
    loaded = load(Information, save(information, tmp_path / "information.npz"))
    assert loaded.names == information.names
    assert loaded.made_by == information.made_by
    for name in ("rows", "run", "recording"):
        assert np.array_equal(getattr(loaded, name), getattr(information, name))
    for a, b in zip(loaded.joints, information.joints, strict=True):
        assert np.array_equal(a.R, b.R)
        assert np.array_equal(a.parameters, b.parameters)
        assert not a.R.flags.writeable
    assert np.array_equal(solved(merge([loaded, information])), solved(merge([information, loaded])))

"""Weighted rows: the same factors as those of the rows times the roots of their weights."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.information import kept_rows as module
from armid.information.accumulate import accumulate_information
from armid.information.base_regressor_layout import column_source
from armid.information.information import total
from armid.information.kept_rows import Batch, KeptRows, kept_rows
from armid.information.weighted_rows import weighted_information
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from informed import EXACT, RATE, assert_products, assert_says, branching_arm, dense, recorded
from problems import one_run, raw

ARM = branching_arm()
MODEL, BASE, _ = ARM

FILTERED = 1e-9
"""Relative difference of factors of filtered rows made in other batches."""


def once(batch: Batch, joint: int) -> Array:
    """Every row counts."""
    del joint
    return np.ones(len(batch.block))


def observations(band: Band | None = None) -> Observations:
    """Two runs, some rows of each masked, on every second sample."""
    runs = []
    for k in range(2):
        run = one_run(*recorded(ARM, k, seconds=6.0), RATE, step=2, block_rows=40)
        mask = np.random.default_rng(k).random(run.mask.shape) < 0.9
        runs.append(replace(run, mask=mask, recording=k))
    return Observations(tuple(runs), band or Band())


@pytest.mark.parametrize("band", [Band(), Band("butterworth", 8.0, 4, "drop")], ids=["open", "filtered"])
def test_weights_of_one_give_the_information_itself(band: Band):
    given = observations(band)
    expected = accumulate_information(MODEL, BASE, given)
    found = weighted_information(KeptRows(column_source(MODEL, BASE), given), once)
    for name in ("names", "rows", "run", "recording"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for a, b in zip(found.joints, expected.joints, strict=True):
        for R, S in zip(a.R, b.R, strict=True):
            assert_products(R, S, FILTERED)


def test_rows_are_multiplied_by_the_roots_of_their_weights():
    motion, torque = recorded(ARM, 5, seconds=5.0)
    run = one_run(motion, torque, RATE)
    weights = np.random.default_rng(2).random((len(run.block), MODEL.n))

    def weigh(batch: Batch, joint: int) -> Array:
        return weights[batch.begin : batch.begin + len(batch.block), joint]

    found = weighted_information(KeptRows(column_source(MODEL, BASE), raw(run)), weigh)
    assert_says(found, dense(ARM, run) * np.sqrt(weights)[:, :, None], EXACT)
    np.testing.assert_array_equal(found.rows.sum(axis=0), len(run.block))  # rows, whatever their weight


def test_a_run_as_one_block_says_the_same():
    every = KeptRows(column_source(MODEL, BASE), observations())
    apart, together = (weighted_information(every, once, blocks=blocks) for blocks in (True, False))
    assert together.blocks == 2
    for a, b in zip(total(apart).joints, total(together).joints, strict=True):
        assert_products(a.R[0], b.R[0], EXACT)


def test_rows_are_kept_only_while_they_are_few(monkeypatch: pytest.MonkeyPatch):
    source, given = column_source(MODEL, BASE), observations()
    few = KeptRows(source, given)
    assert [id(batch) for batch in few] == [id(batch) for batch in few]
    monkeypatch.setattr(module, "KEPT", 1000)
    many = KeptRows(source, given)
    first = weighted_information(many, once)
    assert {id(batch.x) for batch in list(many)}.isdisjoint({id(batch.x) for batch in list(few)})
    assert first.joints[0].R.tobytes() == weighted_information(few, once).joints[0].R.tobytes()
    assert [batch.x.tobytes() for batch in many] == [batch.x.tobytes() for batch in few]


def test_a_pass_that_was_broken_off_keeps_nothing():
    every = KeptRows(column_source(MODEL, BASE), observations())
    next(iter(every))
    assert len(list(every)) == 2


def test_rows_of_the_same_observations_are_shared_and_end_with_them():
    given = observations()
    assert kept_rows(MODEL, BASE, given) is kept_rows(MODEL, BASE, given)
    assert kept_rows(MODEL, BASE, given) is not kept_rows(MODEL, BASE, observations())
    alive = weakref.ref(kept_rows(MODEL, BASE, given))
    del given
    gc.collect()
    assert alive() is None

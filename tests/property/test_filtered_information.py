"""Torque and columns pass the same filter on their way into information, batch by batch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.information import filtering
from armid.information.accumulate import accumulate_information
from armid.information.information import select
from armid.maths.signals.zero_phase_filters import low_pass, periodic_filter, zero_phase
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from armid.model.motion import Motion
from informed import RATE, assert_says, branching_arm, dense, filtered, recorded, rows_between, solved
from problems import one_run

SETTLED = 1e-7
"""Products of columns filtered in batches: the filter has settled to 1e-9 of a jump where batches meet, and
columns that jump (friction) may do so there."""

ENDS = 1e-9
"""Products of columns of which only rows of the grid are filtered against columns filtered whole: the reflected ends
are some samples longer, and the filter has settled to 1e-9 there."""

IN_A_BLOCK = 1e-7
"""The same in one block: rounding of the filter is relative to the largest value of a column in the run, and a column
may be a millionth of that in the whole block."""

RECURSION = 1e-11
"""Rounding of the recursion in place of a Fourier transform, and what it leaves out at its ends."""

NOT_FELT = 1e-3
"""Products of columns filtered at an intermediate rate against full rate: a digital Butterworth falls a little faster
at the lower rate, where it has fallen most."""


@pytest.fixture(scope="module")
def arm():
    return branching_arm()


BANDS = [
    pytest.param(Band("butterworth", 4.0, 4, "drop"), id="butterworth-drop"),
    pytest.param(Band("butterworth", 4.0, 4, "periodic"), id="butterworth-periodic"),
    pytest.param(Band("butterworth", 6.0, 20, "pad"), id="order-20-pad"),
    pytest.param(Band("fir", 4.0, 4, "pad"), id="fir-pad"),
    pytest.param(Band("fir", 4.0, 4, "periodic"), id="fir-periodic"),
]

GRIDS = [(1, 0), (2, 1), (1, 17), (3, 2), (10, 0), (10, 7), (25, 13)]
"""Steps and offsets of the output grid at 200 Hz. The first three are denser than the bands need; a step of 3 does
not divide the period of 2000 samples."""


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(("step", "offset"), GRIDS)
def test_every_column_passes_the_same_filter_as_the_torque(arm, band, step, offset):
    model, base, _ = arm
    motion, torque = recorded(arm, 20, seconds=10.0, rate=200.0)
    run = one_run(motion, torque, 200.0, step=step, offset=offset, block_rows=20)
    information = accumulate_information(model, base, Observations((run,), band))
    assert information.made_by.method == "qr"
    rows = filtered(arm, run, band)
    assert_says(information, rows, ENDS)
    for block in (0, information.blocks - 1):
        assert_says(select(information, np.array([block])), rows[run.block == block], IN_A_BLOCK)


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(("step", "offset"), GRIDS)
@pytest.mark.parametrize("sizes", [(60, 100), (200, 37), (1000, 5000)])
def test_batches_do_not_matter(arm, band, step, offset, sizes, monkeypatch):
    model, base, _ = arm
    motion, torque = recorded(arm, 21, seconds=10.0, rate=200.0)
    run = one_run(motion, torque, 200.0, step=step, offset=offset, block_rows=20)
    mask = np.random.default_rng(0).random(run.mask.shape) < 0.9
    run = replace(run, mask=mask)
    monkeypatch.setattr(filtering, "BATCH", sizes[0])
    monkeypatch.setattr(filtering, "CHUNK", sizes[1])
    information = accumulate_information(model, base, Observations((run,), band))
    assert_says(information, filtered(arm, run, band) * mask[:, :, None], SETTLED)
    assert np.array_equal(information.rows.sum(axis=0), mask.sum(axis=0))


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize(("step", "offset"), GRIDS)
def test_filtered_noise_free_data_give_the_truth_back(arm, band, step, offset):
    """Whatever the filter does to edges and aliases, it does to both sides."""
    model, base, truth = arm
    motion, torque = recorded(arm, 22, seconds=10.0, rate=200.0, noise=0.0)
    run = one_run(motion, torque, 200.0, step=step, offset=offset)
    estimate = solved(accumulate_information(model, base, Observations((run,), band)))
    assert np.linalg.norm(estimate - truth) <= 1e-9 * np.linalg.norm(truth)


@pytest.mark.parametrize("step", [1, 5, 25])
@pytest.mark.parametrize("edges", ["periodic", "pad"])
def test_intermediate_rates_are_not_felt(arm, step, edges):
    """In the band they change 2e-5, so all steps give what one sharp filter at full rate gives, away from ends."""
    model, base, _ = arm
    motion, torque = recorded(arm, 23, seconds=10.0, rate=1000.0)
    band = Band("butterworth", 4.0, 4, edges)
    run = one_run(motion, torque, 1000.0, step=step)
    assert step == 25 or rows_between(run, band) > 1
    mask = np.ones_like(run.mask)
    if edges == "pad":
        mask[: 500 // step] = mask[-500 // step :] = False
    sharp = low_pass("butterworth", 4, 4.0, 1000.0)
    through = (periodic_filter if edges == "periodic" else zero_phase)(sharp, dense(arm, run))[::step]
    information = accumulate_information(model, base, Observations((replace(run, mask=mask),), band))
    assert_says(information, through * mask[:, :, None], NOT_FELT)


def test_a_filtered_torque_alone_is_biased(arm):
    """The one-sided band of published work: dense least squares with raw columns and filtered torque."""
    model, base, truth = arm
    motion, torque = recorded(arm, 24, noise=0.0)
    run = one_run(motion, torque, RATE, step=2)
    for edges in ("periodic", "pad"):
        band = Band("butterworth", 3.0, 4, edges, columns=False)
        rows = dense(arm, run)[::2]
        sharp = low_pass("butterworth", 4, 3.0, RATE)
        through = periodic_filter(sharp, torque) if edges == "periodic" else zero_phase(sharp, torque)
        rows[:, :, -1] = through[::2]
        information = accumulate_information(model, base, Observations((run,), band))
        assert_says(information, rows)
        assert np.linalg.norm(solved(information) - truth) > 1e-3 * np.linalg.norm(truth)


def test_rows_that_do_not_follow_each_other_are_never_filtered(arm):
    model, base, _ = arm
    motion, torque = recorded(arm, 25)
    shuffled = np.random.default_rng(0).permutation(motion.samples)
    states = Motion.of_states(motion.q[shuffled], motion.dq[shuffled], motion.ddq[shuffled])
    run = replace(one_run(states, torque[shuffled], RATE, step=3), consecutive=False)
    for band in (Band("butterworth", 4.0), Band("fir", 4.0, columns=False)):
        assert_says(accumulate_information(model, base, Observations((run,), band)), dense(arm, run)[::3])


def test_filtered_and_unfiltered_runs_together(arm):
    model, base, _ = arm
    band = Band("butterworth", 4.0, 4, "pad")
    smooth = one_run(*recorded(arm, 26), RATE)
    loose = replace(one_run(*recorded(arm, 27), RATE), consecutive=False)
    information = accumulate_information(model, base, Observations((smooth, loose), band))
    assert_says(information, np.concatenate([filtered(arm, smooth, band), dense(arm, loose)]), RECURSION)

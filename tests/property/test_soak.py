"""Long use in one process: memory stays flat, and results do not drift.

`ARMID_SOAK` multiplies the numbers of calls, blocks and identifications; with 50 there are 10^8 calls.
"""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from armid.estimation.recursive import recursive_estimate
from armid.estimation.recursive.state import ForgettingOptions
from armid.information.accumulate import accumulate_information
from armid.information.information import select
from armid.model.base_parameters import find_base_parameters
from armid.runs.callable_model import CallableModel
from armid.study.config import load_study
from armid.study.identify import identify
from coded import case
from labs import STUDY, small_model, small_truth, write_recordings, write_study
from problems import lively_motion, one_run, raw

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="the resident memory is not known"),
]

SCALE = int(os.environ.get("ARMID_SOAK", "1"))

CALLS, UPDATES, IDENTIFIED = 2_000_000 * SCALE, 5_000 * SCALE, 20 * SCALE

ALLOWANCE = 2.0
"""Growth of the resident memory over the second half of a soak [MB]: pages that the allocator keeps. Ten bytes lost
in each call would be 10 MB."""


def resident() -> float:
    """Resident memory [MB]."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_calls_of_a_model_need_no_memory_and_do_not_drift():
    each = case("iiwa14-r820")
    model = CallableModel(each.model, each.base, each.values)
    q, dq, ddq = (np.ascontiguousarray(x[0]) for x in (each.motion.q, each.motion.dq, each.motion.ddq))
    first = model.torque(q, dq, ddq)
    resident()
    counts, sizes = sys.getallocatedblocks(), []
    for _ in range(2):
        for _ in range(CALLS // 2):
            last = model.torque(q, dq, ddq)
        sizes.append(resident())
    assert np.array_equal(first, last)
    assert sizes[1] - sizes[0] < ALLOWANCE
    assert sys.getallocatedblocks() - counts < 1000


def test_identifications_in_one_process_need_no_more_memory(tmp_path: Path):
    write_recordings(tmp_path)
    study = load_study(write_study(tmp_path, STUDY))
    values, sizes = [], []
    for k in range(2 * IDENTIFIED):
        values.append(identify(study).estimate.fit.values)
        if k in (IDENTIFIED - 1, 2 * IDENTIFIED - 1):
            sizes.append(resident())
    assert all(np.array_equal(values[0], each) for each in values)
    assert sizes[1] - sizes[0] < ALLOWANCE


def test_an_endless_stream_needs_no_more_memory_and_the_estimate_stays():
    """Blocks of one motion come again and again; the estimate forgets old ones and stays within its intervals."""
    rng, model = np.random.default_rng(4), small_model()
    base, noise = find_base_parameters(model), 0.05
    motion = lively_motion(rng, 3, 100.0, 40.0)
    torque = model.torque(motion, small_truth()) + noise * rng.normal(size=(motion.samples, 3))
    information = accumulate_information(model, base, raw(one_run(motion, torque, 100.0, block_rows=50)))
    blocks = [select(information, np.array([k])) for k in range(information.blocks)]
    state, sizes, found = recursive_estimate.begin(blocks[0], ForgettingOptions(60.0)), [], []
    for k in range(UPDATES):
        state = recursive_estimate.update(state, blocks[k % len(blocks)], 0.5)
        if k in (UPDATES // 2, UPDATES - 1):
            sizes.append(resident())
        if k % len(blocks) == len(blocks) - 1 and k > 20 * len(blocks):
            found.append(recursive_estimate.fit(state).values)
    fit = recursive_estimate.fit(state)
    assert sizes[1] - sizes[0] < ALLOWANCE
    spread = np.ptp(found, axis=0) / np.sqrt(np.diag(fit.covariance))
    assert spread.max() < 0.1  # the blocks are the same, so nothing may wander
    assert np.isfinite(fit.covariance).all()

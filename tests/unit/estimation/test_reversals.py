"""Intervals where friction at reversals is another than the model's: they reach as far as it moves the estimate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import identify, load_study
from armid.estimation.estimate_record import Estimate
from armid.lab.inverse_dynamics_recording import record
from labs import (
    KNOWN_FRICTION,
    SENSORS,
    small_model,
    small_plan,
    small_truth,
    write_arm,
    write_recording,
    write_study,
)


def identified(folder: Path, lack: float, method: str = "wls") -> Estimate:
    """The small arm, with so much torque [N·m] against the turn at each reversal that the model does not have."""
    model, plan = small_model(), small_plan(1)
    log = record(model, small_truth(), plan, SENSORS, np.random.default_rng(3), repetitions=3)[0]
    assert log.effort is not None
    motion = plan.sample(SENSORS.rate, 3)
    usual = motion.dq.std(axis=0)
    bump = np.sign(motion.ddq) * np.exp(-((motion.dq / (0.05 * usual)) ** 2))
    write_arm(folder)
    write_recording(replace(log, effort=log.effort + lack * bump[: len(log.effort)]), folder / "log.csv")
    study = write_study(folder, KNOWN_FRICTION.format(log="log.csv") + f'[estimation]\nmethod = "{method}"\n')
    return identify(load_study(study)).estimate


@pytest.mark.parametrize("lack", [0.0, 2.0])
def test_intervals_reach_as_far_as_reversals_move_the_estimate(lack: float, tmp_path: Path):
    estimate = identified(tmp_path, lack)
    model = small_model()
    truth = estimate.base.values_of(small_truth())
    assert model.n == 3
    low, high = estimate.intervals.T
    assert ("reversals" in estimate.fit.report.why) == (lack > 0.0)
    assert np.mean((low <= truth) & (truth <= high)) >= 0.85


def test_one_parameter_has_one_interval_in_both_tables(tmp_path: Path):
    """A standard parameter alone reaches as far as its base parameter does, cut where physics forbids values."""
    estimate = identified(tmp_path, 2.0, "physical")
    fit, base = estimate.fit, estimate.base
    assert fit.standard is not None and "reversals" in fit.report.why
    alone = np.flatnonzero(np.count_nonzero(base.regrouping, axis=1) == 1)
    names = [base.standard_names[base.kept[k]] for k in alone]
    assert {"FV_1", "FS_2", "FS_3"} <= set(names)
    at = [fit.standard.names.index(name) for name in names]
    low, high = fit.intervals[[fit.names.index(base.names[k]) for k in alone]].T
    np.testing.assert_allclose(fit.standard.intervals[at, 1], high, rtol=1e-6)
    inner = fit.standard.intervals[at, 0] > 0.0
    np.testing.assert_allclose(fit.standard.intervals[at, 0][inner], low[inner], rtol=1e-6)

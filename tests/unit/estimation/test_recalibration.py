"""An arm whose friction or tool has changed, and what recalibration says of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.problem import EstimationProblem
from armid.estimation.update.recalibration import recalibrate_fit
from armid.estimation.update.stacked_problem import stack_problems
from carried import LOAD, arm, carrying, changing, known, load_columns

EXACT = 1e-7
"""Noise-free, over the largest parameter: rounding times a condition number of thousands, and unequal weights."""

EVERYTHING = np.ones(arm()[1].count, dtype=np.bool_)


@pytest.mark.parametrize("what", ["friction", "tool", "all"])
def test_noise_free_the_new_arm_is_exact(what: str):
    old, new = carrying(1, None), carrying(2, None, None if what == "friction" else LOAD, friction=1.5)
    own = EVERYTHING if what == "all" else changing()
    tool = load_columns() if what == "tool" else None
    found = recalibrate_fit(old.information, known(old.information), new.information, own, tool)
    np.testing.assert_allclose(found.fit.values, new.base_values, atol=EXACT * abs(new.base_values).max())
    before, after = (np.array([getattr(each, end) for each in found.changes]) for end in ("before", "after"))
    np.testing.assert_allclose(before, old.base_values, atol=EXACT * abs(new.base_values).max())
    np.testing.assert_array_equal(after, found.fit.values)


def test_what_has_changed_is_named_and_hardly_anything_else():
    rng = np.random.default_rng(1)
    old, new = carrying(1, rng), carrying(2, rng, friction=1.5)
    found = recalibrate_fit(old.information, known(old.information), new.information, changing())
    beyond = {each.name for each in found.changes if each.beyond}
    coulomb = {f"FS_{j}" for j in range(1, 7)}
    assert len(beyond & coulomb) >= 5
    assert len(beyond - {name for name, own in zip(found.fit.names, changing(), strict=True) if own}) <= 1
    changes = {each.name: each for each in found.changes}
    assert changes["FS_6"].ratio == pytest.approx(abs(changes["FS_6"].change) / changes["FS_6"].deviation)


def test_nothing_changed_says_nothing_changed():
    counted = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        old, new = carrying(1, rng), carrying(2, rng)
        found = recalibrate_fit(old.information, known(old.information), new.information, changing())
        counted += [each.beyond for each in found.changes]
    assert np.mean(counted) <= 0.08  # one in twenty by definition; friction's of one recording hang together


def test_the_rest_is_known_better_than_before():
    rng = np.random.default_rng(2)
    old, new = carrying(1, rng), carrying(2, rng, friction=1.5)
    fit = known(old.information)
    found = recalibrate_fit(old.information, fit, new.information, changing())
    shared = ~changing()
    assert (found.fit.deviation[shared] < fit.deviation[shared]).all()


@pytest.mark.parametrize("tool", [None, load_columns()], ids=["friction", "tool"])
def test_the_new_factors_have_the_new_estimate_as_their_optimum(tool: np.ndarray | None):
    """So that a recalibrated run can be recalibrated again, or carry a load."""
    rng = np.random.default_rng(3)
    old, new = carrying(1, rng), carrying(2, rng, None if tool is None else LOAD, friction=1.5)
    found = recalibrate_fit(old.information, known(old.information), new.information, changing(), tool)
    assert found.information.blocks == old.information.blocks + new.information.blocks
    again = WeightedLeastSquares().solve(EstimationProblem(found.information))
    # Ties of friction and other weights move it by a small part of its deviation.
    assert (np.abs(again.values - found.fit.values) <= 0.1 * found.fit.deviation).all()
    third = carrying(4, rng, None if tool is None else LOAD, friction=1.5)
    joined = stack_problems(found.information, found.fit, third.information, changing())
    assert joined.information.blocks == found.information.blocks + third.information.blocks


def test_gains_that_both_have_in_common_do_not_hide_a_change():
    rng = np.random.default_rng(4)
    pair = carrying(1, rng), carrying(2, rng, friction=1.5)
    old, new = (replace(each.information, scale_deviation=np.full(6, 0.3)) for each in pair)
    found = recalibrate_fit(old, known(old), new, changing())
    beyond = [each for each in found.changes if each.name.startswith("FS_") and each.beyond]
    assert len(beyond) >= 3
    width = np.sqrt(np.diag(found.fit.covariance))[list(found.fit.names).index("FS_1")]
    assert next(each for each in found.changes if each.name == "FS_1").deviation < width


def test_a_tool_that_the_recording_does_not_show_is_refused_by_name():
    rng = np.random.default_rng(5)
    old, new = carrying(1, rng), carrying(2, rng, LOAD, still=(0, 2, 3, 4, 5), seconds=8.0)
    with pytest.raises(EstimationError, match=r"do not determine the new values of .*_6"):
        recalibrate_fit(old.information, known(old.information), new.information, changing(), load_columns())


def test_joints_that_stand_still_keep_their_friction_with_wide_intervals():
    rng = np.random.default_rng(6)
    old, new = carrying(1, rng), carrying(2, rng, still=(5,), seconds=8.0)
    fit = known(old.information)
    found = recalibrate_fit(old.information, fit, new.information, changing())
    k = list(found.fit.names).index("FV_6")
    assert found.fit.values[k] == pytest.approx(fit.values[k], rel=0.05)
    assert found.fit.deviation[k] > 20.0 * fit.deviation[k]

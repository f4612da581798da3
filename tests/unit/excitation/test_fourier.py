"""Fourier excitations: exact derivatives, whole periods, stretching, and the plan on disk."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.fourier import Excitation, load_plan, required_series, save_plan
from armid.excitation.plan import Plan
from armid.excitation.thesis_plans import PLANS, builtin_plan

STEP, SLOPE = 1e-5, 1e-8
"""Central differences of a function of the order of one with that step."""

ROUNDING = 1e-12
"""Angles of a few hundred radians lose so much of their sine."""


@pytest.fixture
def excitation():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 3, 5))
    return Excitation(0.7, a, b, rng.normal(size=3), "arm")


def test_series_of_one_harmonic():
    """(3.55b) by hand."""
    motion = Excitation(2.0, [[0.6, 0.0]], [[0.0, 0.8]], [0.1]).at([0.0, 0.3])
    t = np.array([0.0, 0.3])
    assert motion.q[:, 0] == pytest.approx(0.1 + 0.3 * np.sin(2 * t) - 0.2 * np.cos(4 * t), abs=1e-15)
    assert motion.dq[:, 0] == pytest.approx(0.6 * np.cos(2 * t) + 0.8 * np.sin(4 * t), abs=1e-15)
    assert motion.ddq[:, 0] == pytest.approx(-1.2 * np.sin(2 * t) + 3.2 * np.cos(4 * t), abs=1e-15)


def test_derivatives_are_slopes(excitation):
    t = np.linspace(0.0, 9.0, 50)
    here, up, down = (excitation.at(t + h) for h in (0.0, STEP, -STEP))
    assert np.abs((up.q - down.q) / (2 * STEP) - here.dq).max() < SLOPE
    assert np.abs((up.dq - down.dq) / (2 * STEP) - here.ddq).max() < SLOPE


def test_periodic_about_its_offset(excitation):
    t = np.linspace(0.0, excitation.period, 1001)[:-1]
    now, later = excitation.at(t), excitation.at(t + 3.0 * excitation.period)
    for name in ("q", "dq", "ddq"):
        assert np.abs(getattr(now, name) - getattr(later, name)).max() < ROUNDING
    assert now.q.mean(axis=0) == pytest.approx(excitation.offset, abs=ROUNDING)


def test_samples_are_whole_periods():
    excitation = builtin_plan("thesis-a1")
    motion = excitation.sample(100.0)
    assert motion.samples == 2000
    assert motion.time[-1] == 19.99
    assert excitation.sample(100.0, periods=3).samples == 6000
    assert np.array_equal(excitation.sample(100.0, periods=3).q[:2000], motion.q)


def test_stretching_keeps_the_path(excitation):
    """Same points later: velocity falls with the time, acceleration with its square."""
    slow = excitation.stretched(2.5 * excitation.period)
    assert slow.period == pytest.approx(2.5 * excitation.period, rel=1e-15)
    assert slow.robot == "arm"
    t = np.linspace(0.0, excitation.period, 40)
    fast, late = excitation.at(t), slow.at(2.5 * t)
    assert np.abs(late.q - fast.q).max() < ROUNDING
    assert np.abs(2.5 * late.dq - fast.dq).max() < ROUNDING
    assert np.abs(6.25 * late.ddq - fast.ddq).max() < ROUNDING


def test_plan_on_disk_to_the_last_bit(excitation, tmp_path):
    loaded = load_plan(save_plan(excitation, tmp_path / "new" / "plan.json"))
    np.testing.assert_array_equal(load_plan(tmp_path / "new").a, loaded.a)
    assert (loaded.base_frequency, loaded.robot) == (excitation.base_frequency, "arm")
    for name in ("a", "b", "offset"):
        assert np.array_equal(getattr(loaded, name), getattr(excitation, name))
        assert not getattr(loaded, name).flags.writeable


def test_plans_that_cannot_be_read(excitation, tmp_path):
    path = save_plan(excitation, tmp_path / "plan.json")
    plan = json.loads(path.read_text())
    for key in ("a", "base_frequency", "robot"):
        path.write_text(json.dumps({k: v for k, v in plan.items() if k != key}))
        with pytest.raises(ArmidError, match=f"lacks the keys {key}"):
            load_plan(path)
    path.write_text("{")
    with pytest.raises(ArmidError, match="cannot be read as a plan"):
        load_plan(path)
    with pytest.raises(ArmidError, match="cannot be read as a plan"):
        load_plan(tmp_path / "missing.json")
    path.write_text(json.dumps({"robot": "arm", "poses": [[0.0]], "stretches": []}))
    with pytest.raises(ArmidError, match="plan of poses or sweeps"):
        load_plan(path)


def test_the_name_of_a_file_is_no_motion(excitation, tmp_path):
    """Every command that takes a motion says so, and how a file becomes one."""
    path = save_plan(excitation, tmp_path / "plan.json")
    for take in (Plan, required_series, lambda plan: save_plan(plan, tmp_path / "copy.json")):
        with pytest.raises(ArmidError, match=r"load_plan\(\"plan.json\"\)"):
            take(str(path))
    assert required_series(excitation) is excitation


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"base_frequency": 0.0}, "positive"),
        ({"base_frequency": float("inf")}, "positive"),
        ({"a": [[1.0, 2.0]]}, "b must have shape"),
        ({"offset": [0.0]}, "offset must have shape"),
        ({"b": [[float("nan")] * 5] * 3}, "b must be finite"),
    ],
)
def test_series_that_contradict_themselves(excitation, change, problem):
    fields = {"base_frequency": 0.7, "a": excitation.a, "b": excitation.b, "offset": excitation.offset}
    with pytest.raises(ArmidError, match=problem):
        Excitation(**(fields | change))


def test_built_in_plans():
    for name, harmonics in zip(PLANS, (10, 5), strict=True):
        plan = builtin_plan(name)
        assert (plan.n, plan.harmonics, plan.period) == (7, harmonics, pytest.approx(20.0, rel=1e-15))
    with pytest.raises(ArmidError, match="thesis-a3"):
        builtin_plan("thesis-a3")

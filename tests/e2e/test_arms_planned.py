"""Arms that armid has not seen: planned with every limit, and checked by a program that shares nothing with it."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from armid.excitation.fourier import Excitation, save_plan

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

WORTH = 2.0
"""Smallest ratio of the sum of variances of random motions to that of the plan: of six seconds and four harmonics,
found in one round, the arm that gains least gains 2.8 times; plans as long as people make them gain more."""


@pytest.fixture(scope="module")
def arms():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        yield importlib.import_module("arms")
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.mark.collision
@pytest.mark.parametrize("free", [False, True])
def test_a_scara_above_its_floor(arms, free):
    entry = next(entry for entry in arms.entries() if entry.name == "scara")
    row = arms.measure(entry, arms.Asked(6.0, 4, free=free, rounds=1))
    assert row.violations == 0 and row.pairs > 0
    assert row.gain > WORTH


@pytest.mark.collision
def test_the_other_program_sees_what_is_wrong(arms, tmp_path):
    """A plan through the floor and beyond limits is found out."""
    entry = next(entry for entry in arms.entries() if entry.name == "scara")
    arm = arms.load_table(entry.path)
    still = Excitation(1.0, np.zeros((4, 2)), np.zeros((4, 2)), [0.0, 0.0, 0.1, 0.0])
    path = save_plan(still, tmp_path / "plan.json")
    options = {"clearance": 0.02, "rate": 20.0, "acceleration": 10.0, "jerk": 200.0}
    assert arms.fly(arm, path, floor=0.0, **options).violations == 0
    assert set(arms.fly(arm, path, floor=0.4, **options).close) == {"link_3_0 - floor", "link_4_0 - floor"}
    fast = Excitation(1.0, [[9.0, -9.0], [0, 0], [0, 0], [0, 0]], np.zeros((4, 2)), still.offset)
    shares = arms.fly(arm, save_plan(fast, path), floor=0.0, **options).shares
    assert {name for name, share in shares.items() if share > 1.0 + 1e-6} == {"position", "velocity", "acceleration"}


@pytest.mark.long
def test_every_arm_that_is_here(arms):
    """Shorter plans than people make, so that all of them take a few minutes."""
    for entry in arms.entries():
        row = arms.measure(entry, arms.Asked(6.0, 4, rounds=1))
        assert row.violations == 0, row
        assert row.gain > WORTH, row

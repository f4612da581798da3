"""Estimates beside the Cramér-Rao bound on three arms, measured by the benchmark."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "bound.py"

EXACT, WITH_ENCODERS = 1.1, 1.3
"""Largest RMS error over the bound, motion known exactly and with encoders of 1e-5 rad at 1 kHz."""

FEW, MANY = 8, 200
"""Recordings of each case: the ratio is then known to 6 % and to 1 %."""

CHANCE = {FEW: 0.2, MANY: 0.0}
"""Three such deviations of few recordings; many lie far enough below."""


def measured(runs: int) -> list[dict[str, Any]]:
    command = [sys.executable, str(BENCHMARK), "--json", "--runs", str(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("runs", [FEW, pytest.param(MANY, marks=pytest.mark.long)])
def test_weighted_least_squares_comes_near_the_bound(runs: int):
    found = measured(runs)
    assert {each["arm"] for each in found} == {"iiwa14-r820", "panda", "ur10e"} and len(found) == 12
    for each in found:
        most = WITH_ENCODERS if each["encoder"] else EXACT
        assert 0.8 <= each["ratio"] <= most + CHANCE[runs], each

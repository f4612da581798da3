"""Runs that an earlier version wrote: they load, and predict what they predicted then.

`tests/data/runs_format_1` holds runs of a simulated arm with three joints, written before runs had a format number,
and what that version said of them in `expected.json`: hysteresis and ripple, consistent bodies, chosen friction, and
friction for each recording.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.cli.main import main
from armid.runs.run import load_run
from armid.runs.validation_and_prediction import band, predict
from labs import small_plan

RUNS = Path(__file__).parents[2] / "data" / "runs_format_1"
EXPECTED: dict[str, Any] = json.loads((RUNS / "expected.json").read_text())

ROUNDING = 1e-9
"""Relative and absolute tolerance of torque [N·m]: sums of some ten products, in another order elsewhere."""

ROOTS = 1e-6
"""Relative tolerance of half-widths of intervals: roots of sums that cancel in part."""


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_an_earlier_run_predicts_what_it_did(name: str):
    expected, run = EXPECTED[name], load_run(RUNS / name)
    assert "format" not in json.loads((RUNS / name / "model.json").read_text())
    assert [str(each) for each in run.estimate.fit.names] == expected["names"]
    assert [finding.code for finding in run.estimate.findings] == expected["findings"]
    assert (run.verdict, run.estimate.method) == (expected["verdict"], expected["method"])
    np.testing.assert_array_equal(run.estimate.fit.values, expected["values"])
    motion = small_plan(5).sample(50.0)
    np.testing.assert_allclose(predict(run, motion)[::40], expected["torque"], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(np.asarray(band(run, motion))[::40], expected["band"], rtol=ROOTS)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_an_earlier_run_is_exported(name: str, tmp_path: Path):
    with pytest.raises(SystemExit) as ended:
        main(["export", str(RUNS / name), "--to", "c", "--out", str(tmp_path)])
    assert ended.value.code in (0, None) and list(tmp_path.rglob("*.c"))

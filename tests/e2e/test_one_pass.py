"""Passes of an identification with report over its recordings, counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from armid.cli.main import app
from armid.information import accumulate, filtered_rows
from armid.runs import run as runs
from armid.study.recordings import processed
from labs import write_recordings, write_study

pytest.importorskip("plotly")

TRAINING = 6
"""Passes over a training recording that need its regressor: factors, search for ripple, systematic errors, spectrum
of the residuals, rows away from reversals, prediction intervals. Each but the first needs the estimate, and filtered
rows are too many to be kept."""

VALIDATION = 1
"""Passes over a validation recording: prediction intervals."""


def test_each_recording_is_processed_once_and_its_regressor_made_as_often_as_it_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_recordings(tmp_path)
    study = write_study(tmp_path)
    times: Counter[str] = Counter()
    motions: dict[int, str] = {}
    passes: Counter[str] = Counter()
    held: list[Any] = []  # so that no identity is given twice

    def counted(process: Callable[..., Any]) -> Callable[..., Any]:
        def call(recording: Any, *arguments: Any, **options: Any) -> Any:
            times[Path(recording.source).name] += 1
            found = process(recording, *arguments, **options)
            held.append(found)
            motions.update({id(run.motion): Path(recording.source).name for run in found[0]})
            return found

        return call

    def passing(filtered: Callable[..., Any]) -> Callable[..., Any]:
        def call(source: Any, run: Any, *arguments: Any) -> Any:
            passes[motions.get(id(run.motion), "parts that the doctor tries")] += 1
            return filtered(source, run, *arguments)

        return call

    def unread(*arguments: Any) -> None:
        raise AssertionError("the run that was just written is read")

    monkeypatch.setattr(processed, "process_recording", counted(processed.process_recording))
    for module in (accumulate, filtered_rows):
        monkeypatch.setattr(module, "filtered_columns", passing(module.filtered_columns))
    monkeypatch.setattr(runs, "load_run", unread)
    done = CliRunner().invoke(app, ["identify", str(study), "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "run" / "report.html").is_file()
    assert times == {"run1.csv": 1, "run2.csv": 1}
    assert passes["run1.csv"] <= TRAINING and passes["run2.csv"] == VALIDATION

"""Records of a run: those of a result in memory are those that its folder gives back."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.report.data.page_data import gather
from armid.report.page import render
from armid.runs.read_records import read_records, records_of
from armid.runs.run import load_run, run_of, save_run
from armid.study.compare_methods import MethodTable, compare_methods, compare_record
from armid.study.config import EstimationChoice, ModelChoice, load_study
from armid.study.identify import Result, conclude
from armid.study.prepare import Prepared, prepare
from armid.study.storage.provenance import RunOrigin
from armid.study.storage.records import plain
from labs import write_recordings, write_study

MADE = RunOrigin("2025-05-03T14:07:00+02:00", "bench", "1.0")

ROUNDING = 4e-16
"""A record has the relative error, from which the standard deviation of the torque follows by a division."""


@pytest.fixture(scope="module", params=["given terms", "selected friction"])
def done(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Prepared, Result, MethodTable]:
    folder = tmp_path_factory.mktemp("small")
    write_recordings(folder)
    study = load_study(write_study(folder))
    if request.param == "selected friction":
        study = replace(study, model=ModelChoice(automatic=True), estimation=EstimationChoice("ridge"))
    prepared = prepare(study)
    return prepared, conclude(prepared), compare_methods(prepared, ("ols", "ridge", "robust"))


def assert_same(one: Any, other: Any, where: str = "") -> None:
    """Equal values, field by field; a study as its record, in which lists stand for tuples."""
    if dataclasses.is_dataclass(one):
        assert type(one) is type(other), where
        for each in dataclasses.fields(one):
            assert_same(getattr(one, each.name), getattr(other, each.name), f"{where}.{each.name}")
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{where}[{k}]")
    elif isinstance(one, np.ndarray | float):
        np.testing.assert_allclose(other, one, rtol=ROUNDING, atol=0, err_msg=where)
    else:
        assert plain(one) == plain(other), where


def test_a_stored_run_gives_the_same_page_as_its_result(done: tuple[Prepared, Result, MethodTable], tmp_path: Path):
    prepared, result, table = done
    further = {"compare.json": compare_record(table)}
    folder = save_run(result, tmp_path / "run", further_records=further, made=MADE)
    run, records = run_of(result, folder, MADE), records_of(result, table)
    stored = load_run(folder)
    assert_same(records, read_records(stored))
    assert (records.friction is None) == (prepared.friction_selection is None)
    page_data = gather(
        run, records=records, recordings=list(zip(prepared.recordings, result.predictions, strict=True))
    )
    again = gather(stored)
    assert_same(page_data, again)
    assert render(page_data) == render(again)

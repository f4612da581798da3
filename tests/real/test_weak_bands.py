"""A few seconds of a run: the bands of a consistent estimate stay of the size of its errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import load_study
from armid.information.base_regressor_layout import column_source
from armid.information.filtered_rows import all_rows
from armid.study.identify import conclude
from armid.study.prepare import prepare
from armid.study.recordings.processed import joined_observations, of_role

STUDIES = Path(__file__).parent / "studies"
TRAIN, OTHER = "measurements_1.parquet", "measurements_3.parquet"

EVERY = 50
"""Rows of the other run between two that are looked at."""

WIDEST = 3.0
"""Deviation of a band over the error on another run: least squares makes it a hundred."""

pytestmark = pytest.mark.real


def test_bands_of_a_fifth_of_a_run_are_of_the_size_of_errors_on_another(shared_data: Path):
    study = load_study(STUDIES / "kuka_lwr4plus.toml")
    roles = {TRAIN: "train", OTHER: "validate"}
    choices = [replace(each, role=roles[Path(each.path).name]) for each in study.recordings]
    first = [replace(each, part=(0.0, 0.2)) if each.role == "train" else each for each in choices]
    estimation = replace(study.estimation, method="physical", options={"physical": {}})
    prepared = prepare(replace(study, recordings=tuple(first), estimation=estimation))
    result = conclude(prepared)
    (score,) = result.validation.recordings
    fit, base = result.estimate.fit, result.estimate.base
    observations = joined_observations(of_role(prepared.recordings, "validate"))
    source = column_source(result.model, base)
    (run,) = observations.runs
    few = replace(run, step=run.step * EVERY, mask=run.mask[::EVERY], block=run.block[::EVERY], repetition=None)
    rows = all_rows(source, few, observations.band)
    variance = np.zeros(len(score.rms))
    for j, own in enumerate(source.layout.parameters):
        columns = rows[source.layout.offset[j] : source.layout.offset[j + 1] - 1]
        variance[j] = np.einsum("km,kl,lm->m", columns, fit.covariance[np.ix_(own, own)], columns).mean()
    assert (np.sqrt(variance) <= WIDEST * score.rms).all(), np.sqrt(variance) / score.rms

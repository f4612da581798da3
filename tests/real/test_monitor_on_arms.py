"""External torque of a Med 7 without contact, against that of the manufacturer's own model on the same samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.runs.monitoring.observer import LowPassStage, ObserverOptions
from armid.runs.monitoring.unseen_residuals import external_torque_of
from armid.runs.run import load_run, save_run
from armid.study.config import load_study
from armid.study.identify import identify
from armid.study.recordings.reading import read_choice

STUDY = Path(__file__).parent / "studies" / "kuka_lbr_med7.toml"
TRAINED = 0.7
"""Part of the slow recording that trains, beside the fast one."""

pytestmark = pytest.mark.real


def test_the_residual_is_smaller_than_the_manufacturers(shared_data: Path, tmp_path: Path):
    """On what neither has seen, no joint is worse by more than 5 %, and the mean ratio is at most 0.6."""
    parquet = pytest.importorskip("pyarrow.parquet")
    study = load_study(STUDY)
    fast, slow = (replace(each, role="train") for each in study.recordings)
    recordings = (fast, replace(slow, part=(0.0, TRAINED)))
    run = load_run(save_run(identify(replace(study, recordings=recordings)), tmp_path / "run"))
    unseen, _ = read_choice(replace(slow, part=(TRAINED, 1.0)), study.folder, run.robot)
    table = parquet.read_table(shared_data / "kuka_lbr_med7" / Path(slow.path).name)
    time = table["t"].to_numpy()
    stated = np.column_stack([table[f"tau_ext{j}"].to_numpy() for j in range(1, 8)])
    options = ObserverOptions()
    (part,) = external_torque_of(run, options, unseen)
    stage = LowPassStage.of(options.stage_at(part.rate), part.rate)
    stated = stage.along(stage.along(stated))[np.searchsorted(time, part.time - 1e-4)]
    used = part.usable.all(axis=1)
    ratio = np.sqrt(np.mean(part.external[used] ** 2, axis=0) / np.mean(stated[used] ** 2, axis=0))
    assert (ratio <= 1.05).all() and np.exp(np.log(ratio).mean()) <= 0.6

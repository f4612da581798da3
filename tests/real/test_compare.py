"""All methods on a real recording: each comes to an end, with numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import load_study
from armid.estimation.catalogue import ESTIMATORS
from armid.study.compare_methods import MethodTable, compare_methods
from armid.study.prepare import prepare

STUDIES = Path(__file__).parent / "studies"

LINEAR = ("ols", "wls", "robust", "essential", "ridge", "physical")
"""Methods that are repeated for every fold."""

SHORT = ("staubli_tx40",)
"""One period in four blocks: without one of them and those beside it, 90 rows are left for 61 parameters."""

ARMS = [path.stem for path in sorted(STUDIES.glob("*.toml"))]

pytestmark = pytest.mark.real


def assert_finite(table: MethodTable) -> None:
    for score in table.scores:
        assert not score.failure, (score.method, score.failure)
        assert np.isfinite([*score.training, *score.unseen]).all(), score.method
        assert score.consistent is not None


def test_every_method_has_numbers_on_a_recording(shared_data: Path):
    table = compare_methods(prepare(load_study(STUDIES / "kuka_lbr_med7.toml")))
    assert tuple(score.method for score in table.scores) == tuple(ESTIMATORS)
    assert_finite(table)


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_can_be_compared_without_validation(shared_data: Path, name: str):
    """On its first recording alone, parts of it being left out in turn."""
    study = load_study(STUDIES / f"{name}.toml")
    alone = next(choice for choice in study.recordings if choice.role == "train")
    table = compare_methods(prepare(replace(study, recordings=(alone,))), LINEAR)
    assert table.unseen == "cross-validation"
    if name in SHORT:
        known = {score.method for score in table.scores if np.isfinite(score.unseen).all()}
        assert {"ridge", "physical"} <= known  # a prior stands in for the rows
        assert all(score.failure for score in table.scores if score.method not in known)
        return
    assert_finite(table)
    training, unseen = (np.linalg.norm([getattr(s, what) for s in table.scores]) for what in ("training", "unseen"))
    assert unseen > training

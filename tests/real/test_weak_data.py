"""Runs that cannot identify an arm: the description as a prior must make them predict another run all the same.

The weight of the prior comes from the weak run alone, by blocked cross-validation.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from armid import identify, load_study
from armid.study.identify import Result

STUDIES = Path(__file__).parent / "studies"

pytestmark = pytest.mark.real

# Study, the weak run, the run to be predicted, and the RMS on every joint that must not be exceeded [N·m].
WEAK = {
    "kuka_lbr_med7": ("measurements_with_ext_tau_1_dgr.parquet", "measurements.parquet", 1.6),
    "kuka_lwr4plus": ("measurements_1.parquet", "measurements_3.parquet", 0.85),
}


@lru_cache(maxsize=4)
def result(name: str, method: str) -> Result:
    study = load_study(STUDIES / f"{name}.toml")
    weak, other, _ = WEAK[name]
    roles = {weak: "train", other: "validate"}
    recordings = tuple(replace(each, role=roles[Path(each.path).name]) for each in study.recordings)
    estimation = replace(study.estimation, method=method, options={"physical": {"prior": "log-det"}})
    return identify(replace(study, recordings=recordings, estimation=estimation))


@pytest.mark.parametrize("name", WEAK)
def test_the_description_as_prior_carries_a_weak_run_to_another(shared_data: Path, name: str):
    (score,) = result(name, "physical").validation.recordings
    assert (score.rms <= WEAK[name][2]).all(), score.rms


@pytest.mark.parametrize("name", WEAK)
def test_plain_least_squares_does_not(shared_data: Path, name: str):
    """Otherwise the runs would not be weak, and the test above would say nothing."""
    (plain,) = result(name, "wls").validation.recordings
    (score,) = result(name, "physical").validation.recordings
    assert plain.rms.max() > 1.3 * WEAK[name][2]
    assert np.linalg.norm(score.rms) < 0.5 * np.linalg.norm(plain.rms)


@pytest.mark.parametrize("name", WEAK)
def test_what_was_found_says_whose_it_is(shared_data: Path, name: str):
    estimate = result(name, "physical").estimate
    standard = estimate.fit.standard
    assert standard is not None and standard.proof.smallest_eigenvalue > 0.0
    assert standard.prior.trials and standard.prior.weight > 0.0
    status = dict(zip(standard.names, standard.status, strict=True))
    assert {status[f"M_{link}"] for link in range(1, 8)}.isdisjoint({"identified"})  # one run does not weigh links
    assert "identified" in status.values()

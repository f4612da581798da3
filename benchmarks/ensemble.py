"""Ensembles of possible arms: spread of their torque on unseen motion, on the real arms.

    python benchmarks/ensemble.py [--arms NAME …] [--draws N] [--method NAME]

For each study of the real arms, N arms are drawn from the estimate. The standard deviation of their torque on the
validation motion, or on the training motion where there is none, is compared for each joint with the part of
`predict --band` that comes from parameters (`ratio`, of which the smallest and the largest are printed), and with the
whole band divided by 1.96 (`of band`, median). `lowest` is the smallest eigenvalue of a pseudo-inertia of any draw.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.estimate_record import collapse, torque_parameters
from armid.estimation.problem import standard_of
from armid.export.ensemble.draws import Draws, draw_bodies
from armid.information.base_regressor_layout import column_source
from armid.information.filtered_rows import all_rows
from armid.measurement.observations import Observations
from armid.runs.run import Run, load_run, save_run
from armid.study.config import load_study
from armid.study.identify import conclude
from armid.study.prepare import Prepared, prepare
from armid.study.recordings.processed import joined_observations, of_role
from armid.validation.prediction_interval import band_of_rows, parameter_covariance

STUDIES = Path(__file__).parents[1] / "tests" / "real" / "studies"

EVERY = 10
"""Every tenth row is compared."""

NORMAL = 1.96


def main() -> None:
    """Print a row for each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="*", default=sorted(path.stem for path in STUDIES.glob("*.toml")))
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--method", default="physical")
    options = parser.parse_args()
    print(f"{'arm':20} {'replaced':>8} {'lowest':>8} {'ratio':>13} {'of band':>8} {'s':>6}")
    for arm in options.arms:
        study = load_study(STUDIES / f"{arm}.toml")
        prepared = prepare(replace(study, estimation=replace(study.estimation, method=options.method)))
        result = conclude(prepared)
        with tempfile.TemporaryDirectory() as folder:
            run = load_run(save_run(result, Path(folder) / "run"))
            began = time.perf_counter()
            draws = draw_bodies(run, torque_parameters(run.estimate.base, run.estimate.fit), options.draws)
            seconds = time.perf_counter() - began
        standard = standard_of(run.model, run.estimate.base)
        lowest = min(float(smallest_eigenvalues(standard, each).min()) for each in draws.standard)
        ratio, of_band = spread(prepared, run, draws)
        print(
            f"{arm:20} {draws.replaced:8.0%} {lowest:8.1e} {ratio.min():6.3f}–{ratio.max():<6.3f} "
            f"{np.median(of_band):8.2f} {seconds:6.1f}",
            flush=True,
        )


def spread(prepared: Prepared, run: Run, draws: Draws) -> tuple[Array, Array]:
    """Standard deviation of the draws' torque over that by the covariance of the parameters, and over the band."""
    observations = joined_observations(of_role(prepared.recordings, "validate") or prepared.recordings)
    base, estimate = run.estimate.base, run.estimate
    source = column_source(run.model, base)
    sparse = [
        replace(run, step=run.step * EVERY, mask=run.mask[::EVERY], block=run.block[::EVERY], repetition=None)
        for run in observations.runs
    ]
    rows = np.concatenate([all_rows(source, each, observations.band) for each in sparse], axis=1)
    covariance, change = parameter_covariance(estimate), draws.base - collapse(base.names, estimate.fit)
    band = band_of_rows(run.model, estimate, Observations(observations.runs, observations.band), EVERY) / NORMAL
    ratio, of_band = np.zeros((2, run.model.n))
    for j, own in enumerate(source.layout.parameters):
        y = rows[source.layout.offset[j] : source.layout.offset[j + 1] - 1]
        found = np.sqrt(np.mean(np.var(change[:, own] @ y, axis=0)))
        expected = np.sqrt(np.mean(np.einsum("km,km->m", covariance[np.ix_(own, own)] @ y, y)))
        ratio[j], of_band[j] = found / expected, found / np.sqrt(np.mean(band[:, j] ** 2))
    return ratio, of_band


if __name__ == "__main__":
    main()

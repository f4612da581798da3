"""Ensembles of possible arms: spread of their torque on unseen motion, on the real arms.

    python benchmarks/ensemble.py [--arms NAME …] [--draws N] [--method NAME]

For each study of the real arms, N arms are drawn from the estimate. The standard deviation of their torque on the
validation motion, or on the training motion where there is none, is compared for each joint with the part of
`predict --band` that comes from parameters (`ratio`, of which the smallest and the largest are printed). With the
torque errors of the draws, it is compared with the whole band divided by 1.96 (`with error`). `lowest` is the
smallest eigenvalue of a pseudo-inertia of any draw.
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
from armid.export.ensemble.draws import Draws, draw_arms
from armid.model.motion import Motion
from armid.runs.run import Run, load_run, save_run
from armid.study.config import load_study
from armid.study.identify import conclude
from armid.study.prepare import Prepared, prepare
from armid.study.recordings.processed import joined_observations, of_role
from armid.validation.prediction_interval import parameter_covariance, torque_band

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
    print(f"{'arm':20} {'replaced':>8} {'lowest':>8} {'ratio':>13} {'with error':>13} {'s':>6}")
    for arm in options.arms:
        study = load_study(STUDIES / f"{arm}.toml")
        prepared = prepare(replace(study, estimation=replace(study.estimation, method=options.method)))
        result = conclude(prepared)
        with tempfile.TemporaryDirectory() as folder:
            run = load_run(save_run(result, Path(folder) / "run"))
            began = time.perf_counter()
            centre, motion = torque_parameters(run.estimate.base, run.estimate.fit), unseen_motion(prepared)
            draws = draw_arms(run, centre, options.draws, motion=motion)
            seconds = time.perf_counter() - began
        standard = standard_of(run.model, run.estimate.base)
        lowest = min(float(smallest_eigenvalues(standard, each).min()) for each in draws.standard)
        ratio, whole = spread(run, motion, draws)
        print(
            f"{arm:20} {draws.replaced:8.0%} {lowest:8.1e} {ratio.min():6.3f}–{ratio.max():<6.3f} "
            f"{whole.min():6.3f}–{whole.max():<6.3f} {seconds:6.1f}",
            flush=True,
        )


def spread(run: Run, motion: Motion, draws: Draws) -> tuple[Array, Array]:
    """Standard deviation of the draws' torque over that by the covariance of the parameters, shape (n,).

    The second value is that of the torque with the torque errors over the 95 % interval divided by 1.96, shape (n,).
    """
    base, covariance = run.estimate.base, parameter_covariance(run.estimate)
    change = draws.base - collapse(base.names, run.estimate.fit)
    band = torque_band(run.model, run.estimate, motion) / NORMAL
    regressor = run.model.regressor(motion)[:, :, base.kept]
    ratio, whole = np.zeros((2, run.model.n))
    for j in range(run.model.n):
        rows = regressor[:, j]
        torque = rows @ change.T
        found = np.sqrt(np.mean(np.var(torque, axis=1)))
        with_error = np.sqrt(np.mean(np.var(torque + draws.torque_error[:, j], axis=1)))
        expected = np.sqrt(np.mean(np.einsum("mk,mk->m", rows @ covariance, rows)))
        ratio[j], whole[j] = found / expected, with_error / np.sqrt(np.mean(band[:, j] ** 2))
    return ratio, whole


def unseen_motion(prepared: Prepared) -> Motion:
    """Motion of the recordings for validation, or of those for training where there is none, every `EVERY`-th row."""
    runs = joined_observations(of_role(prepared.recordings, "validate") or prepared.recordings).runs
    names = ("time", "q", "dq", "ddq", *(["memory"] if runs[0].motion.memory is not None else []))
    parts = [[getattr(run.motion, name)[run.rows][::EVERY] for run in runs] for name in names]
    return Motion(*(np.concatenate(part) for part in parts))


if __name__ == "__main__":
    main()

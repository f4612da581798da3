"""Prediction intervals and expected errors on motion of real arms that the model has not seen.

    python benchmarks/bands.py [--arm NAME]… [--single] [--verbose] [--json]

Each recording of an arm is left out in turn, or, of an arm's one recording, segments with the blocks beside them. The
others train a model as a study does, with the terms of a study that names none (*plain*) and with `terms = "auto"`.
With `--single`, each recording alone trains a model that is judged on all others. Printed are, over all that was left
out: the share of rows inside the 95 % prediction interval, of the arm and of its worst joint; the median half width
over the one that an oracle would need, which knows the 95 % quantile of the errors of each joint; and the number of
joints and left-out recordings whose RMS error lies inside the 90 % interval that was stated before.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.estimate_record import Estimate
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.friction.selection import choose_friction
from armid.estimation.friction_per_recording import offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, build_problem
from armid.estimation.run_estimator import estimate
from armid.information.hysteresis_states import without_creep
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import AUTOMATIC_METHOD, EstimationChoice, build_estimator
from armid.study.recordings.left_out import with_left_out
from armid.study.selection_prior_options import as_chosen
from armid.validation.torque_validation import predict_recording
from friction_arms import BLOCKS, STUDIES, Arm, left_out, load


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors on what was left out.

    Attributes:
        error: Measured minus predicted torque, NaN where no row counts, shape (M, n).
        half: Half width of the 95 % prediction interval, shape (M, n).
        rms: RMS error of each joint, shape (n,).
        stated: Lower and upper end of the 90 % interval of the RMS error, shape (2, n).
    """

    error: Array
    half: Array
    rms: Array
    stated: Array


def separated(model: DynamicsModel, apart: bool, problem: EstimationProblem) -> EstimationProblem:
    """Problem with offsets of each recording, if there are several and the selection asks for it."""
    if not apart:
        return problem
    own = np.isin(problem.information.names, offset_names(model))
    return replace(problem, information=separate_by_recording(problem.information, own))


def trained(arm: Arm, way: str, training: Observations) -> tuple[DynamicsModel, Estimate, Array]:
    """Model and estimate as a study makes them, and the stated 90 % interval of the RMS error, shape (2, n)."""
    model, method, apart, used = arm.plain, WeightedLeastSquares(), False, training
    if way == "auto":
        selection = choose_friction(arm.model, training)
        bodies = arm.model.robot.inertial_vector
        described = bodies is not None and bool((bodies[:, 0] > 0.0).all())
        method = build_estimator(as_chosen(EstimationChoice(AUTOMATIC_METHOD), selection, described=described))
        model, apart, used = selection.model, selection.offset_per_recording, without_creep(training)
    problem = build_problem(model, used)
    assert problem.base is not None
    own = partial(separated, model, apart)
    first = Estimate(arm.name, way, (), problem.base, estimate(own(problem), method))
    result, error = with_left_out(first, problem, own, method)
    return model, result, np.stack([error.expected.low, error.expected.high])


def judged(arm: Arm, way: str, training: Observations, unseen: Observations) -> Judged:
    """Errors of a model on observations that it has not seen."""
    model, result, stated = trained(arm, way, training)
    unseen = replace(unseen, runs=tuple(run for run in unseen.runs if run.mask.any()))
    prediction = predict_recording(model, result, unseen)
    residual = [np.where(run.mask, run.residual, np.nan) for run in prediction.runs]
    error = np.concatenate([part[:: prediction.every] for part in residual])
    rms = np.sqrt(np.nanmean(np.concatenate(residual) ** 2, axis=0))
    return Judged(error, prediction.half_widths, rms, stated)


def alone(arm: Arm) -> Iterator[tuple[Observations, Observations]]:
    """Each recording as the only one that trains, and all others."""
    runs = arm.observations.runs
    for one in sorted({run.recording for run in runs}):
        own, rest = (tuple(run for run in runs if (run.recording == one) == same) for same in (True, False))
        yield replace(arm.observations, runs=own), replace(arm.observations, runs=rest)


def measure(arm: Arm, way: str, splits: list[tuple[Observations, Observations]], what: str) -> dict[str, Any]:
    """Coverage and width over all that was left out."""
    found: list[Judged] = []
    failed = 0
    for training, unseen in splits:
        try:
            found.append(judged(arm, way, training, unseen))
        except ArmidError:
            failed += 1
    error = np.concatenate([each.error for each in found])
    half = np.where(np.isnan(error), np.nan, np.concatenate([each.half for each in found]))
    inside = np.where(np.isnan(error), np.nan, np.abs(error) <= half)
    oracle = np.nanquantile(np.abs(error), 0.95, axis=0)
    stated = np.array([(each.rms >= each.stated[0]) & (each.rms <= each.stated[1]) for each in found])
    return {
        "arm": arm.name,
        "way": way,
        "left_out": what,
        "failed": failed,
        "inside": float(np.nanmean(inside)),
        "joints": np.nanmean(inside, axis=0).tolist(),
        "width": float(np.nanmedian(half / oracle)),
        "stated": [int(stated.sum()), stated.size],
    }


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    kept, all_ = row["stated"]
    failed = f"   {row['failed']} failed" if row["failed"] else ""
    return (
        f"{row['arm']:<20}{row['way']:<7}{row['left_out']:<11}{100 * row['inside']:6.1f} % inside, worst joint "
        f"{100 * min(row['joints']):5.1f} %, width {row['width']:4.2f} x oracle, "
        f"expected error kept {kept} of {all_}{failed}"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arm", action="append", help="only these arms, by the name of their study")
    parser.add_argument("--single", action="store_true", help="train on each recording alone")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for name in options.arm or sorted(path.stem for path in STUDIES.glob("*.toml")):
        arm = load(name)
        if options.single and len({run.recording for run in arm.observations.runs}) < 2:
            continue
        for count in (0,) if options.single else BLOCKS.get(name, (0,)):
            splits = list(alone(arm) if options.single else left_out(arm, count))
            what = "all others" if options.single else f"{count} segments" if count else "recordings"
            for way in ("plain", "auto"):
                rows.append(measure(arm, way, splits, what))
                if not options.json:
                    print(line(rows[-1]), flush=True)
    if options.json:
        print(json.dumps({"results": rows}))
    else:
        print(summary(rows))
    return 0


def summary(rows: list[dict[str, Any]]) -> str:
    """Smallest and largest values over all arms."""
    inside = [row["inside"] for row in rows]
    kept, all_ = np.sum([row["stated"] for row in rows], axis=0)
    return (
        f"arms: {100 * min(inside):.1f} to {100 * max(inside):.1f} % inside; worst joint "
        f"{100 * min(min(row['joints']) for row in rows):.1f} %; median width "
        f"{np.median([row['width'] for row in rows]):.2f}; expected error kept {kept} of {all_}, {kept / all_:.1%}"
    )


if __name__ == "__main__":
    sys.exit(main())

"""Friction that was chosen beside viscous and Coulomb friction, on motion of real arms that neither has seen.

    python benchmarks/friction_arms.py [--arm NAME]… [--verbose] [--json]

Nested: recordings are left out in turn, or segments of an arm's one recording with the blocks beside them; what is
left out is seen neither by the choice nor by the estimate. Recordings and processing are those of the studies in
`tests/real`; the choice starts from the terms of `terms = "auto"`. *Plain* is weighted least squares with the terms
of a study that names none: rigid bodies, viscous and Coulomb friction and offset, with rotor inertia where the effort
is that of motors. *Rotor* has it in any case; *prior* has the method of the choice without further friction. All ways
are judged on the same rows.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.catalogue import Estimator
from armid.estimation.crossvalidation import folds, training_information
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.friction.selection import FrictionSelection, choose_friction
from armid.estimation.friction_per_recording import offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.information.hysteresis_states import without_creep
from armid.information.residuals import compare
from armid.measurement.observations import Observations
from armid.measurement.processing.pipeline import resolve_options
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import (
    AUTOMATIC_METHOD,
    EstimationChoice,
    ModelChoice,
    Study,
    build_estimator,
    build_model,
    load_choice,
    load_study,
)
from armid.study.recordings.processed import joined_observations, process_each
from armid.study.recordings.reading import read_choice
from armid.study.selection_prior_options import as_chosen

STUDIES = Path(__file__).parents[1] / "tests" / "real" / "studies"

BLOCKS = {"franka_panda_gaz": (8, 5), "ur10_unisa": (5,), "kuka_iiwa14_lasa": (5,), "staubli_tx40": (5,)}
"""Segments into which the only recording of an arm is cut."""

WAYS = ("plain", "rotor", "prior", "auto")


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm with all of its recordings, processed, with the terms of plain least squares and those of the choice."""

    name: str
    plain: DynamicsModel
    model: DynamicsModel
    observations: Observations


def load(name: str, study: Study | None = None) -> Arm:
    """An arm by its study, every recording whole."""
    study = study or load_study(STUDIES / f"{name}.toml")
    robot = load_choice(study.robot, study.folder)
    choices = {choice.path: replace(choice, part=(0.0, 1.0)) for choice in study.recordings}.values()
    read = [(choice, read_choice(choice, study.folder, robot)[0]) for choice in choices]
    processing = resolve_options(study.processing, [recording for _, recording in read])
    motor = all(c.reading.transmission is not None or c.reading.drive_gain is not None for c in choices)
    coupled = "coupling" in study.model.terms  # which is the arm's
    return Arm(
        name,
        build_model(robot, study.model if coupled else ModelChoice(), motor_side=motor),
        build_model(robot, study.model if coupled else ModelChoice(automatic=True)),
        joined_observations(process_each(read, processing, robot)),
    )


def left_out(arm: Arm, count: int) -> Iterator[tuple[Observations, Observations]]:
    """Training and unseen observations: recordings in turn where there are several, else so many segments."""
    runs = arm.observations.runs
    recordings = sorted({run.recording for run in runs})
    if len(recordings) > 1:
        for out in recordings:
            yield tuple(
                replace(arm.observations, runs=tuple(run for run in runs if (run.recording == out) == unseen))
                for unseen in (False, True)
            )  # pyright: ignore[reportReturnType]
        return
    information = accumulate_information(arm.model, find_base_parameters(arm.model), arm.observations)
    fold = folds(information, count)
    for out in np.unique(fold):
        chosen = fold == out
        yield (
            _only(arm.observations, ~chosen & ~training_information(information, chosen)),
            _only(arm.observations, chosen),
        )


def _only(observations: Observations, kept: NDArray[np.bool_]) -> Observations:
    """Observations of which only the rows of some blocks count; blocks are those of all runs one after another."""
    runs, first = [], 0
    for run in observations.runs:
        own = kept[first + run.block]
        first += int(run.block.max()) + 1
        runs.append(replace(run, mask=run.mask & own[:, None]))
    return replace(observations, runs=tuple(runs))


def judged(
    model: DynamicsModel, method: Estimator, training: Observations, *, apart: bool = False
) -> tuple[DynamicsModel, Array]:
    """A model with parameters by a method.

    Args:
        model: Arm and terms.
        method: Estimator with its options.
        training: What trains.
        apart: Whether each recording has its own offsets, of which the mean is taken.
    """
    base = find_base_parameters(model)
    information = accumulate_information(model, base, training)
    if apart:
        information = separate_by_recording(information, np.isin(information.names, offset_names(model)))
    problem = EstimationProblem(information, standard_of(model, base), model, base)
    return model, torque_parameters(base, method.solve(problem))


def chosen(
    selection: FrictionSelection, model: DynamicsModel, training: Observations
) -> dict[str, tuple[DynamicsModel, Array]]:
    """Models with and without the chosen friction, estimated as a study with `terms = "auto"` is.

    Args:
        selection: The choice.
        model: Arm with the terms from which the choice started.
        training: What trains.
    """
    bodies = model.robot.inertial_vector
    described = bodies is not None and bool((bodies[:, 0] > 0.0).all())
    method = build_estimator(as_chosen(EstimationChoice(AUTOMATIC_METHOD), selection, described=described))
    apart, used = selection.offset_per_recording, without_creep(training)
    terms = tuple(term for term in selection.model.terms if term not in selection.added)
    without = replace(model, terms=terms)
    return {
        "prior": judged(without, method, used, apart=apart),
        "auto": judged(selection.model, method, used, apart=apart),
    }


def measure(arm: Arm, count: int, *, verbose: bool = False) -> dict[str, Any]:
    """Squared unseen error of each way, joint by joint, over all that was left out in turn."""
    squares = {way: np.zeros(arm.model.n) for way in WAYS}
    seconds = 0.0
    each: list[Array] = []
    laws: list[list[int]] = []
    for training, unseen in left_out(arm, count):
        at = time.process_time()
        ladder = choose_friction(arm.model, training)
        seconds += time.process_time() - at
        plain = WeightedLeastSquares()
        ways = {"plain": judged(arm.plain, plain, training), "rotor": judged(arm.model, plain, training)}
        try:
            ways |= chosen(ladder, arm.model, training)
        except ArmidError:
            ways["prior"] = ways["auto"] = ways["plain"]
        parts = {
            way: [compare(model, theta, run, unseen.band) for run in unseen.runs]
            for way, (model, theta) in ways.items()
        }
        own: dict[str, Array] = {way: np.zeros(arm.model.n) for way in WAYS}
        for k in range(len(unseen.runs)):
            mask = np.all([parts[way][k].mask for way in WAYS], axis=0)
            for way in WAYS:
                own[way] += np.sum(parts[way][k].residual ** 2 * mask, axis=0)
        for way in WAYS:
            squares[way] += own[way]
        each.append(np.sqrt(own["auto"] / own["plain"]))
        laws.append(laws_of_joints(ladder))
        if verbose:
            print(
                "    auto ",
                np.round(each[-1], 2),
                " prior",
                np.round(np.sqrt(own["prior"] / own["plain"]), 2),
                end=" ",
            )
            print(f"{ladder.method}, laws", laws[-1], *ladder.added, flush=True)
    return {
        "arm": arm.name,
        "left_out": f"{count} blocks" if count else "recordings",
        **{way: _ratios(squares[way] / squares["plain"]) for way in WAYS[1:]},
        "auto over rotor": _ratios(squares["auto"] / squares["rotor"]),
        "worst": {"joints": np.max(each, axis=0).tolist(), "largest": float(np.max(each))},
        "laws": {"median": float(np.median(laws)), "largest": int(np.max(laws))},
        "ladder_seconds": seconds,
    }


def laws_of_joints(selection: FrictionSelection) -> list[int]:
    """Number of laws that were chosen for each joint, beside those of the model from which the choice started."""
    robot = selection.model.robot
    joints = [law.joint for term in selection.added for law in term.laws(robot)]
    return np.bincount(joints, minlength=selection.model.n).tolist()


def _ratios(squares: Array) -> dict[str, Any]:
    """Ratios of the RMS of each joint, and their geometric mean."""
    return {"joints": np.sqrt(squares).tolist(), "mean": float(np.exp(0.5 * np.log(squares).mean()))}


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    parts = [
        f"{way}: {' '.join(f'{x:.2f}' for x in row[way]['joints'])} ({row[way]['mean']:.2f})"
        for way in ("auto", "auto over rotor", "prior", "rotor")
    ]
    worst = f"worst: {' '.join(f'{x:.2f}' for x in row['worst']['joints'])}"
    laws = f"laws: median {row['laws']['median']:g}, at most {row['laws']['largest']}"
    return (
        f"{row['arm']:<20}{row['left_out']:<11}{'   '.join(parts)}   {worst}   {laws}   {row['ladder_seconds']:.0f} s"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arm", action="append", help="only these arms, by the name of their study")
    parser.add_argument("--verbose", action="store_true", help="print each recording or segment by itself")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for name in options.arm or sorted(path.stem for path in STUDIES.glob("*.toml")):
        arm = load(name)
        for count in BLOCKS.get(name, (0,)):
            rows.append(measure(arm, count, verbose=options.verbose))
            if not options.json:
                print(line(rows[-1]), flush=True)
    if options.json:
        print(json.dumps({"results": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())

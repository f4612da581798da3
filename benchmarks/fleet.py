"""Fleets of simulated arms: `python benchmarks/fleet.py [--fleets N] [--units U] [--joints n] [--zero RAD] [--json]`.

Each fleet has units of one arm with the same bodies. Friction and offsets of each unit are drawn, and so are its
torque scales and, with --zero, the zero errors of its positions; the noise of the torque is coloured. One unit is odd
in one joint: its friction is larger by a factor. Measured are the share of own parameters inside their intervals, odd
units found and named falsely, and the error on unseen motion of a new unit: 3 s with the fleet as prior against
20 s alone.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from armid.checked_array import Array
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.fleet.fleet_estimate import FleetResult, estimate_fleet
from armid.estimation.fleet.fleet_prior_estimator import FleetPriorEstimator
from armid.estimation.fleet.scaled_problem import scaled_problem
from armid.estimation.fleet.unit_update import FleetPrior, update_unit
from armid.estimation.friction_per_recording import changing_parameters
from armid.estimation.problem import EstimationProblem, build_problem
from armid.estimation.run_estimator import estimate
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from armid.robot import load_robot

RATE, ROW_STEP, PERIOD, MOTIONS = 100.0, 4, 10.0, 5
"""Samples a second [Hz], samples from row to row, period of a motion [s], and number of motions in a fleet."""

LONG, SHORT = 20.0, 3.0
"""Length of a unit's recording, and of that of a new unit [s]."""

FRICTION, OFFSET, SCALE = 0.15, 0.3, 0.02
"""Standard deviations between units: friction, relative; offset [N·m]; torque scale."""

NOISE, MEMORY = 0.1, 0.05
"""Standard deviation of the noise of the torque [N·m], and its time constant [s]."""

ODD = 2.5
"""Factor of viscous and Coulomb friction of the odd joint: ten standard deviations between units."""


@dataclass(frozen=True, eq=False)
class Arm:
    """Model, base parameters, true parameters of a mean unit, mask of own parameters, and size of zero errors."""

    model: DynamicsModel
    base: BaseParameters
    theta: Array
    own: NDArray[np.bool_]
    zero: float


def make_arm(joints: int, zero: float) -> Arm:
    """The virtual iiwa 14, of which only the first joints move; `zero` is the deviation of zero errors [rad]."""
    whole = load_robot("iiwa14-r820")
    robot = load_robot("iiwa14-r820", only=list(whole.joint_names[:joints]))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.02), Offset()))
    truth = truth_of(whole)
    theta = np.zeros(len(model.parameters))
    nominal = model.nominal_parameters()
    assert nominal is not None
    theta[model.inertial_columns] = nominal[model.inertial_columns]
    values = {"FV": truth.friction.viscous, "FS": truth.friction.coulomb}
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in values:
            theta[k] = values[parameter.symbol][parameter.number - 1]
    base = find_base_parameters(model)
    return Arm(model, base, theta, changing_parameters(model)[base.kept], zero)


def make_motion(n: int, seed: int, period: float = PERIOD, harmonics: int = 5) -> Excitation:
    """A motion that closes after a period [s]; its speeds do not depend on the period."""
    a, b = np.random.default_rng((77, seed)).normal(0.0, 0.8 / np.sqrt(harmonics), (2, n, harmonics))
    return Excitation(2.0 * np.pi / period, a, b, np.zeros(n))


def draw_unit(arm: Arm, rng: np.random.Generator, odd_joint: int | None = None) -> tuple[Array, Array]:
    """True standard parameters and torque scales of a unit."""
    theta = arm.theta.copy()
    for k, parameter in enumerate(arm.model.parameters):
        if parameter.symbol in ("FV", "FS"):
            theta[k] *= 1.0 + FRICTION * rng.standard_normal()
            theta[k] *= ODD if odd_joint is not None and parameter.number == odd_joint + 1 else 1.0
        elif parameter.symbol == "FO":
            theta[k] = OFFSET * rng.standard_normal()
    return theta, 1.0 + SCALE * rng.standard_normal(arm.model.n)


def record_unit(
    arm: Arm, theta: Array, scale: Array, plan: Excitation, seconds: float, rng: np.random.Generator
) -> EstimationProblem:
    """Estimation problem of a recording of a unit."""
    n, samples = arm.model.n, round(seconds * RATE)
    measured = plan.at(np.arange(samples) / RATE)
    moved = Motion(measured.time, measured.q + arm.zero * rng.standard_normal(n), measured.dq, measured.ddq)
    before = round(6.0 * MEMORY * RATE)
    decay = np.exp(-1.0 / (RATE * MEMORY))
    drawn = rng.standard_normal((samples + before, n))
    noise = NOISE * lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], drawn, axis=0)[before:]
    torque = arm.model.torque(moved, theta) * scale + noise
    rows = len(range(0, samples, ROW_STEP))
    mask = np.ones((rows, n), dtype=np.bool_)
    margin = round(0.5 * RATE / ROW_STEP)
    mask[:margin] = mask[rows - margin :] = False
    block = np.arange(rows) * ROW_STEP // round(RATE)
    run = ObservedRun(measured, torque, RATE, ROW_STEP, 0, mask, block)
    observations = Observations((run,), Band("butterworth", 5.0, 4, "drop"))
    return build_problem(arm.model, observations, base=arm.base, position_zero_deviation=np.full(n, arm.zero))


def fit_unit(problem: EstimationProblem, prior: FleetPrior, found: FleetResult) -> tuple[Any, Array]:
    """Fit of a unit with the fleet as prior, and its torque scales."""
    own = update_unit(prior, problem.information, found.layout)
    return estimate(scaled_problem(problem, own.scale, own.scale_deviation), FleetPriorEstimator(prior)), own.scale


def unseen_error(arm: Arm, theta: Array, scale: Array, values: Array, found_scale: Array, plan: Excitation) -> Array:
    """RMS error of the predicted torque of each joint on a motion, shape (n,) [N·m]."""
    motion = plan.at(np.arange(round(PERIOD * RATE)) / RATE)
    standard = np.zeros(len(theta))
    standard[arm.base.kept] = values
    predicted = arm.model.torque(motion, standard) * found_scale
    return np.sqrt(np.mean((predicted - arm.model.torque(motion, theta) * scale) ** 2, axis=0))


def run_fleet(arm: Arm, units: int, seed: int) -> dict[str, Any]:
    """Draws, records and identifies one fleet and a new unit."""
    rng = np.random.default_rng((1, seed))
    n = arm.model.n
    odd_unit, odd_joint = int(rng.integers(units)), int(rng.integers(n))
    plans = [make_motion(n, 100 * seed + k) for k in range(MOTIONS + 1)]
    drawn = [draw_unit(arm, rng, odd_joint if u == odd_unit else None) for u in range(units)]
    problems = {
        f"u{u:03d}": record_unit(arm, theta, scale, plans[u % MOTIONS], LONG, rng)
        for u, (theta, scale) in enumerate(drawn)
    }
    began = time.process_time()
    found = estimate_fleet({name: each.information for name, each in problems.items()}, arm.own)
    merging = time.process_time() - began
    inside: list[Array] = []
    for (name, problem), (theta, _) in zip(problems.items(), drawn, strict=True):
        fit, _ = fit_unit(problem, found.priors[name], found)
        true = arm.base.values_of(theta)
        inside.append(((fit.intervals[:, 0] <= true) & (true <= fit.intervals[:, 1]))[arm.own])
    scales = np.abs(found.estimate.scale - np.array([scale for _, scale in drawn]))
    named = {(each.unit, each.joint) for each in found.estimate.odd}
    right = (f"u{odd_unit:03d}", odd_joint)
    theta, scale = draw_unit(arm, rng)
    brief = make_motion(n, 100 * seed + 50, SHORT, 3)
    short = record_unit(arm, theta, scale, brief, SHORT, rng)
    long = record_unit(arm, theta, scale, plans[0], LONG, rng)
    fit, found_scale = fit_unit(short, found.estimate.prior, found)
    alone = WeightedLeastSquares().solve(long)
    last = plans[MOTIONS]
    return {
        "inside": float(np.mean(inside)),
        "of_parameters": np.mean(inside, axis=0).tolist(),
        "scales_inside": float(np.mean(scales <= 1.96 * found.estimate.scale_deviation)),
        "found": right in named,
        "false_parameters": len(named - {right}),
        "false_bodies": len(found.estimate.odd_bodies),
        "fleet_error": unseen_error(arm, theta, scale, fit.values, found_scale, last).tolist(),
        "alone_error": unseen_error(arm, theta, scale, alone.values, np.ones(n), last).tolist(),
        "merge_seconds": merging,
    }


def summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and ratios over all fleets."""
    fleet, alone = (np.array([each[key] for each in results]) for key in ("fleet_error", "alone_error"))
    ratio = np.linalg.norm(fleet, axis=1) / np.linalg.norm(alone, axis=1)
    of = np.mean([each["of_parameters"] for each in results], axis=0)
    return {
        "fleets": len(results),
        "inside": float(np.mean([each["inside"] for each in results])),
        "worst_parameter": float(of.min()),
        "best_parameter": float(of.max()),
        "scales_inside": float(np.mean([each["scales_inside"] for each in results])),
        "found": float(np.mean([each["found"] for each in results])),
        "fleets_with_false_parameters": sum(each["false_parameters"] > 0 for each in results),
        "fleets_with_false_bodies": sum(each["false_bodies"] > 0 for each in results),
        "new_unit_error_ratio": float(np.median(ratio)),
        "new_unit_error": float(np.sqrt(np.mean(np.sum(fleet**2, axis=1)))),
        "alone_error": float(np.sqrt(np.mean(np.sum(alone**2, axis=1)))),
        "merge_seconds": float(np.median([each["merge_seconds"] for each in results])),
    }


def main(arguments: list[str] | None = None) -> None:
    """Runs the benchmark and prints a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=20)
    parser.add_argument("--units", type=int, default=20)
    parser.add_argument("--joints", type=int, default=4)
    parser.add_argument("--zero", type=float, default=0.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    arm = make_arm(options.joints, options.zero)
    results: list[dict[str, Any]] = []
    for seed in range(options.first, options.first + options.fleets):
        results.append(run_fleet(arm, options.units, seed))
        sys.stderr.write(f"{seed}: {results[-1]['inside']:.3f} inside, found {results[-1]['found']}\n")
    found = summary(results)
    if options.json:
        sys.stdout.write(json.dumps(found, indent=1) + "\n")
        return
    for name, value in found.items():
        sys.stdout.write(f"{name:24} {value:.4g}\n")


if __name__ == "__main__":
    main()

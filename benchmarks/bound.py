"""Weighted least squares against the Cramér-Rao bound: `python benchmarks/bound.py [--runs 100] [--json]`.

Three virtual arms follow a motion exactly at 1 kHz; each joint's torque has white noise, and encoders have 1e-5 rad.
The bound is that of white torque noise with the motion known exactly, every sample at 1 kHz counted: noise of the
encoders can only raise it. What is estimated has passed the default processing and `wls`.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.problem import EstimationProblem
from armid.excitation.fourier import Excitation
from armid.excitation.thesis_plans import builtin_plan
from armid.hashes import digest
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, stack, total
from armid.lab.known_arms import truth_of
from armid.lab.simulation import true_model
from armid.maths.linalg import unit_columns
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings, resolve_options
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.robot import load_robot

ARMS = ("iiwa14-r820", "panda", "ur10e")
RATE = 1000.0
ENCODER = 1e-5
"""Standard deviation of the encoders' noise [rad]."""

NOISES = (0.01, 0.001)
"""Standard deviation of the torque's noise over the joint's effort limit: some N·m, and a tenth of it."""

SPEED = 0.6
"""Highest velocity of a motion over the joint's limit."""

WIDE = 0.7
"""Part of a joint's range that a motion covers at most, and of half a turn."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """Distance of an arm's estimates from the bound.

    Attributes:
        arm: Its name.
        noise: Standard deviation of the torque's noise over the effort limits.
        encoder: Standard deviation of the encoders' noise [rad].
        ratio: RMS over parameters and runs of the error over the bound's deviation.
        deviation: Of the ratio, by the scatter of the runs.
        bias: RMS over parameters of the mean error over the bound's deviation.
        cutoff: Of the band [Hz].
        runs: Number of runs.
    """

    arm: str
    noise: float
    encoder: float
    ratio: float
    deviation: float
    bias: float
    cutoff: float
    runs: int


def motion_for(name: str, seconds: float = 20.0, harmonics: int = 5) -> Excitation:
    """The thesis's motion for the iiwa; for others a random series inside position and velocity limits."""
    if name == "iiwa14-r820":
        return builtin_plan("thesis-a1").stretched(seconds)
    robot, rng = load_robot(name), np.random.default_rng(7)
    limits = np.array([joint.position_limits for joint in robot.joints])
    fastest = np.array([joint.velocity_limit for joint in robot.joints])
    middle = np.clip(limits.mean(axis=1), -3.0, 3.0)
    half = WIDE * np.minimum(0.5 * (limits[:, 1] - limits[:, 0]), np.pi / 2)
    a, b = rng.normal(size=(2, robot.n, harmonics))
    plan = Excitation(2.0 * np.pi / seconds, a, b, middle, name)
    along = plan.sample(100.0)
    scale = np.minimum(half / np.abs(along.q - middle).max(axis=0), SPEED * fastest / np.abs(along.dq).max(axis=0))
    return Excitation(plan.base_frequency, a * scale[:, None], b * scale[:, None], middle, name)


class Case:
    """An arm along its motion, and the bound."""

    def __init__(self, name: str, noise: float, seconds: float = 20.0) -> None:
        truth = truth_of(load_robot(name))
        self.name, self.noise, self.model = name, noise, true_model(truth)[0]
        self.base = find_base_parameters(self.model)
        self.right = self.base.values_of(true_model(truth)[1])
        self.motion = motion_for(name, seconds).sample(RATE)
        self.torque = self.model.torque(self.motion, true_model(truth)[1])
        self.levels = noise * np.array([joint.effort_limit for joint in truth.robot.joints])
        rows = self.motion.samples
        mask = np.ones((rows, self.model.n), dtype=np.bool_)
        block = (self.motion.time - self.motion.time[0]).astype(np.int64)
        run = ObservedRun(self.motion, self.torque, RATE, 1, 0, mask, block)
        exact = total(accumulate_information(self.model, self.base, Observations((run,), Band())))
        self.bound = self._deviation(exact)

    def _deviation(self, information: Information) -> Array:
        """Standard deviations (b,) that no unbiased estimate from these rows goes below."""
        A, size = unit_columns(stack(information, 1.0 / self.levels)[0])
        R = np.linalg.qr(A, mode="r")
        return np.linalg.norm(np.linalg.inv(R) / size[:, None], axis=1)

    def recorded(self, rng: np.random.Generator, encoder: float) -> Recording:
        """With noise; without that of encoders the log has exact velocities and accelerations, too."""
        q = self.motion.q + encoder * rng.standard_normal(self.motion.q.shape)
        effort = self.torque + self.levels * rng.standard_normal(self.torque.shape)
        log = Recording(
            time=self.motion.time, q=q, effort=effort, joint_names=self.model.robot.joint_names,
            consecutive=True, source=self.name, sha256=digest(q, effort),
        )  # fmt: skip
        return log if encoder else replace(log, dq=self.motion.dq, ddq=self.motion.ddq)

    def errors(self, rng: np.random.Generator, encoder: float, processing: ProcessingOptions) -> Array:
        """Error of each parameter over the bound's deviation."""
        observations, _ = process_recordings([self.recorded(rng, encoder)], processing)
        information = accumulate_information(self.model, self.base, observations)
        fit = WeightedLeastSquares().solve(EstimationProblem(information))
        return (fit.values - self.right) / self.bound


def measure(case: Case, encoder: float, runs: int, processing: ProcessingOptions | None = None) -> Ratio:
    """Estimates from so many recordings with noise of their own, the first resolving what is automatic."""
    errors = []
    processing = processing or ProcessingOptions()
    for seed in range(runs):
        errors.append(case.errors(np.random.default_rng(seed), encoder, processing))
    found = np.array(errors)
    own = np.sqrt(np.mean(found**2, axis=1))
    resolved = resolve_options(processing, [case.recorded(np.random.default_rng(0), encoder)])
    ratio = float(np.sqrt(np.mean(found**2)))
    bias = float(np.sqrt(np.mean(found.mean(axis=0) ** 2)))
    scatter = float(own.std(ddof=1) / np.sqrt(runs)) if runs > 1 else 0.0
    return Ratio(case.name, case.noise, encoder, ratio, scatter, bias, float(resolved.cutoff), runs)


def main() -> int:
    """Measure all arms and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="recordings of each case")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    results = []
    for name, noise in product(ARMS, NOISES):
        case = Case(name, noise)
        for encoder in (0.0, ENCODER):
            found = measure(case, encoder, options.runs)
            results.append(found)
            if not options.json:
                print(
                    f"{name:<12} noise {100 * noise:g} % {'encoders 1e-5 rad' if encoder else 'exact kinematics':<18}"
                    f"x {found.ratio:.3f} ± {found.deviation:.3f} of the bound, bias {found.bias:.3f}, "
                    f"band {found.cutoff:.3g} Hz, {case.base.count} parameters, {found.runs} runs",
                    flush=True,
                )
    if options.json:
        print(json.dumps([{name: getattr(each, name) for name in Ratio.__slots__} for each in results]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

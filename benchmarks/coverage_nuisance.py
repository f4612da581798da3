"""Coverage of 95 % intervals under systematic errors: `python benchmarks/coverage_nuisance.py [--runs N] [--json]`.

Every real log has a delay of part of a sample, a small lag between position and torque, zero errors of the encoders
and quantised channels. Each line is one such error, on a motion of 20 s at 200 Hz that is run through once. Each run
draws new links, which differ from the description by 15 % of the mass and 1 cm of the centre of mass, and new noise;
then it goes the whole way from a recording to the intervals. *mean* is the coverage over parameters and runs, *worst*
the smallest coverage of a parameter, *width* the median of half width over the textbook's, *error* the RMS error over
the textbook's deviation, and *said* the codes of findings of the estimate with the share of runs that have them.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.estimation.catalogue import ESTIMATORS
from armid.estimation.fit_result import Fit
from armid.estimation.problem import build_problem
from armid.estimation.run_estimator import estimate
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.simulation import true_model
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.robot import load_robot

ARMS = ("iiwa14-r820", "ur10e")
SECONDS, RATE = 20.0, 200.0
HARMONICS = 6

LEVEL = 0.01
"""Standard deviation of the noise of each sample, divided by the RMS torque of the joint."""

WEAK = 0.05
"""The same for data that leave more of the parameters to a prior."""

MASS, CENTRE = 0.15, 0.01
"""Deviations of the mass of links, relative, and of their centre of mass [m], from the description."""

STRIBECK, STRIBECK_SPEED = 0.1, 0.1
"""Friction that is missing in the model: share of Coulomb friction, and speed at which it has faded [rad/s]."""

RIPPLE, TEETH = 0.01, 30.0
"""Torque ripple that is missing in the model: share of the RMS torque, and periods a turn."""

POOR = 0.85
"""Coverage of a parameter below which it is listed."""

OFTEN = 0.5
"""Share of the runs in which a parameter must be called identified to count as such."""

TWELVE_BITS = 2.0 * np.pi / 4096.0
"""Position step of an encoder of 12 bits [rad]."""


@dataclass(frozen=True, slots=True)
class Case:
    """One kind of systematic error.

    Attributes:
        noise: Kind of noise.
        delay: Delay of the torque [samples].
        lag: Time constant of a first-order lag of the torque [samples].
        zero: Standard deviation of the zero errors of the encoders [rad].
        position_step: Step of the positions [rad].
        torque_bits: Number of bits of the torque over ± twice its peak; 0 for none.
        stribeck: Friction that falls with speed, missing in the model, as a share of Coulomb friction.
        ripple: Ripple that is missing in the model, as a share of the RMS torque.
        slow: Factor by which the motion is slower; the recording has the same length.
        level: Standard deviation of the noise of a sample, divided by the RMS torque of the joint.
    """

    noise: str = "white"
    delay: float = 0.0
    lag: float = 0.0
    zero: float = 0.0
    position_step: float = 0.0
    torque_bits: int = 0
    stribeck: float = 0.0
    ripple: float = 0.0
    slow: float = 1.0
    level: float = LEVEL


CASES = {
    "white": Case(),
    "AR(1) 100 ms": Case("AR"),
    "delay 0.5": Case(delay=0.5),
    "delay 2": Case(delay=2.0),
    "lag 1": Case(lag=1.0),
    "zero 1 mrad": Case(zero=1e-3),
    "12 bit": Case(position_step=TWELVE_BITS, torque_bits=12),
    "Stribeck": Case(stribeck=STRIBECK),
    "ripple": Case(ripple=RIPPLE),
    "all": Case("AR", 0.5, 1.0, 1e-3, TWELVE_BITS, 12),
    "slow, 12 bit": Case(position_step=TWELVE_BITS, slow=4.0),
    "resonance": Case("resonance"),
    "by velocity": Case("velocity"),
    "by torque": Case("torque"),
    "bursts": Case("bursts"),
    "weak": Case(level=WEAK),
    "weak, AR": Case("AR", level=WEAK),
}
METHODS: dict[str, Callable[[], Any]] = {
    "wls": ESTIMATORS["wls"],
    "ols": ESTIMATORS["ols"],
    "robust": ESTIMATORS["robust"],
    "ridge": ESTIMATORS["ridge"],
    "physical": ESTIMATORS["physical"],
    "log-det": lambda: ESTIMATORS["physical"](prior="log-det"),
    "euclidean": lambda: ESTIMATORS["physical"](prior="euclidean"),
}


def motion_of(n: int, speed: float, seed: int = 3) -> Excitation:
    """A random series of 20 s, or longer where it is slow, within usual speeds."""
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((2, n, HARMONICS)) * 0.35
    frequency = np.arange(1, HARMONICS + 1) * 2.0 * np.pi / SECONDS * 2.0
    b[:, -1] = -(b[:, :-1] / frequency[:-1]).sum(axis=1) * frequency[-1]
    return Excitation(2.0 * np.pi / SECONDS * 2.0 * speed, a * speed, b * speed, rng.uniform(-0.4, 0.4, n))


class Simulation:
    """An arm with its motion, from which recordings are drawn."""

    def __init__(self, arm: str, case: Case) -> None:
        self.case = case
        self.truth = truth_of(load_robot(arm))
        self.model, self.described = true_model(self.truth)
        self.base = find_base_parameters(self.model)
        self.plan = motion_of(self.model.n, 1.0 / case.slow)
        torque = self.model.torque(self.plan.sample(RATE), self.described)
        self.rms, self.peak = np.sqrt(np.mean(torque**2, axis=0)), np.abs(torque).max(axis=0)

    def links(self, rng: np.random.Generator) -> Array:
        """True standard parameters, whose bodies are near the description."""
        theta = self.described.copy()
        for own in self.model.inertial_columns.reshape(-1, 10):
            J = pseudo_inertia(theta[own])
            mass, com = J[3, 3], J[:3, 3] / J[3, 3]
            about = J[:3, :3] - mass * np.outer(com, com)
            factor = np.exp(MASS * rng.standard_normal())
            com = com + CENTRE * rng.standard_normal(3)
            J[:3, :3] = factor * (about + mass * np.outer(com, com))
            J[:3, 3] = J[3, :3] = factor * mass * com
            J[3, 3] = factor * mass
            theta[own] = vector_from_pseudo_inertia(J)
        return theta

    def recorded(self, rng: np.random.Generator) -> tuple[Recording, Array]:
        """A recording, and the true standard parameters."""
        case, theta = self.case, self.links(rng)
        time = np.arange(round(SECONDS * RATE)) / RATE
        ahead = 400  # samples before the log, in which a lag settles
        long = (np.arange(-ahead, len(time)) - case.delay) / RATE
        motion = self.plan.at(long)
        torque = self.model.torque(motion, theta)
        coulomb = np.asarray(self.truth.friction.coulomb)
        torque += case.stribeck * coulomb * np.exp(-((motion.dq / STRIBECK_SPEED) ** 2)) * np.sign(motion.dq)
        torque += case.ripple * self.rms * np.sqrt(2.0) * np.sin(TEETH * motion.q)
        if case.lag:
            from scipy.signal import lfilter

            pole = np.exp(-1.0 / case.lag)
            torque = lfilter([1.0 - pole], [1.0, -pole], torque, axis=0)
            torque = np.asarray(torque)
        torque = torque[ahead:] + self._noise(rng, motion.dq[ahead:], torque[ahead:])
        if case.torque_bits:
            step = 4.0 * self.peak / 2.0**case.torque_bits
            torque = np.round(torque / step) * step
        q = self.plan.at(time).q + case.zero * rng.standard_normal(self.model.n)
        if case.position_step:
            phase = case.position_step * rng.uniform(size=self.model.n)  # otherwise all runs have the same rounding
            q = np.round((q - phase) / case.position_step) * case.position_step + phase
        names = self.model.robot.joint_names
        return Recording(time, q, effort=torque, joint_names=names, consecutive=True), theta

    def _noise(self, rng: np.random.Generator, dq: Array, torque: Array) -> Array:
        """Noise of the torque, shape (N, n)."""
        from scipy.signal import lfilter

        N, n = torque.shape
        z, kind = rng.standard_normal((N + 1000, n)), self.case.noise
        if kind == "AR":
            a = np.exp(-1.0 / (RATE * 0.1))
            z = np.asarray(lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], z, axis=0))
        if kind == "resonance":
            a, w = 0.97, 2.0 * np.pi * 3.0 / RATE
            z = np.asarray(lfilter([1.0], [1.0, -2.0 * a * np.cos(w), a * a], z, axis=0))
            z /= z[1000:].std(axis=0)
        z = z[1000:]
        if kind == "velocity":
            z *= np.abs(dq) / np.sqrt(np.mean(dq**2, axis=0))
        if kind == "torque":
            z *= np.abs(torque) / np.sqrt(np.mean(torque**2, axis=0))
        if kind == "bursts":
            begin = rng.integers(0, N, 12)
            burst = np.any([(np.arange(N) >= b) & (np.arange(N) < b + 60) for b in begin], axis=0)
            z *= np.where(burst, 3.0, 0.6)[:, None]
        return z * self.case.level * self.rms


def measure(arm: str, name: str, methods: list[str], runs: int, seed: int) -> list[dict[str, Any]]:
    """Coverage of one case on one arm with each method, from the same recordings."""
    simulation = Simulation(arm, CASES[name])
    found = {method: _Outcomes() for method in methods}
    for k in range(runs):
        recording, theta = simulation.recorded(np.random.default_rng((seed, k)))
        observations, _ = process_recordings([recording], ProcessingOptions(), periods=[None])
        problem = build_problem(simulation.model, observations, base=simulation.base)
        for method, outcomes in found.items():
            began = time.perf_counter()
            outcomes.add(estimate(problem, METHODS[method]()), theta, simulation.base)
            outcomes.seconds += time.perf_counter() - began
    return [{"arm": arm, "case": name, "method": method, **each.summary()} for method, each in found.items()]


class _Outcomes:
    """Fits of the same case and method."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.inside: list[Any] = []
        self.width: list[Any] = []
        self.errors: list[Any] = []
        self.identified: list[Any] = []
        self.names: tuple[str, ...] = ()
        self.said: Counter[str] = Counter()

    def add(self, fit: Fit, theta: Array, base: BaseParameters) -> None:
        """Adds a fit, given the true standard parameters (p,)."""
        true = base.values_of(theta)
        held = (fit.intervals[:, 0] <= true) & (true <= fit.intervals[:, 1])
        self.inside.append(held)
        self.width.append((fit.intervals[:, 1] - fit.intervals[:, 0]) / 2.0 / (1.96 * fit.white_deviation))
        self.errors.append((fit.values - true) / fit.white_deviation)
        self.names = tuple(str(name) for name in base.names)
        self.said.update({f.code for f in fit.findings})
        self.identified.append(_held_identified(fit, held, theta))

    def summary(self) -> dict[str, Any]:
        """Figures of the table."""
        inside, identified = np.array(self.inside), np.array(self.identified)
        each, runs = inside.mean(axis=0), len(inside)
        worst = int(np.argmin(each))
        counted = np.isfinite(identified).sum(axis=0)
        often = counted > OFTEN * runs
        of_identified = np.nansum(identified, axis=0)[often] / counted[often]
        return {
            "runs": runs,
            "mean": float(inside.mean()),
            "worst": float(each.min()),
            "worst_parameter": self.names[worst],
            "worst_identified": float(of_identified.min()) if often.any() else 1.0,
            "mean_identified": float(of_identified.mean()) if often.any() else 1.0,
            "identified": int(often.sum()),
            "poor": [f"{self.names[k]} {each[k]:.2f}" for k in np.flatnonzero(each < POOR)],
            "width": float(np.median(self.width)),
            "error": float(np.sqrt(np.mean(np.square(self.errors)))),
            "said": {code: count / runs for code, count in self.said.items()},
            "seconds": self.seconds / runs,
        }


def _held_identified(fit: Fit, held: Any, theta: Array) -> Any:
    """1 or 0 for each parameter that the estimate calls identified, by whether the interval holds; NaN for others.

    With standard parameters these are the p standard parameters, otherwise the b base parameters.
    """
    if fit.standard is not None:
        ends = fit.standard.intervals
        inside = (ends[:, 0] <= theta) & (theta <= ends[:, 1])
        return np.where(np.array(fit.standard.status) == "identified", inside, np.nan)
    listed = " ".join(f.evidence for f in fit.findings if f.code == "prior-dominated")
    names = {part.strip(" .") for part in listed.partition(":")[2].split(",")}
    return np.where([name not in names for name in fit.names], held, np.nan)


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    said = ", ".join(f"{code} {share:.0%}" for code, share in sorted(row["said"].items()))
    return (
        f"{row['arm']:<12}{row['case']:<14}{row['method']:<10}{100 * row['mean']:5.1f} {100 * row['worst']:5.1f} "
        f"{row['worst_parameter']:<6} identified {row['identified']:<3}{100 * row['mean_identified']:5.1f} "
        f"{100 * row['worst_identified']:5.1f} "
        f"×{row['width']:.2f} error {row['error']:.2f}  {row['seconds']:.2f} s  {said}"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--arm", action="append", choices=ARMS)
    parser.add_argument("--case", action="append", choices=list(CASES))
    parser.add_argument("--method", action="append", choices=list(METHODS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for arm in options.arm or ARMS:
        for name in options.case or CASES:
            found = measure(arm, name, options.method or ["wls"], options.runs, options.seed)
            rows += found
            if not options.json:
                print("\n".join(map(line, found)), flush=True)
    if options.json:
        print(json.dumps(rows, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

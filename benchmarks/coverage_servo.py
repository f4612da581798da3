"""Coverage of the intervals of `armid servo` on virtual arms: `python benchmarks/coverage_servo.py [--arms 200]`.

Arms with the geometry of the UR5e and of a hobby arm; servos of any stiffness, delays of 0 to 20 ms, encoders of
12 to 16 bit, logs of 50 to 500 Hz; links that differ from the description by 10 %. The motion is integrated with
steps of 0.5 ms.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from armid.robot import load_robot
from armid.servo import closed_loop
from armid.servo.estimate_table import estimated_values
from armid.servo.identify_servo import identify_servo
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.score import closed_loop_error
from armid.servo.servo_run import ServoRun
from servo_labs import servo_model, small_arm, unlike

FINE = 5e-4
"""Step of the simulated truth [s]."""


def any_arm(model: ServoModel, rng: np.random.Generator) -> ServoParameters:
    """Servos that hold the links with errors of about 10 to 50 mrad; any friction and rotor inertia."""
    n, bodies = model.n, model.robot.inertial_vector
    need = np.full(n, 0.5) if model.robot.name == "small arm" else np.array([60.0, 80.0, 40.0, 8.0, 8.0, 4.0])
    stiffness = need / np.exp(rng.uniform(np.log(0.01), np.log(0.05), n))
    shares = {
        "FV": np.exp(rng.uniform(np.log(0.01), np.log(0.06), n)),
        "FS": np.exp(rng.uniform(np.log(2e-3), np.log(0.02), n)),
    }
    return ServoParameters(
        unlike(bodies, rng),
        stiffness * np.exp(rng.uniform(np.log(3e-4), np.log(2e-3), n)),
        np.array([stiffness[law.joint] * shares[law.symbol][law.joint] for law in model.laws]),
        stiffness,
        np.zeros(n),
        np.full(n, np.inf),
        rng.normal(0.0, 0.01, n),
        np.full(n, rng.uniform(0.0, 0.02)),
    )


def any_run(model: ServoModel, truth: ServoParameters, rng: np.random.Generator, rate: float, bits: int) -> ServoRun:
    """30 s of five frequencies, read by the encoders."""
    samples = round(30.0 * rate)
    t = np.arange(samples) / rate
    command = rng.uniform(-0.4, 0.4, (1, model.n)) + np.zeros((samples, model.n))
    for _ in range(5):
        f, phase = rng.uniform(0.05, 0.8, model.n), rng.uniform(0.0, 6.0, model.n)
        command += (
            rng.uniform(0.05, 0.3, model.n) * np.minimum(1.0, 0.5 / f) * np.sin(2.0 * np.pi * f * t[:, None] + phase)
        )
    still = ServoRun(1.0 / rate, 0.0, np.repeat(command[:1], samples, axis=0), np.zeros(model.n), t, command)
    usual, closed_loop.LONGEST_STEP = closed_loop.LONGEST_STEP, FINE
    try:
        (found,) = closed_loop.simulate(model, truth, [still])
    finally:
        closed_loop.LONGEST_STEP = usual
    step = 2.0 * np.pi / 2**bits
    return replace(still, q=np.round(found.q / step) * step).part(round(0.5 * rate), samples)


def main() -> int:
    """Print the share of the intervals that hold the truth, by kind and origin."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=200, help="number of arms")
    parser.add_argument("--first", type=int, default=0, help="seed of the first arm")
    options = parser.parse_args()
    models = [servo_model(small_arm()), servo_model(load_robot("ur5e"))]
    held: dict[tuple[str, str], list[bool]] = defaultdict(list)
    ratios: list[float] = []
    for seed in range(options.first, options.first + options.arms):
        rng, model = np.random.default_rng(seed), models[seed % 2]
        truth, rate, bits = (
            any_arm(model, rng),
            float(rng.choice([50.0, 100.0, 200.0, 500.0])),
            int(rng.integers(12, 17)),
        )
        train, other = (any_run(model, truth, rng, rate, bits) for _ in range(2))
        found = identify_servo(model, [train])
        for each in estimated_values(found, [train]):
            law = [k for k, law in enumerate(model.laws) if (law.symbol, law.joint) == (each.kind, each.joint)]
            true = truth.friction[law[0]] if law else getattr(truth, each.kind)[each.joint]
            held[each.kind, each.origin].append(bool(each.low <= true <= each.high))
        error = closed_loop_error(model, found.parameters, [other]).total
        ratios.append(error / closed_loop_error(model, found.unknowns.mean, [other]).total)
        sys.stderr.write(f"\r{seed + 1 - options.first} of {options.arms}")
    sys.stderr.write("\n")
    for (kind, origin), inside in sorted(held.items()):
        sys.stdout.write(f"{kind:15} {origin:17} {np.mean(inside):6.1%} of {len(inside)}\n")
    typical, largest = np.median(ratios), np.max(ratios)
    sys.stdout.write(f"error on another motion, refined over first: median {typical:.3f}, largest {largest:.3f}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

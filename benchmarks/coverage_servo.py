"""Coverage of the intervals of `armid servo` on virtual arms: `python benchmarks/coverage_servo.py [--arms 200]`.

Arms with the geometry of iiwa 14, Panda and UR5e and of a hobby arm; servos of any stiffness, delays of 0 to 20 ms,
encoders of 12 to 16 bit, logs of 50 to 500 Hz; links that differ from the description by 10 %; servos whose largest
torque differs from the description by 20 %, or which have none though the description states one. The motion is
integrated with steps of 0.25 ms. A gain is *not shown* if the recording, at the true parameters, leaves an interval
wider than a factor of 2.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.robot import load_robot
from armid.robot.robot import Robot
from armid.servo.closed_loop import simulate
from armid.servo.estimate_table import NARROW, NORMAL_95, estimated_values
from armid.servo.identify_servo import ServoEstimate, identify_servo
from armid.servo.output_error import minimise_output_error
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.score import closed_loop_error
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import Unknowns
from servo_labs import servo_model, small_arm, unlike

FINE = 2.5e-4
"""Step of the simulated truth [s]."""

UNLIMITED = 0.3
"""Share of the arms whose servos have no limit though the description states one."""

NOT_SHOWN = 2.0
"""Factor above which the interval of a gain is so wide that the recording does not show it."""


def arms() -> list[ServoModel]:
    """Arms with masses; the Panda has the links of the iiwa 14, since its description has none."""
    iiwa, panda = load_robot("iiwa14-r820"), load_robot("panda")
    links = [replace(link, inertial=heavy.inertial) for link, heavy in zip(panda.links, iiwa.links, strict=True)]
    return [servo_model(robot) for robot in (small_arm(), load_robot("ur5e"), iiwa, replace(panda, links=links))]


def usual_torque(robot: Robot) -> Array:
    """Torques that the joints have in motion: 15 % of the largest ones, or those of a hobby servo [N·m]."""
    largest = np.array([joint.effort_limit for joint in robot.joints])
    return np.where(np.isfinite(largest), 0.15 * largest, 0.5)


def any_arm(model: ServoModel, rng: np.random.Generator) -> ServoParameters:
    """Servos that hold the links with errors of about 10 to 50 mrad; any friction and rotor inertia."""
    n, bodies = model.n, model.robot.inertial_vector
    assert bodies is not None
    stiffness = usual_torque(model.robot) / np.exp(rng.uniform(np.log(0.01), np.log(0.05), n))
    shares = {
        "FV": np.exp(rng.uniform(np.log(0.01), np.log(0.06), n)),
        "FS": np.exp(rng.uniform(np.log(2e-3), np.log(0.02), n)),
    }
    described = np.array([joint.effort_limit for joint in model.robot.joints])
    limit = described * np.exp(rng.normal(0.0, 0.2, n))
    return ServoParameters(
        unlike(bodies, rng),
        stiffness * np.exp(rng.uniform(np.log(3e-4), np.log(2e-3), n)),
        np.array([stiffness[law.joint] * shares[law.symbol][law.joint] for law in model.laws]),
        stiffness,
        np.zeros(n),
        np.full(n, np.inf) if rng.random() < UNLIMITED else limit,
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
    (found,) = simulate(replace(model, longest_step=FINE), truth, [still])
    step = 2.0 * np.pi / 2**bits
    return replace(still, q=np.round(found.q / step) * step).part(round(0.5 * rate), samples)


def deviations_at_truth(estimate: ServoEstimate, truth: ServoParameters, run: ServoRun) -> dict[int, float]:
    """Deviation of the logarithm of each stiffness under the prior of the estimate, linearised at the truth."""
    own = Unknowns(estimate.unknowns.model, truth, estimate.unknowns.deviations)
    fit = minimise_output_error(own, [run], most_steps=0)
    of = np.sqrt(np.diag(fit.covariance))
    return {k: float(of[i]) for i, (name, k) in enumerate(own.names()) if name == "stiffness"}


def main() -> int:
    """Print the share of the intervals that hold the truth, by kind and origin."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=200, help="number of arms")
    parser.add_argument("--first", type=int, default=0, help="seed of the first arm")
    parser.add_argument("--each", action="store_true", help="print a line for each arm")
    options = parser.parse_args()
    models = arms()
    held: dict[tuple[str, str], list[bool]] = defaultdict(list)
    not_shown: list[bool] = []
    wrong: list[bool] = []
    late: list[float] = []
    ratios: list[float] = []
    for seed in range(options.first, options.first + options.arms):
        rng, model = np.random.default_rng(seed), models[seed % len(models)]
        truth, rate, bits = (
            any_arm(model, rng),
            float(rng.choice([50.0, 100.0, 200.0, 500.0])),
            int(rng.integers(12, 17)),
        )
        train, other = (any_run(model, truth, rng, rate, bits) for _ in range(2))
        try:
            found = identify_servo(model, [train])
        except ArmidError as error:
            sys.stdout.write(f"seed {seed}, {model.robot.name}: {error}\n")
            continue
        shown = deviations_at_truth(found, truth, train)
        outside = []
        for each in estimated_values(found, [train]):
            law = [k for k, law in enumerate(model.laws) if (law.symbol, law.joint) == (each.kind, each.joint)]
            true = truth.friction[law[0]] if law else getattr(truth, each.kind)[each.joint]
            if np.isinf(true) or each.origin == "given":
                continue
            inside = bool(each.low <= true <= each.high)
            held[each.kind, each.origin].append(inside)
            outside += [] if inside else [f"{each.kind} {each.joint + 1} {each.origin}"]
            called = each.origin == "identified"
            if each.kind == "delay" and called:
                late.append(abs(each.value - true) * rate)
            elif each.kind != "offset" and called:
                wrong.append(abs(np.log(each.value / true)) > np.log(NARROW))
            if each.kind == "stiffness" and NORMAL_95 * shown[each.joint] > np.log(NOT_SHOWN):
                not_shown.append(called)
        error = closed_loop_error(model, found.parameters, [other]).total
        ratios.append(error / closed_loop_error(model, found.unknowns.mean, [other]).total)
        if options.each:
            sys.stdout.write(
                f"seed {seed}, {model.robot.name}, {rate:g} Hz, {bits} bit, {found.fit.steps} steps, "
                f"step {1e3 * found.unknowns.model.longest_step:.2g} ms, error {1e3 * error:.3g} mrad, "
                f"{ratios[-1]:.2g} of the first estimate's, outside: {', '.join(outside) or 'none'}\n"
            )
            sys.stdout.flush()
        sys.stderr.write(f"\r{seed + 1 - options.first} of {options.arms}")
    sys.stderr.write("\n")
    for (kind, origin), inside in sorted(held.items()):
        sys.stdout.write(f"{kind:15} {origin:17} {np.mean(inside):6.1%} of {len(inside)}\n")
    sys.stdout.write(
        f"called identified but wrong by more than a factor of {NARROW}: {np.mean(wrong):.1%} of {len(wrong)}\n"
        f"stiffness not shown, but called identified: {sum(not_shown)} of {len(not_shown)}\n"
        f"error of identified delays in samples: median {np.median(late):.3f}, 95 % {np.quantile(late, 0.95):.3f}\n"
        f"error on another motion, refined over first: median {np.median(ratios):.3f}, largest {np.max(ratios):.3f}\n"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Widths of the intervals of `armid servo` with designed and with random motion: `python benchmarks/excite_servo.py`.

On the virtual hobby arm and the virtual leg, a motion of commands is designed, and random sums of sines of the same
length, rate and limits are drawn. The lab records each of them, `armid servo` identifies the arm, and the logarithms
of the widths are compared.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from armid.excitation.command_motion import CommandMotion, random_commands
from armid.lab.servos.options import ServoLabOptions
from armid.lab.servos.simulation import simulate_servo
from armid.lab.servos.virtual_arms import (
    LEG,
    VIRTUAL_ARMS,
    KnownServoArm,
    description_of,
    known_servo_arm,
    options_for,
)
from armid.model.terms import Coulomb, Viscous
from armid.robot import load_robot
from armid.servo.estimate_table import estimated_values
from armid.servo.identify_servo import identify_servo
from armid.servo.motion_design.search import design_commands
from armid.servo.options import ServoOptions
from armid.servo.parameters import ServoModel, make_servo_model
from armid.servo.servo_run import servo_runs

KINDS = ("stiffness", "rotor_inertia", "FV", "FS", "delay")


def widths(
    model: ServoModel,
    arm: KnownServoArm,
    lab: ServoLabOptions,
    known: ServoOptions,
    commands: CommandMotion,
    seed: int,
) -> dict[str, float]:
    """Mean logarithm of the width of the intervals of each kind, after a simulated log of a motion."""
    runs = list(servo_runs(simulate_servo(arm, commands, lab, seed=seed).recording))
    values = estimated_values(identify_servo(model, runs, known), runs)
    found = {}
    for kind in KINDS:
        each = [v for v in values if v.kind == kind and v.origin != "given"]
        if each:
            size = [v.high - v.low if kind == "delay" else np.log(v.high / v.low) for v in each]
            found[kind] = float(np.mean(np.log(size)))
    return found


def main() -> int:
    """Print the widths of each kind, geometric means over the joints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the motions")
    parser.add_argument("--budget", type=float, default=20.0, help="time of a design, s")
    parser.add_argument("--motions", type=int, default=3, help="number of designed and of random motions")
    options = parser.parse_args()
    for name in VIRTUAL_ARMS:
        robot = load_robot(description_of(name))
        lab, model = options_for(robot), make_servo_model(robot, [Viscous(), Coulomb(0.0)])
        arm = known_servo_arm(robot, lab)
        known = ServoOptions(stiffness=arm.stiffness, damping=arm.damping) if name == LEG else ServoOptions()
        rate = lab.sensing.rate
        kinds: dict[str, list[dict[str, float]]] = {"designed": [], "random": []}
        for seed in range(1, options.motions + 1):
            design = design_commands(
                model, known, seconds=options.seconds, rate=rate, budget=options.budget, seed=seed
            )
            drawn = random_commands(robot, options.seconds, rate, np.random.default_rng(seed))
            kinds["designed"].append(widths(model, arm, lab, known, design.commands, seed))
            kinds["random"].append(widths(model, arm, lab, known, drawn, seed))
            sys.stderr.write(f"{name}: {seed} of {options.motions}\n")
        for kind in kinds["random"][0]:
            means = {which: np.mean([each[kind] for each in found]) for which, found in kinds.items()}
            spread = {which: np.ptp([each[kind] for each in found]) for which, found in kinds.items()}
            sys.stdout.write(
                f"{name:10} {kind:14} designed / random {np.exp(means['designed'] - means['random']):.2f}  "
                f"(spread of designed {np.exp(spread['designed']):.2f}, random {np.exp(spread['random']):.2f})\n"
            )
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

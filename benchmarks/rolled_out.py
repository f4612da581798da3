"""Closed-loop roll-out with derivatives beside MuJoCo's finite differences.

    python benchmarks/rolled_out.py [--json]

An arm with six joints, servos and dry friction, 30 s with steps of a millisecond, positions at 50 Hz, one thread.
armid: the motion, its exact derivatives by 72 parameters, and a Gauss-Newton step. The peer rolls the same arm out
once for each parameter, as identification by finite differences does; the time of one roll-out in C
(`mujoco.rollout`) is multiplied.
"""

from __future__ import annotations

import argparse
import json
import sys
import time

import mujoco
import mujoco.rollout
import numpy as np

from armid import kernel
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.kernel import RollOutParameters, make_layout
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from armid.servo.parameters import ServoParameters, make_servo_model

SECONDS, STEP, EVERY, TIMES = 30.0, 1e-3, 20, 7
"""Length [s], step [s], steps from one sample to the next, and number of repetitions, of which the fastest counts."""


def fastest(work) -> float:
    """CPU time of the fastest of some repetitions [s]."""
    found = []
    for _ in range(TIMES):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return min(found)


def main() -> int:
    """Measure both in one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    robot = load_robot("ur5e")
    model, n = make_servo_model(robot, [Viscous(), Coulomb(0.0)]), 6
    bodies = robot.inertial_vector
    friction = np.array([8.0 if law.symbol == "FV" else 3.0 for law in model.laws])
    stiffness, rotor = np.full(n, 2000.0), np.full(n, 0.5)
    parameters = ServoParameters(
        bodies, rotor, friction, stiffness, np.full(n, 60.0), np.full(n, np.inf), np.zeros(n), np.zeros(n)
    )
    steps = round(SECONDS / STEP)
    t = STEP * (np.arange(steps) + 0.5)
    command = np.sin(2.0 * np.pi * np.outer(t, np.linspace(0.1, 0.4, n))) * 0.5 + [0.0, -1.2, 1.0, -1.0, -1.5, 0.0]
    start, still = command[:1], np.zeros((1, n))
    base = find_base_parameters(DynamicsModel(robot, (RigidBody(),))).kept
    links = np.full(10 * n, -1)
    links[base] = np.arange(len(base))
    count = len(base) + 6 * n
    wanted = RollOutParameters(
        count,
        make_layout(robot.tree, links, np.zeros(0, dtype=int), np.zeros(0, dtype=int)),
        len(base) + np.arange(2 * n),
        np.stack([len(base) + (2 + k) * n + np.arange(n) if k < 2 else np.full(n, -1) for k in range(4)]),
        np.tile(np.arange(n), 2),
        len(base) + 4 * n + np.arange(2 * n),
    )
    servos = model.joints(parameters, STEP)
    inputs = np.ones((2 * n, steps))
    measured = np.zeros((steps // EVERY, n))

    def motion():
        return kernel.roll_out(robot.tree, bodies, servos, command[None], None, start, still)

    def step() -> None:
        q, dq, _ = motion()
        slopes = kernel.roll_out_sensitivities(
            robot.tree, bodies, servos, wanted, command, None, inputs, q[0], dq[0], EVERY
        ).reshape(-1, count)
        residual = (measured - q[0, EVERY::EVERY]).ravel()
        np.linalg.solve(slopes.T @ slopes + 1e-6 * np.eye(count), slopes.T @ residual)

    ours, value = fastest(step), fastest(motion)
    theirs = mujoco.MjModel.from_xml_string(servo_mjcf(model, parameters).decode())
    data = mujoco.MjData(theirs)
    initial = np.concatenate([[0.0], start[0], still[0], np.zeros(theirs.na)])[None]
    peer = fastest(lambda: mujoco.rollout.rollout(theirs, [data], initial, command[None]))
    found = {
        "parameters": count,
        "motion_ms": 1e3 * value,
        "motion_derivatives_and_step_ms": 1e3 * ours,
        "mujoco_roll_out_ms": 1e3 * peer,
        "ratio_to_finite_differences": (count + 1) * peer / ours,
    }
    if options.json:
        sys.stdout.write(json.dumps(found) + "\n")
        return 0
    sys.stdout.write(
        f"30 s at 1 kHz, six joints, {count} parameters: motion {1e3 * value:.1f} ms; motion, derivatives and "
        f"Gauss-Newton step {1e3 * ours:.1f} ms\nMuJoCo: one roll-out {1e3 * peer:.1f} ms, finite differences "
        f"{(count + 1) * peer:.2f} s: {found['ratio_to_finite_differences']:.0f} times as long\n"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Closed-loop roll-out with derivatives beside MuJoCo's finite differences.

    python benchmarks/rolled_out.py [--beside EXTENSION] [--json]

An arm with six joints, servos and dry friction, 30 s with steps of a millisecond, positions at 50 Hz, one thread, 72
unknowns: base parameters of the links, friction, rotor inertia, stiffness, offset and delay of each joint. armid: the
motion, its exact derivatives, and a Gauss-Newton step. The peer does the same with MuJoCo's roll-out in C
(`mujoco.rollout`) and `mujoco.minimize.jacobian_fd`, the finite differences of `mujoco.sysid`: one roll-out for each
unknown. `--beside` measures another build of the kernel's extension (`_native….so`) in the same run.
"""

from __future__ import annotations

import argparse
import importlib.machinery
import importlib.util
import json
import subprocess
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import mujoco
import mujoco.minimize
import mujoco.rollout
import numpy as np

from armid.checked_array import Array

SECONDS, STEP, EVERY, TIMES = 30.0, 1e-3, 20, 9
"""Length [s], step [s], steps from one sample to the next, and number of repetitions, of which the fastest counts."""

DIFFERENCE = 1e-6
"""Step of the finite differences, of each unknown in its own unit."""

EXTENSION = "armid.kernel._native"


class OtherExtension:
    """Finder of another build of the kernel's extension.

    Args:
        path: The extension.
    """

    def __init__(self, path: str) -> None:
        self.path = path

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Specification of the extension."""
        del path, target
        if name != EXTENSION:
            return None
        loader = importlib.machinery.ExtensionFileLoader(name, self.path)
        return importlib.util.spec_from_file_location(name, self.path, loader=loader)


def commands_at(t: Array, n: int) -> Array:
    """Commands of all joints at times t, shape (N, n) [rad]."""
    return np.sin(2.0 * np.pi * np.outer(t, np.linspace(0.1, 0.4, n))) * 0.5 + [0.0, -1.2, 1.0, -1.0, -1.5, 0.0]


@dataclass
class Times:
    """CPU time of the parts of a Gauss-Newton step, of each repetition [s]."""

    motion: list[float] = field(default_factory=list)
    derivatives: list[float] = field(default_factory=list)
    step: list[float] = field(default_factory=list)
    all: list[float] = field(default_factory=list)

    def fastest(self) -> dict[str, float]:
        """Time of each part in the fastest repetition of the whole [ms]."""
        best = int(np.argmin(self.all))
        return {name: 1e3 * getattr(self, name)[best] for name in ("motion", "derivatives", "step", "all")}


class Problem:
    """The arm, its servos and its 72 unknowns."""

    def __init__(self) -> None:
        from armid.kernel import RollOutParameters, make_layout
        from armid.model.base_parameters import find_base_parameters
        from armid.model.dynamics_model import DynamicsModel
        from armid.model.terms import Coulomb, RigidBody, Viscous
        from armid.robot import load_robot
        from armid.servo.parameters import ServoParameters, make_servo_model

        robot = load_robot("ur5e")
        self.model = make_servo_model(robot, [Viscous(), Coulomb(0.0)])
        self.n = n = self.model.n
        friction = np.array([8.0 if law.symbol == "FV" else 3.0 for law in self.model.laws])
        none = np.zeros(n)
        self.parameters = ServoParameters(
            robot.inertial_vector, np.full(n, 0.5), friction, np.full(n, 2000.0), np.full(n, 60.0),
            np.full(n, np.inf), none, none,
        )  # fmt: skip
        self.base = find_base_parameters(DynamicsModel(robot, (RigidBody(),))).kept
        self.count = len(self.base) + 6 * n
        links = np.full(10 * n, -1)
        links[self.base] = np.arange(len(self.base))
        gains = np.full((4, n), -1)
        gains[:2] = len(self.base) + 2 * n + np.arange(2 * n).reshape(2, n)
        self.wanted = RollOutParameters(
            self.count,
            make_layout(robot.tree, links, np.zeros(0, dtype=int), np.zeros(0, dtype=int)),
            len(self.base) + np.arange(2 * n),
            gains,
            np.tile(np.arange(n), 2),
            len(self.base) + 4 * n + np.arange(2 * n),
        )
        self.time = STEP * (np.arange(round(SECONDS / STEP)) + 0.5)
        self.command = commands_at(self.time, n)
        slope = (commands_at(self.time + STEP, n) - commands_at(self.time - STEP, n)) / (2.0 * STEP)
        stiffness = self.parameters.stiffness
        self.inputs = np.concatenate([np.tile(-stiffness[:, None], (1, len(self.time))), -(stiffness * slope).T])
        self.measured = self.command[EVERY - 1 :: EVERY]

    def gauss_newton(self, times: Times) -> Array:
        """Derivatives (rows, count) of all positions, after a Gauss-Newton step."""
        from armid import kernel

        servos, tree, bodies = (
            self.model.joints(self.parameters, STEP),
            self.model.robot.tree,
            self.parameters.inertial,
        )
        began = time.process_time()
        q, dq, _ = kernel.roll_out(
            tree, bodies, servos, self.command[None], None, self.command[:1], np.zeros((1, self.n))
        )
        moved = time.process_time()
        slopes = kernel.roll_out_sensitivities(
            tree, bodies, servos, self.wanted, self.command, None, self.inputs, q[0], dq[0], EVERY
        ).reshape(-1, self.count)
        differentiated = time.process_time()
        solve(slopes, (self.measured - q[0, EVERY::EVERY]).ravel())
        ended = time.process_time()
        times.motion.append(moved - began)
        times.derivatives.append(differentiated - moved)
        times.step.append(ended - differentiated)
        times.all.append(ended - began)
        return slopes


def solve(slopes: Array, residual: Array) -> Array:
    """A Gauss-Newton step."""
    return np.linalg.solve(slopes.T @ slopes + 1e-6 * np.eye(slopes.shape[1]), slopes.T @ residual)


class Peer:
    """The same arm in MuJoCo, with the same unknowns as changes of their values.

    Args:
        problem: The arm and its unknowns.
    """

    def __init__(self, problem: Problem) -> None:
        from armid.export.servos.mjcf_actuators import servo_mjcf

        self.problem = problem
        self.plant = mujoco.MjModel.from_xml_string(servo_mjcf(problem.model, problem.parameters).decode())
        self.plant.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.plant.opt.timestep = STEP
        self.data = mujoco.MjData(self.plant)

    def gauss_newton(self) -> Array:
        """Derivatives (rows, count) of all positions, after a Gauss-Newton step."""
        x = np.zeros((self.problem.count, 1))
        residual = self.residuals(x)
        slopes, _ = mujoco.minimize.jacobian_fd(self.residuals, x, residual, np.float64(DIFFERENCE), 0)
        solve(slopes, residual.ravel())
        return -slopes

    def residuals(self, x: Array) -> Array:
        """Position errors (rows, K) of the changes (count, K)."""
        return np.column_stack([self._roll_out(column) for column in x.T])

    def _roll_out(self, x: Array) -> Array:
        problem, plant, n = self.problem, self.plant, self.problem.n
        links, friction = len(problem.base), len(problem.base) + 2 * n
        inertial = problem.parameters.inertial.ravel().copy()
        inertial[problem.base] += x[:links]
        rotor, stiffness, offset, delay = x[friction:].reshape(4, n)
        for i, each in enumerate(inertial.reshape(n, 10)):
            self._write_body(int(plant.jnt_bodyid[i]), each)
        parameters = problem.parameters
        for name, law, value in zip(
            problem.model.terms, problem.model.laws, parameters.friction + x[links:friction], strict=True
        ):
            field = plant.dof_damping if name == "viscous" else plant.dof_frictionloss
            np.asarray(field).reshape(plant.nv, -1)[law.joint, 0] = value
        gain = parameters.stiffness + stiffness
        plant.dof_armature[:] = parameters.rotor_inertia + rotor
        plant.actuator_gainprm[:, 0] = gain
        plant.actuator_biasprm[:, 0], plant.actuator_biasprm[:, 1] = -gain * offset, -gain
        mujoco.mj_setConst(plant, self.data)
        command = problem.command
        if delay.any():
            command = np.column_stack([commands_at(problem.time - late, n)[:, i] for i, late in enumerate(delay)])
        initial = np.concatenate([[0.0], problem.command[0], np.zeros(n), np.zeros(plant.na)])[None]
        states, _ = mujoco.rollout.rollout(plant, [self.data], initial, command[None])
        return (problem.measured - states[0, EVERY - 1 :: EVERY, 1 : 1 + n]).ravel()

    def _write_body(self, body: int, inertial: Array) -> None:
        mass, h = inertial[0], inertial[1:4]
        xx, xy, yy, xz, yz, zz = inertial[4:]
        about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        centre = h / mass
        moments, axes = np.linalg.eigh(about_origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        self.plant.body_mass[body], self.plant.body_ipos[body] = mass, centre
        self.plant.body_inertia[body] = moments
        mujoco.mju_mat2Quat(self.plant.body_iquat[body], axes.ravel())


def measure() -> dict[str, float]:
    """Parts of the fastest step of armid [ms]."""
    problem, times = Problem(), Times()
    for _ in range(TIMES):
        problem.gauss_newton(times)
    return times.fastest()


def compare() -> dict[str, Any]:
    """Times of armid and of MuJoCo [ms], and how far their derivatives are apart."""
    problem, times = Problem(), Times()
    slopes = problem.gauss_newton(times)
    peer = Peer(problem)
    began = time.process_time()
    differences = peer.gauss_newton()
    theirs = 1e3 * (time.process_time() - began)
    for _ in range(TIMES):
        problem.gauss_newton(times)
    ours = times.fastest()
    apart = np.linalg.norm(slopes - differences, axis=0) / np.linalg.norm(slopes, axis=0)
    return {
        "unknowns": problem.count,
        "armid_ms": ours,
        "finite_differences_ms": theirs,
        "ratio": theirs / ours["all"],
        "derivatives_apart": float(np.median(apart)),
    }


def report(found: dict[str, Any]) -> str:
    """The figures as text."""
    lines = [f"30 s at 1 kHz, six joints, {found['unknowns']} unknowns; CPU time, one thread"]
    for name in ("before", "armid"):
        if f"{name}_ms" in found:
            part = found[f"{name}_ms"]
            lines.append(
                f"{name:<8} motion {part['motion']:6.1f} ms  derivatives {part['derivatives']:6.1f} ms  "
                f"step {part['step']:5.1f} ms  all {part['all']:6.1f} ms"
            )
    lines.append(
        f"MuJoCo   finite differences and step {found['finite_differences_ms'] / 1e3:.2f} s: {found['ratio']:.0f} "
        f"times as long; median difference of the derivatives {found['derivatives_apart']:.1e}"
    )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure all in one run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--beside", metavar="EXTENSION", help="measure this build of the kernel, too")
    parser.add_argument("--only", metavar="EXTENSION", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only:
        sys.meta_path.insert(0, OtherExtension(options.only))
        sys.stdout.write(json.dumps(measure()) + "\n")
        return 0
    found = {}
    if options.beside:
        command = [sys.executable, __file__, "--only", options.beside]
        found["before_ms"] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    found |= compare()
    sys.stdout.write(json.dumps(found) + "\n" if options.json else report(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

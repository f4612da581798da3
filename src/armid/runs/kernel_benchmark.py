"""Benchmarks of the compiled kernel: CPU time on one thread, relative to Pinocchio and to NumPy's lstsq.

As a program it runs in a separate process with a single BLAS thread, and prints one JSON object.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import ArmidError, MissingExtraError
from armid.estimation.estimators.ols import OrdinaryLeastSquares
from armid.estimation.problem import build_problem
from armid.excitation.design.objective import CriterionGoal, Objective, along
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.thesis_plans import builtin_plan
from armid.information.base_regressor_layout import column_source
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.output.worker_process import follow_parent
from armid.robot import load_robot
from armid.study.progress import Progress
from armid.threads import ONE_THREAD

SECONDS = 27.0
TILE = 256
TORQUE_NOISE = 0.3
ROUNDS = 5
DESIGN_SAMPLES = 2000


def run_benchmarks(samples: int, *, progress: Progress | None = None) -> dict[str, Any]:
    """Runs the benchmarks in a separate process, and returns its JSON object.

    Raises:
        ArmidError: The process failed.
    """
    if progress is not None:
        progress("measuring", 0.0)
    command = [sys.executable, "-m", "armid.runs.kernel_benchmark", str(samples)]
    done = subprocess.run(command, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ArmidError(
            f"The benchmark failed: {done.stderr.strip().splitlines()[-1:]}",
            remedy="run python -m armid.runs.kernel_benchmark to see the complete error message.",
        )
    return json.loads(done.stdout)


def measure(samples: int) -> dict[str, Any]:
    """Runs every benchmark in this process."""
    robot = load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    base = find_base_parameters(model)
    motion = builtin_plan("thesis-a1").stretched(SECONDS).sample(samples / SECONDS)
    torque = model.torque(motion, thesis_truth(model))
    torque = torque + np.random.default_rng(1).normal(0.0, TORQUE_NOISE, torque.shape)
    results = [_regressor(model, base, motion), *_least_squares(model, base, motion, torque)]
    results.append(_design_gradient(model, base))
    return {"isa": kernel.in_use(), "threads": 1, "samples": motion.samples, "results": results}


def _result(
    name: str, peer: str, armid: Callable[[], object], other: Callable[[], object], rounds: int
) -> dict[str, Any]:
    """Median CPU times [s] of armid and of another program for the same task, and their ratio.

    The two run alternately, so that other load of the machine affects both equally. A program that takes seconds runs
    fewer times than armid, because times of milliseconds are disturbed more easily.

    Args:
        name: Name of the benchmark.
        peer: Name of the other program.
        armid: Function that runs the task with armid.
        other: Function that runs the task with the other program.
        rounds: Number of runs of the other program.
    """
    mine: list[float] = []
    theirs: list[float] = []
    armid()
    for _ in range(rounds):
        for run, times, many in ((armid, mine, max(1, ROUNDS // rounds)), (other, theirs, 1)):
            for _ in range(many):
                began = time.process_time()
                run()
                times.append(time.process_time() - began)
    a, b = statistics.median(mine), statistics.median(theirs)
    return {"name": name, "peer": peer, "armid_seconds": a, "peer_seconds": b, "ratio": b / a}


def _module() -> Any:
    """Imports the module pinocchio and returns it.

    Raises:
        MissingExtraError: The module is not installed.
    """
    try:
        return import_module("pinocchio")
    except ImportError as error:
        raise MissingExtraError("pin", "The comparison with Pinocchio", "witness") from error


def _pinocchio(model: DynamicsModel) -> tuple[Any, Any]:
    """Model of the arm and its data structure in Pinocchio."""
    pin = _module()
    arm: Any = pin.Model()
    for i, joint in enumerate(model.robot.joints):
        placement = pin.SE3(joint.placement[:3, :3].copy(), joint.placement[:3, 3].copy())
        arm.addJoint(i, pin.JointModelRZ(), placement, joint.name)
    arm.gravity.linear = model.robot.gravity
    return arm, arm.createData()


def _regressor(model: DynamicsModel, base: BaseParameters, motion: Motion) -> dict[str, Any]:
    """Times of the base regressor: in tiles that fit the processor cache, and by a loop of Pinocchio calls."""
    pin = _module()
    source = column_source(model, base)
    part = motion[slice(0, TILE)]
    torque, terms = np.zeros((TILE, model.n)), source.term_rows(part)
    out = np.empty((source.layout.columns, TILE))
    repeats = 100
    arm, data = _pinocchio(model)

    def armid() -> None:
        for _ in range(repeats):
            kernel.columns(source.tree, source.layout, part.q, part.dq, part.ddq, torque, terms, out=out)

    def loop() -> None:
        for _ in range(repeats):
            for k in range(TILE):
                pin.computeJointTorqueRegressor(arm, data, part.q[k], part.dq[k], part.ddq[k])

    return _result("regressor", "pinocchio, Python loop", armid, loop, ROUNDS)


def _least_squares(model: DynamicsModel, base: BaseParameters, motion: Motion, torque: Array) -> list[dict[str, Any]]:
    """Times of least squares: armid and NumPy without a filter, and armid with and without a filter."""
    pin = _module()
    arm, data = _pinocchio(model)
    rate = (motion.samples - 1) / float(motion.time[-1] - motion.time[0])

    def observations(step: int, band: Band) -> Observations:
        rows = np.arange(0, motion.samples, step)
        block = (motion.time[rows] - motion.time[0]).astype(np.int64)
        mask = np.ones((len(rows), model.n), dtype=bool)
        return Observations((ObservedRun(motion, torque, rate, step, 0, mask, block),), band)

    raw = observations(1, Band())
    step = max(1, round(rate / 25.0))
    smooth = observations(step, Band("butterworth", 5.0, 4, "periodic"))

    def armid() -> Array:
        return OrdinaryLeastSquares().solve(build_problem(model, raw, base=base)).deviation

    def filtered() -> Array:
        return OrdinaryLeastSquares().solve(build_problem(model, smooth, base=base)).deviation

    inertial = np.isin(base.kept, model.inertial_columns)
    standard = np.searchsorted(model.inertial_columns, base.kept[inertial])

    def peer() -> Array:
        rows = np.zeros((motion.samples, model.n, base.count))
        for k in range(motion.samples):
            regressor = pin.computeJointTorqueRegressor(arm, data, motion.q[k], motion.dq[k], motion.ddq[k])
            rows[k][:, inertial] = regressor[:, standard]
        friction = np.flatnonzero(~inertial)
        for j in range(model.n):
            rows[:, j, friction[2 * j]] = motion.dq[:, j]
            rows[:, j, friction[2 * j + 1]] = np.sign(motion.dq[:, j])
        stacked = rows.reshape(-1, base.count)
        y = torque.reshape(-1)
        squares = np.linalg.lstsq(stacked, y, rcond=None)[1]
        variance = squares[0] / (len(y) - base.count)
        return np.sqrt(variance * np.diag(np.linalg.inv(stacked.T @ stacked)))

    agreement = float(np.abs(armid() / peer() - 1.0).max())
    rows = [_result("least-squares", "pinocchio loop + numpy lstsq", armid, peer, 1)]
    rows[0]["agreement"] = agreement
    rows.append(_result("filtered-least-squares", "armid without filter", filtered, armid, ROUNDS))
    return rows


def _design_gradient(model: DynamicsModel, base: BaseParameters) -> dict[str, Any]:
    """Times of armid and of Pinocchio for value and gradient of the condition number along Table A.1 of the thesis.

    For Pinocchio, the time of one value is multiplied by 141, because a gradient by forward differences needs one
    value, and one more for each of the 140 coefficients.
    """
    pin = _module()
    arm, data = _pinocchio(model)
    plan = builtin_plan("thesis-a1")
    goal = CriterionGoal(model, base, "condition")
    basis = SeriesBasis(plan.base_frequency, plan.harmonics, np.zeros(model.n))
    objective = Objective(goal, basis, DESIGN_SAMPLES, width=0.05, sharpness=60.0)
    x = basis.unknowns_of(plan)
    motion = basis.excitation(x).sample(DESIGN_SAMPLES / plan.period)
    inertial = np.isin(base.kept, model.inertial_columns)
    standard = np.searchsorted(model.inertial_columns, base.kept[inertial])
    friction = np.flatnonzero(~inertial)

    def peer() -> float:
        rows = np.zeros((motion.samples, model.n, base.count))
        for k in range(motion.samples):
            regressor = pin.computeJointTorqueRegressor(arm, data, motion.q[k], motion.dq[k], motion.ddq[k])
            rows[k][:, inertial] = regressor[:, standard]
        for j in range(model.n):
            rows[:, j, friction[2 * j]] = motion.dq[:, j]
            rows[:, j, friction[2 * j + 1]] = np.sign(motion.dq[:, j])
        return float(np.linalg.cond(rows.reshape(-1, base.count)))

    row = _result("design-gradient", "pinocchio loop + numpy cond, 141 values", lambda: objective(x), peer, ROUNDS)
    values = 1 + plan.a.size + plan.b.size
    row["agreement"] = abs(float(np.exp(goal.value(along(goal, motion)))) / peer() - 1.0)
    return row | {"peer_seconds": values * row["peer_seconds"], "ratio": values * row["ratio"]}


if __name__ == "__main__":
    follow_parent(os.getppid())
    sys.stdout.write(json.dumps(measure(int(sys.argv[1]))) + "\n")

"""CPU time and memory of the processing of long recordings, beside the factors and the covariance that it feeds.

`python benchmarks/processing.py [--samples N …] [--peer N] [--json]`. An iiwa 14 at 8 kHz on a motion of several
frequencies, in memory, positions and torque with noise, the default processing. Each size is measured in a
process of its own, so that its peak of memory is its own: CPU time, user and system, and the peak of resident memory
after each stage. The peer makes the same estimate from a shorter piece with SciPy, Pinocchio and
`numpy.linalg.lstsq`: filters forwards and backwards, differences, the regressor sample by sample, a filter and
decimation of all its columns, and one least-squares problem.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np

SIZES = (200_000, 1_000_000, 4_000_000)
RATE = 8000.0
POSITION_NOISE, TORQUE_NOISE = 1e-5, 0.3
"""Standard deviations of the noise of positions [rad] and torques [N·m]."""

CUTOFF, ORDER, ROWS = 5.0, 4, 25.0
"""Filter and rate of the rows of the peer: what armid uses by default [Hz]."""

CHUNK = 100_000
"""Samples that are made at a time."""


def spent() -> float:
    """CPU time of this process [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def peak() -> float:
    """Peak of resident memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def parts(samples: int, rate: float, length: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield times, positions and torques of the arm with noise, `length` samples at a time."""
    from armid.lab.inverse_dynamics_recording import thesis_truth
    from armid.model.motion import Motion

    model, _ = arm()
    truth, rng = thesis_truth(model), np.random.default_rng(1)
    joint, wave = np.arange(model.n), np.arange(1, 6)[:, None]
    frequency = 2.0 * np.pi * (0.1 * wave + 0.013 * joint + 0.0071 * wave * joint)  # no common period
    size, phase = 0.5 * rng.normal(size=frequency.shape) / wave, rng.uniform(0.0, 6.0, frequency.shape)
    for a in range(0, samples, length):
        t = np.arange(a, min(a + length, samples)) / rate
        states = np.zeros((3, len(t), model.n))
        for w, s, p in zip(frequency, size, phase, strict=True):
            angle = w * t[:, None] + p
            states += np.stack([s * np.sin(angle), s * w * np.cos(angle), -s * w**2 * np.sin(angle)])
        q = states[0] + POSITION_NOISE * rng.standard_normal((len(t), model.n))
        tau = model.torque(Motion(t, *states), truth)
        yield t, q, tau + TORQUE_NOISE * rng.standard_normal((len(t), model.n))


def recorded(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques of the arm, shape (samples, 7) each."""
    q, tau = np.empty((2, samples, arm()[0].n))
    done = 0
    for t, positions, torques in parts(samples, RATE, CHUNK):
        q[done : done + len(t)], tau[done : done + len(t)] = positions, torques
        done += len(t)
    return q, tau


def arm() -> tuple[Any, Any]:
    """The iiwa 14 with friction, and its base parameters."""
    from armid.model.base_parameters import find_base_parameters
    from armid.model.dynamics_model import DynamicsModel
    from armid.model.terms import Coulomb, RigidBody, Viscous
    from armid.robot import load_robot

    model = DynamicsModel(load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81)), (RigidBody(), Viscous(), Coulomb()))
    return model, find_base_parameters(model)


def stages(samples: int) -> dict[str, Any]:
    """CPU time [s], wall time [s] and peak of memory [MB] of each stage."""
    from armid.checked_array import frozen
    from armid.estimation.estimators import OrdinaryLeastSquares
    from armid.estimation.problem import EstimationProblem
    from armid.estimation.uncertainty.covariance import estimate_covariance
    from armid.information.accumulate import accumulate_information
    from armid.measurement.processing.pipeline import process_recordings
    from armid.measurement.recording import Recording

    model, base = arm()
    q, tau = recorded(samples)
    recording = Recording(None, frozen(q), effort=frozen(tau), rate=RATE, consecutive=True)  # without copies
    del q, tau
    marks = [(spent(), time.perf_counter())]
    memory = [peak()]

    def mark() -> None:
        marks.append((spent(), time.perf_counter()))
        memory.append(peak())

    observations, _ = process_recordings([recording])
    mark()
    information = accumulate_information(model, base, observations)
    mark()
    problem = EstimationProblem(information, None, model, base, observations)
    fit = OrdinaryLeastSquares().solve(problem)
    estimate_covariance(fit, problem)
    mark()
    cpu, wall = np.diff(np.array(marks), axis=0).T.tolist()
    motions = [run.motion for run in observations.runs]
    kept = sum(x.nbytes for motion in motions for x in (motion.time, motion.q, motion.dq, motion.ddq))
    names = ("process", "factors", "covariance")
    return {
        "samples": samples,
        "input_mb": recording.q.nbytes * 2 / 2**20,
        "kept_mb": kept / 2**20,
        "before_mb": memory[0],
        "cpu": dict(zip(names, cpu, strict=True)),
        "wall": dict(zip(names, wall, strict=True)),
        "peak_mb": dict(zip(names, memory[1:], strict=True)),
        "ratio": cpu[0] / cpu[1],
        "load": os.getloadavg()[0],
    }


def peer(samples: int) -> dict[str, Any]:
    """CPU time [s] of armid and of the peer from a recording to base parameters, and the peer's memory [MB]."""
    from scipy.signal import butter, sosfiltfilt

    from armid.estimation.estimators import OrdinaryLeastSquares
    from armid.estimation.problem import EstimationProblem
    from armid.information.accumulate import accumulate_information
    from armid.measurement.processing.pipeline import process_recordings
    from armid.measurement.recording import Recording

    pin: Any = import_module("pinocchio")
    model, base = arm()
    q, tau = recorded(samples)
    begin = spent()
    observations, _ = process_recordings([Recording(None, q, effort=tau, rate=RATE, consecutive=True)])
    information = accumulate_information(model, base, observations)
    OrdinaryLeastSquares().solve(EstimationProblem(information))
    mine = spent() - begin
    robot = pin.Model()
    for i, each in enumerate(model.robot.joints):
        placement = pin.SE3(each.placement[:3, :3].copy(), each.placement[:3, 3].copy())
        robot.addJoint(i, pin.JointModelRZ(), placement, each.name)
    data = robot.createData()
    before = peak()
    begin = spent()
    sections = butter(ORDER, CUTOFF, fs=RATE, output="sos")
    n, positions = model.n, sosfiltfilt(sections, q, axis=0)
    dq = np.gradient(positions, 1.0 / RATE, axis=0)
    ddq = np.gradient(dq, 1.0 / RATE, axis=0)
    Y = np.zeros((samples, n, 12 * n))
    for s in range(samples):
        Y[s, :, : 10 * n] = pin.computeJointTorqueRegressor(robot, data, positions[s], dq[s], ddq[s])
    joint = np.arange(n)
    Y[:, joint, 10 * n + joint], Y[:, joint, 11 * n + joint] = dq, np.sign(dq)
    step, edge = round(RATE / ROWS), round(0.5 * RATE)
    rows = slice(edge, samples - edge, step)
    filtered = np.stack([sosfiltfilt(sections, Y[:, j], axis=0)[rows] for j in range(n)], axis=1)
    torque = sosfiltfilt(sections, tau, axis=0)[rows]
    np.linalg.lstsq(filtered.reshape(-1, 12 * n), torque.ravel())
    return {"samples": samples, "armid": mine, "peer": spent() - begin, "peer_mb": peak() - before}


def in_a_process(*arguments: str) -> dict[str, Any]:
    """Result of this program in a process of its own, with one thread in each library."""
    one = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")}
    command = [sys.executable, __file__, *arguments]
    done = subprocess.run(command, env={**os.environ, **one}, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=SIZES)
    parser.add_argument("--peer", type=int, default=50_000, metavar="N", help="samples for the peer; 0 leaves it out")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--stages", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--beside", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.stages or given.beside:
        print(json.dumps(stages(given.stages) if given.stages else peer(given.beside)))
        return
    rows = [in_a_process("--stages", str(samples)) for samples in given.samples]
    other = in_a_process("--beside", str(given.peer)) if given.peer else None
    if given.json:
        print(json.dumps({"stages": rows, "peer": other}))
        return
    print(
        f"{'samples':>10}{'process':>10}{'factors':>10}{'covar.':>9}{'process/factors':>17}{'peak MB: before':>17}",
        end="",
    )
    print(f"{'process':>9}{'factors':>9}{'covar.':>8}{'input':>7}{'kept':>6}{'load':>6}")
    for row in rows:
        cpu, memory = row["cpu"], row["peak_mb"]
        print(f"{row['samples']:10d}{cpu['process']:10.3f}{cpu['factors']:10.3f}{cpu['covariance']:9.2f}", end="")
        print(f"{row['ratio']:17.2f}{row['before_mb']:17.0f}{memory['process']:9.0f}{memory['factors']:9.0f}", end="")
        print(f"{memory['covariance']:8.0f}{row['input_mb']:7.0f}{row['kept_mb']:6.0f}{row['load']:6.1f}")
    if other:
        print(f"{other['samples']} samples to base parameters, CPU s: armid {other['armid']:.3f}, ", end="")
        print(f"SciPy + Pinocchio + lstsq {other['peer']:.2f} and {other['peer_mb']:.0f} MB, ", end="")
        print(f"x {other['peer'] / other['armid']:.1f}")


if __name__ == "__main__":
    main()

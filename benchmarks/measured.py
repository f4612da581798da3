"""Measurements of `armid bench`, and beside it Pinocchio in C++, growth with the number of samples, and memory.

Every benchmark is a function that returns one or more records; armid and its peer run in turn and medians are
compared, so that whatever else the machine does meets both alike. `run.py` starts this file with the BLAS held to one
thread.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import resource
import statistics
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from armid import kernel
from armid.estimation.estimators import OrdinaryLeastSquares, PhysicallyConsistent
from armid.estimation.problem import EstimationProblem, standard_of
from armid.excitation.thesis_plans import builtin_plan
from armid.information.accumulate import accumulate_information
from armid.information.base_regressor_layout import column_source
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from armid.runs.kernel_benchmark import measure
from modelled import modelled_fit
from peers import PeerMissingError, build_loop, run_loop

Record = dict[str, Any]

SECONDS = 27.0
TILE = 256
"""Samples that stay in cache, inputs and columns together 0.5 MB."""

FEW = 64
"""Samples of the dense form that stay in cache: 0.25 MB."""

ROUNDS = 7
MARGINAL = "nanoseconds_a_further_sample"
CONSISTENT: tuple[tuple[Literal["mass", "euclidean", "log-det"], str], ...] = (
    ("mass", "CLARABEL"),
    ("mass", "SCS"),
    ("euclidean", "CLARABEL"),
    ("log-det", "CLARABEL"),
)
"""Priors, and what a user of cvxpy would solve them with."""

SIZES = (2_000, 20_000, 216_000, 2_000_000)


class Arm:
    """The iiwa 14, hanging, with friction, and its recordings along Table A.1 of the thesis in 27 s."""

    def __init__(self) -> None:
        robot = load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))
        self.model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
        self.base: BaseParameters = find_base_parameters(self.model)

    def recorded(self, samples: int) -> Observations:
        """So many samples with noise, blocks of a second, nothing filtered."""
        motion = builtin_plan("thesis-a1").stretched(SECONDS).sample(samples / SECONDS)
        torque = self.model.torque(motion, thesis_truth(self.model))
        torque += 0.3 * np.random.default_rng(1).standard_normal(torque.shape)
        mask = np.ones(torque.shape, dtype=bool)
        run = ObservedRun(motion, torque, samples / SECONDS, 1, 0, mask, motion.time.astype(np.int64))
        return Observations((run,), Band())

    def deviations(self, observations: Observations) -> object:
        """Least squares with standard deviations."""
        return (
            OrdinaryLeastSquares()
            .solve(EstimationProblem(accumulate_information(self.model, self.base, observations)))
            .deviation
        )


def cpu(work: Callable[[], object]) -> float:
    """CPU time of a call [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def record(name: str, peer: str, armid: float, other: float, **more: object) -> Record:
    """Return the record of every benchmark; a ratio above one means that armid is faster."""
    return {"name": name, "peer": peer, "armid_seconds": armid, "peer_seconds": other, "ratio": other / armid, **more}


def regressor_against_cpp(arm: Arm, build: Path) -> list[Record]:
    """A tile in cache, seconds a sample: the base columns that estimation streams, and all 7 x 70 entries."""
    program = build_loop(build)
    source, tree = column_source(arm.model, arm.base), arm.model.tree
    part = builtin_plan("thesis-a1").stretched(SECONDS).sample(100.0)[slice(0, TILE)]
    state = (part.q, part.dq, part.ddq)
    torque, terms = np.zeros((TILE, tree.n)), source.term_rows(part)
    columns, dense = np.empty((source.layout.columns, TILE)), np.empty((FEW, tree.n, 10 * tree.n))
    repeats = 200
    base: list[float] = []
    full: list[float] = []
    loop: list[float] = []
    _, last = run_loop(program, tree, state, 1)
    error = float(np.abs(last - kernel.regressor(tree, *state)[-1]).max() / np.abs(last).max())
    for _ in range(ROUNDS):
        times, _ = run_loop(program, tree, state, repeats)
        loop.append(float(np.median(times)) / TILE)

        def stream() -> None:
            for _ in range(repeats):
                kernel.columns(tree, source.layout, *state, torque, terms, out=columns)

        def fill() -> None:
            for _ in range(repeats):
                kernel.regressor(tree, *(x[:FEW] for x in state), out=dense)

        base.append(cpu(stream) / repeats / TILE)
        full.append(cpu(fill) / repeats / FEW)
    peer = statistics.median(loop)
    return [
        record("regressor, base columns", "pinocchio, C++ loop", statistics.median(base), peer, disagreement=error),
        record("regressor, 7 x 70", "pinocchio, C++ loop", statistics.median(full), peer, disagreement=error),
    ]


def physical(arm: Arm) -> list[Record]:
    """Real bodies from factors: armid's whole estimate with intervals beside the bare program in cvxpy."""
    if find_spec("cvxpy") is None:
        print("cvxpy is left out: pip install cvxpy.", file=sys.stderr)
        return []
    information = accumulate_information(arm.model, arm.base, arm.recorded(20_000))
    problem = EstimationProblem(information, standard_of(arm.model, arm.base), arm.model, arm.base)
    rows: list[Record] = []
    for prior, solver in CONSISTENT:
        method = PhysicallyConsistent(prior=prior, weight=1.0)
        standard = method.solve(problem).standard
        assert standard is not None
        other = arm.base.regrouping @ (modelled_fit(problem, prior, solver) - standard.values)
        deviation = OrdinaryLeastSquares().solve(problem).deviation
        mine: list[float] = []
        theirs: list[float] = []
        for _ in range(ROUNDS):
            mine.append(cpu(lambda method=method: method.solve(problem)))
            theirs.append(cpu(lambda prior=prior, solver=solver: modelled_fit(problem, prior, solver)))
        differs = float(np.abs(other / deviation).max())
        peer = f"cvxpy with {solver}"
        medians = statistics.median(mine), statistics.median(theirs)
        rows.append(record(f"physical, prior {prior}", peer, *medians, disagreement=differs))
    return rows


def linearity(arm: Arm) -> list[Record]:
    """Least squares of each size against its share of the largest, and what each further sample costs.

    Small sizes pay for the estimate itself, which no sample count changes; below some 20 000 samples the factors
    come from a QR throughout.
    """
    recorded = {size: arm.recorded(size) for size in SIZES}
    arm.deviations(recorded[SIZES[0]])
    times: dict[int, list[float]] = {size: [] for size in SIZES}
    for _ in range(ROUNDS):
        for size in SIZES:
            times[size].append(cpu(lambda size=size: arm.deviations(recorded[size])))
    seconds = {size: statistics.median(times[size]) for size in SIZES}
    whole = seconds[SIZES[-1]] / SIZES[-1]
    rows: list[Record] = []
    for size, smaller in zip(SIZES, (0, *SIZES[:-1]), strict=True):
        further = (seconds[size] - seconds.get(smaller, 0.0)) / (size - smaller)
        row = record(f"least squares, {size} samples", "as many of the largest", seconds[size], whole * size)
        rows.append(row | {MARGINAL: 1e9 * further})
    return rows


def memory(arm: Arm, samples: int) -> Record:
    """Growth of the peak of resident memory over the inputs [MB], in a fork, whose peak starts anew."""
    observations = arm.recorded(samples)
    run = observations.runs[0]
    part = replace(
        run, motion=run.motion[slice(0, 100)], torque=run.torque[:100], mask=run.mask[:100], block=np.zeros(100)
    )
    few = Observations((part,), Band())
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        libc.malloc_trim(0)
    here, there = os.pipe()
    child = os.fork()
    if child == 0:
        accumulate_information(arm.model, arm.base, few)  # brings the libraries' pages back
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        accumulate_information(arm.model, arm.base, observations)
        growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        os.write(there, struct.pack("d", growth / 1024.0))
        os._exit(0)
    os.waitpid(child, 0)
    (growth,) = struct.unpack("d", os.read(here, 8))
    dense = samples * arm.model.n * arm.base.count * 8 / 2**20
    inputs = samples * arm.model.n * 4 * 8 / 2**20
    return {
        "name": f"memory, {samples} samples",
        "peer": "the stacked regressor",
        "inputs_mb": inputs,
        "armid_mb": growth,
        "peer_mb": dense,
        "ratio": dense / max(growth, 0.1),
    }


def processor() -> str:
    """Name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine()
    )


def run_all(samples: int, build: Path) -> Record:
    """Every benchmark."""
    arm = Arm()
    before = os.getloadavg()[0]
    memory_record = memory(arm, samples)  # first, while this process is small
    results: list[Record] = measure(samples)["results"]
    try:
        results += regressor_against_cpp(arm, build)
    except PeerMissingError as reason:
        print(f"Pinocchio's C++ loop is left out. {reason}", file=sys.stderr)
    results += [*physical(arm), *linearity(arm), memory_record]
    return {
        "isa": kernel.in_use(),
        "processor": processor(),
        "threads": 1,
        "samples": samples,
        "load": [before, os.getloadavg()[0]],
        "results": results,
    }


if __name__ == "__main__":
    print(json.dumps(run_all(int(sys.argv[1]), Path(sys.argv[2]))))

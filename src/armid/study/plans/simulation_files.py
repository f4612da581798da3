"""Simulation of an arm, and files with the simulated recording and with the true parameters of the arm."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armid.errors import OutputError, did_you_mean
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import LabOptions
from armid.lab.simulated_motion import TrueMotion
from armid.lab.simulation import Simulated, simulate, truth_record
from armid.measurement.writing import WRITERS, recording_bytes
from armid.output.file_group import replace_files
from armid.robot.robot import Robot
from armid.study.plans.plan_reading import series_of
from armid.study.storage.records import to_json

RECORDING, TRUTH, NOISE_FREE = "recording", "truth.json", "noise-free.npz"
"""Names of the files of a simulation, the first without its suffix."""


@dataclass(frozen=True, eq=False, slots=True)
class WrittenSimulation:
    """Files of a simulation.

    Attributes:
        simulated: Result of the simulation.
        recording: Path of the simulated recording.
        truth: Path of the JSON file with the true parameters and the options.
        noise_free: Path of the NPZ file with motion and torque without noise; `None` if the file was not requested.
    """

    simulated: Simulated
    recording: Path
    truth: Path
    noise_free: Path | None


def the_plan(name: str, period: float | None = None) -> Excitation:
    """Excitation of a built-in plan or a plan of `armid excite`, slowed down or sped up to `period` [s] if given."""
    plan = series_of(name)
    return plan if period is None else plan.stretched(period)


def refuse_format(name: str) -> str:
    """Checks that a format of recordings can be written, and returns its suffix.

    Raises:
        OutputError: The format cannot be written.
    """
    suffix = "." + name.lstrip(".")
    if suffix not in WRITERS:
        raise OutputError(
            f"Recordings cannot be written in the format {name!r}.",
            possible=", ".join(s[1:] for s in WRITERS),
            remedy=did_you_mean(suffix[1:], (s[1:] for s in WRITERS)),
        )
    return suffix


def simulate_to(
    folder: Path | str,
    robot: Robot,
    plan: Excitation,
    options: LabOptions,
    *,
    kind: str = "csv",
    seed: int = 1,
    noise_free: bool = False,
    tell: Callable[[float], None] | None = None,
) -> WrittenSimulation:
    """Simulates an arm and writes `recording.*`, `truth.json` and, if requested, `noise-free.npz` into a folder.

    The files of an earlier simulation in this folder are replaced, all of them or none.

    Args:
        folder: Output folder; files that are not of a simulation are not changed.
        robot: The arm.
        plan: The motion along which the arm is moved.
        options: Options of the simulation.
        kind: Format of the recording, the suffix of its file without the dot.
        seed: Seed of noise and faults.
        noise_free: True if motion and torque without noise are written, too.
        tell: Function that is called with the share of the simulation that is done.
    """
    suffix = refuse_format(kind)
    done = simulate(truth_of(robot), plan, options, seed=seed, tell=tell)
    recording = recording_bytes(done.recording, suffix)
    truth = to_json(truth_record(done, hashlib.sha256(recording).hexdigest())) + "\n"
    files: dict[str, bytes | str] = {f"{RECORDING}{suffix}": recording, TRUTH: truth}
    if noise_free:
        files[NOISE_FREE] = _archive(done.trace.from_time(0.0), options.sensing.rate)
    stale = (NOISE_FREE, *(f"{RECORDING}{each}" for each in WRITERS))
    path, truth_path, *exact = replace_files(folder, files, stale=stale)
    return WrittenSimulation(done, path, truth_path, exact[0] if exact else None)


def _archive(trace: TrueMotion, rate: float) -> bytes:
    """Content of an NPZ file with the true motion, sampled at a rate [Hz] without jitter of the clock."""
    every = round(1.0 / (rate * (trace.time[1] - trace.time[0])))
    names = {name: getattr(trace, name) for name in trace.__slots__}
    buffer = io.BytesIO()
    np.savez(buffer, **{name: x[::every] for name, x in names.items() if x is not None})
    return buffer.getvalue()

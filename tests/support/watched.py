"""A run of the small arm, recordings without contact, and pushes, for the tests of the monitor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from armid.lab.known_arms import KnownArm
from armid.lab.options import LabOptions
from armid.lab.pushes import Push
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.recording import Recording
from armid.runs.run import Run, load_run, save_run
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from labs import write_arm, write_recording
from plants import short_plan, small_arm

RATE = 250.0

SENSORS = Sensing(RATE, SensorChannel(noise=1e-6), SensorChannel(noise=0.05))

TERMS = ("rigid-body", "viscous", "coulomb")


def moved(
    seed: int, repetitions: int, *pushes: Push, truth: KnownArm | None = None, sensing: Sensing = SENSORS
) -> Recording:
    """Recording of the small arm along a random motion of 8 s, repeated."""
    options = LabOptions(mode="inverse-dynamics", repetitions=repetitions, sensing=sensing, pushes=pushes)
    found = simulate(truth or small_arm(), short_plan(seed, 8.0), options, seed=seed).recording
    return replace(found, sha256=f"{seed}")


def small_run(folder: Path, *terms: str, recording: Recording | None = None) -> Run:
    """The small arm, identified on one recording."""
    path = write_recording(recording or moved(1, 4), folder / "free.npz")
    shapes = {"coulomb": {"width": 0.0}} if "coulomb" in (terms or TERMS) else {}
    study = Study(
        RobotChoice(str(write_arm(folder))), ModelChoice(terms or TERMS, shapes), (RecordingChoice(str(path)),)
    )
    return load_run(save_run(identify(study), folder / "run"))

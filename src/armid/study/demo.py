"""Demo: identification of a simulated, hanging iiwa with the motions of the thesis."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.inverse_dynamics_recording import Sensors, record, thesis_truth
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import THESIS, ProcessingOptions
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.robot import load_robot
from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice, Study, build_model
from armid.study.identify import Result, conclude
from armid.study.prepare import prepare
from armid.study.progress import Progress
from armid.study.recordings.processed import ProcessedRecording

HANGING = (0.0, 0.0, 9.81)
SECONDS = 27.0
REPETITIONS = 5
TRAIN, UNSEEN = "virtual A.1", "virtual A.2"
MOTIONS = {TRAIN: "thesis-a1", UNSEEN: "thesis-a2"}
SEED = 1
RECORD = "demo.json"
"""Name of the file in the run of a demo that contains the seed of its recordings."""


@dataclass(frozen=True, eq=False, slots=True)
class Demo:
    """Result of the demo, compared with the true parameters.

    Attributes:
        result: The identification.
        truth: True base parameters, shape (b,).
        relative_error: Norm of the error of the parameters, divided by the norm of the true parameters.
        torque_error: RMS, over all samples and joints, of predicted minus true torque on the motion of Table A.2 of
            the thesis [N·m].
        recordings: Recordings of the simulated arm, processed.
    """

    result: Result
    truth: Array
    relative_error: float
    torque_error: float
    recordings: tuple[ProcessedRecording, ...]


def demo_study(processing: ProcessingOptions | None = None, method: str = "wls") -> Study:
    """Study of the demo; the option `edges` is periodic, because the motion repeats without a pause."""
    return Study(
        RobotChoice("iiwa14-r820", gravity=HANGING),
        ModelChoice(("rigid-body", "viscous", "coulomb"), {"coulomb": {"width": 0.0}}),
        (
            RecordingChoice(TRAIN, reading=LogFormat(period=SECONDS, start=0.0)),
            RecordingChoice(UNSEEN, "validate", LogFormat(period=SECONDS, start=0.0)),
        ),
        processing or ProcessingOptions(edges="periodic", average=True),
        EstimationChoice(method),
    )


def thesis_processing(edges: str = "periodic") -> ProcessingOptions:
    """Processing options of the thesis, except that the option `edges` has the given value."""
    return replace(THESIS, edges=edges, average=edges == "periodic")  # pyright: ignore[reportArgumentType]


def run_demo(
    study: Study | None = None, *, seed: int = SEED, threads: int = 1, progress: Progress | None = None
) -> Demo:
    """Simulates recordings, identifies and validates the model, and compares it with the true parameters.

    Args:
        study: Study to use; `demo_study()` if not given.
        seed: Seed of the noise.
        threads: Number of threads of the compiled kernel.
        progress: Function that is called with the name of each stage and the share of the stage that is done.
    """
    study = study or demo_study()
    if progress is not None:
        progress("virtual lab", 0.0)
    robot = load_robot(study.robot.description, gravity=study.robot.gravity)
    model: DynamicsModel = build_model(robot, study.model)
    truth = thesis_truth(model)
    recordings, motion, torque = _record(model, truth, seed)
    prepared = prepare(study, given=recordings, threads=threads, progress=progress)
    result = conclude(prepared, progress=progress)
    base = find_base_parameters(model)
    values, true_values = result.estimate.fit.values, base.values_of(truth)
    theta = np.zeros(len(truth))
    theta[base.kept] = values
    error = model.torque(motion, theta) - torque
    return Demo(
        result,
        true_values,
        float(np.linalg.norm(values - true_values) / np.linalg.norm(true_values)),
        float(np.sqrt(np.mean(error**2))),
        prepared.recordings,
    )


def demo_recordings(folder: Path | str) -> dict[str, Recording]:
    """Simulates the recordings of a demo again, from the seed that is stored in `folder`.

    The keys of the result are the paths of the recordings in the study of the demo. The recordings are not stored,
    because their files would take a hundred megabytes.
    """
    path = Path(folder) / RECORD
    seed = json.loads(path.read_text(encoding="utf-8"))["seed"] if path.is_file() else SEED
    study = demo_study()
    model = build_model(load_robot(study.robot.description, gravity=study.robot.gravity), study.model)
    return _record(model, thesis_truth(model), seed)[0]


def _record(model: DynamicsModel, truth: Array, seed: int) -> tuple[dict[str, Recording], Motion, Array]:
    """Training and validation recording by name, and true motion and torque (N, n) of the validation recording."""
    rng = np.random.default_rng(seed)
    plans = {name: builtin_plan(plan).stretched(SECONDS) for name, plan in MOTIONS.items()}
    made = {name: record(model, truth, plan, Sensors(), rng, repetitions=REPETITIONS) for name, plan in plans.items()}
    _, motion, torque = made[UNSEEN]
    return {name: recording for name, (recording, _, _) in made.items()}, motion, torque

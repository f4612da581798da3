"""The whole job on an arm that is not there: the virtual iiwa, hanging, on the motions of the thesis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.excitation.plans import builtin_plan
from armid.lab.virtual import Sensors, record, thesis_truth
from armid.measurement.processing import THESIS, Processing
from armid.measurement.reading import Reading
from armid.measurement.recording import Recording
from armid.model.base import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.robot import load_robot
from armid.study.identify import Progress, Result, conclude, prepare
from armid.study.study import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice, Study, build_model
from armid.values import Array

__all__ = ["Demo", "demo_study", "run_demo", "thesis_processing"]

HANGING = (0.0, 0.0, 9.81)
SECONDS = 27.0
REPETITIONS = 5
TRAIN, UNSEEN = "virtual A.1", "virtual A.2"


@dataclass(frozen=True, eq=False, slots=True)
class Demo:
    """A demo's result beside the truth that only a virtual arm has.

    Attributes:
        result: The identification.
        truth: True base parameters, shape (b,).
        relative_error: Distance of the estimate from the truth over the truth's length.
        torque_error: RMS over all samples and joints of predicted less true torque on Table A.2 [N·m].
        recordings: What the virtual arm recorded, as the study reads it.
    """

    result: Result
    truth: Array
    relative_error: float
    torque_error: float
    recordings: tuple[tuple[RecordingChoice, Recording], ...]


def demo_study(processing: Processing | None = None, method: str = "wls") -> Study:
    """The study of the demo: periodic edges, since the motion repeats without a pause."""
    return Study(
        RobotChoice("iiwa14-r820", gravity=HANGING),
        ModelChoice(("rigid-body", "viscous", "coulomb"), {"coulomb": {"width": 0.0}}),
        (
            RecordingChoice(TRAIN, reading=Reading(period=SECONDS, start=0.0)),
            RecordingChoice(UNSEEN, "validate", Reading(period=SECONDS, start=0.0)),
        ),
        processing or Processing(edges="periodic", average=True),
        EstimationChoice(method),
    )


def thesis_processing(edges: str = "periodic") -> Processing:
    """The thesis's own processing, its edges treated as asked."""
    return replace(THESIS, edges=edges, average=edges == "periodic")  # pyright: ignore[reportArgumentType]


def run_demo(
    study: Study | None = None, *, seed: int = 1, threads: int = 1, progress: Progress | None = None
) -> Demo:
    """Record the virtual arm, identify it, validate it on Table A.2, and compare with the truth.

    Args:
        study: Another processing or method; by default `demo_study()`.
        seed: Of the noise.
        threads: Threads of the kernel.
        progress: Told of stages.
    """
    study = study or demo_study()
    if progress is not None:
        progress("virtual lab", 0.0)
    robot = load_robot(study.robot.description, gravity=study.robot.gravity)
    model: DynamicsModel = build_model(robot, study.model)
    truth = thesis_truth(model)
    rng = np.random.default_rng(seed)
    train, _, _ = record(
        model, truth, builtin_plan("thesis-a1").stretched(SECONDS), Sensors(), rng, repetitions=REPETITIONS
    )
    unseen, motion, torque = record(
        model, truth, builtin_plan("thesis-a2").stretched(SECONDS), Sensors(), rng, repetitions=REPETITIONS
    )
    prepared = prepare(study, given={TRAIN: train, UNSEEN: unseen}, threads=threads, progress=progress)
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

"""Construction of previews from an arm and a plan, recording or run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.collision_model import CollisionOptions
from armid.measurement.log_format import LogFormat
from armid.report.preview.animation_frames import Clip, clip_of_motion, clip_of_plan, clip_of_recording, still
from armid.report.preview.inertia_ellipsoids import MassLayer, layer_of_description
from armid.report.preview.nearest_bodies import bodies_to_watch
from armid.report.preview.page import Preview
from armid.robot.collision_from_visual import missing_bodies
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.runs.locate_recording import read_recording_of
from armid.runs.read_records import read_records, trained_and_validated
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.plans.design_result import Designed
from armid.study.plans.plan_reading import is_plan, limits_of_plan, motion_of_plan, read_whole_plan
from armid.study.plans.poses_and_sweeps import DesignedMoves
from armid.study.recordings.reading import read_choice


def preview_of(
    robot: Robot,
    motion: str | Run | Clip | None,
    *,
    reading: LogFormat | None = None,
    data: Path | str | None = None,
    surroundings: Sequence[Shape] = (),
    estimate: MassLayer | None = None,
) -> Preview:
    """Preview of an arm and a motion.

    Args:
        robot: The arm.
        motion: A plan, the folder of a plan, a recording, a clip, or a run; for a run, a validation recording is
            shown. With `None` the arm is at rest.
        reading: Log format of a recording.
        data: Folder that is searched first for a run's recordings.
        surroundings: Fixed bodies, in addition to those of a plan.
        estimate: Estimated inertias of the links, shown in addition to those of the description.

    Raises:
        ArmidError: The motion cannot be read, or it is for another arm.
    """
    around, limits = tuple(surroundings), None
    if motion is None:
        clip = still(_rest(robot), "standing")
    elif isinstance(motion, Run):
        clip = _of_run(motion, data)
    elif isinstance(motion, Clip):
        clip = motion
    elif is_plan(motion):
        plan, known = read_whole_plan(motion)
        clip, around = clip_of_plan(plan, motion), (*around, *known)
        limits = limits_of_plan(motion, robot)
    else:
        clip = _of_file(motion, robot, reading or LogFormat())
    if clip.q.shape[1] != robot.n:
        raise ArmidError(
            f"{motion} moves {clip.q.shape[1]} joints, but {robot.name} has {robot.n}.",
            remedy="give a plan for this arm or a recording of it.",
        )
    collision, note = _collision_options(robot, around)
    return Preview(robot, clip, around, collision, _layers(robot, estimate), note, limits)


def preview_of_design(designed: Designed | DesignedMoves) -> Preview:
    """Preview of a plan that has just been designed."""
    robot, collision = designed.robot, designed.collision
    clip = clip_of_plan(designed.plan, "designed plan")
    around = () if collision is None else collision.surroundings
    note = designed.preflight.sentence
    layers = _layers(robot, None)
    return Preview(robot, clip, around, collision, layers, note[:1].upper() + note[1:], designed.limits)


def _collision_options(robot: Robot, around: tuple[Shape, ...]) -> tuple[CollisionOptions | None, str]:
    """Bodies and pairs to check for collisions; `None` and the reason if collisions are not checked."""
    try:
        collision = bodies_to_watch(robot, around)
    except ArmidError as error:
        return None, f"Collisions are not checked: {error.problem.rstrip('.')}"
    if collision is not None:
        return collision, ""
    lost = missing_bodies(robot)
    why = lost[0].evidence if lost else "the description has no shapes of bodies"
    return None, f"Collisions are not checked: {why}"


def estimate_layer(theta: Array, run: Run, note: str = "") -> MassLayer:
    """Layer of the link inertias that standard parameters (p,) of a run contain."""
    columns = run.model.inertial_columns
    return MassLayer("estimate", theta[columns].reshape(-1, 10), note)


def _of_file(path: str, robot: Robot, reading: LogFormat) -> Clip:
    """Clip of the motion in a file: a motion in the format of a controller, or a recording."""
    motion = motion_of_plan(path, robot, 1000.0)
    if motion is not None:
        return clip_of_motion(motion, Path(path).name)
    recording, _ = read_choice(RecordingChoice(path, reading=reading), ".", robot)
    return clip_of_recording(recording, Path(path).name)


def _of_run(run: Run, data: Path | str | None) -> Clip:
    """Clip of the first readable recording of a run, validation before training.

    Raises:
        ArmidError: No recording can be read.
    """
    study = read_records(run).study
    missing: list[str] = []
    for choice, sha256 in sorted(trained_and_validated(run, study), key=lambda each: each[0].role != "validate"):
        try:
            recording = read_recording_of(run, choice, sha256, study.folder, data)
        except ArmidError as error:
            missing.append(error.problem)
            continue
        return clip_of_recording(recording, f"{Path(choice.path).name} of {run.folder}")
    raise ArmidError(
        f"None of the recordings of {run.folder} can be read: {' '.join(missing)}",
        remedy="give the folder of the recordings with --data, or give a plan or recording to show.",
    )


def _layers(robot: Robot, estimate: MassLayer | None) -> tuple[MassLayer, ...]:
    return tuple(layer for layer in (layer_of_description(robot), estimate) if layer is not None)


def _rest(robot: Robot) -> Array:
    """Pose of an arm without a motion: 0 for each joint, or the middle of its range if the range excludes 0."""
    low, high = np.array([joint.position_limits for joint in robot.joints]).T
    bounded = np.isfinite(low) & np.isfinite(high) & ((low > 0.0) | (high < 0.0))
    return np.where(bounded, 0.5 * (np.where(bounded, low, 0.0) + np.where(bounded, high, 0.0)), 0.0)

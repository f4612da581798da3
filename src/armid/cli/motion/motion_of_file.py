"""Motions given as files: series of plans, planned motions, and recordings."""

from __future__ import annotations

import numpy as np

from armid.errors import ArmidError
from armid.excitation.fourier import Excitation
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.study.config import RecordingChoice
from armid.study.plans.plan_reading import is_plan, motion_of_plan, series_of
from armid.study.recordings.reading import read_choice


def series_of_file(path: str) -> Excitation | None:
    """Fourier series of a plan, with the period [s] of an ending `@SECONDS` of the path; `None` if it is no plan."""
    name, at, seconds = path.partition("@")
    if not is_plan(name):
        return None
    series = series_of(name)
    if not at:
        return series
    try:
        period = float(seconds)
    except ValueError:
        period = 0.0
    if not period > 0.0:
        raise ArmidError(
            f"{path}: {seconds!r} is not a duration in seconds.", remedy="write for instance thesis-a1@27."
        )
    return series.stretched(period)


def motion_of_file(path: str, robot: Robot) -> Motion:
    """Motion of a plan, or of a recording that is processed with the default options.

    Raises:
        ArmidError: The file cannot be read, or its number of joints differs from the robot's.
    """
    series = series_of_file(path)
    if series is not None:
        motion = series.sample(1000.0)
    else:
        motion = motion_of_plan(path, robot, 1000.0)
    if motion is None:
        recording, _ = read_choice(RecordingChoice(path, reading=LogFormat()), ".", robot)
        observations, _ = process_recordings([recording], ProcessingOptions(standstill="keep"))
        runs = [run.motion for run in observations.runs]
        motion = Motion(*(np.concatenate([getattr(run, key) for run in runs]) for key in ("time", "q", "dq", "ddq")))
    if motion.n != robot.n:
        raise ArmidError(
            f"{path} moves {motion.n} joints, but {robot.name} has {robot.n}.",
            remedy="give a plan or recording of this arm.",
        )
    return motion

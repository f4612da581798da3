"""armid finds the dynamic model of a robot arm from its description and a recording.

The names in this module are the functions for the stages of an identification and the types of their results. Each of
them is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armid.errors import ArmidError
    from armid.estimation.estimate_record import Estimate
    from armid.estimation.estimators import WeightedLeastSquares
    from armid.estimation.problem import EstimationProblem, build_problem
    from armid.estimation.run_estimator import estimate
    from armid.excitation.fourier import Excitation
    from armid.information.accumulate import accumulate_information
    from armid.information.information import Information
    from armid.measurement.convention_conversion import read_recording
    from armid.measurement.log_format import LogFormat
    from armid.measurement.processing.options import ProcessingOptions
    from armid.measurement.processing.pipeline import process_recordings
    from armid.measurement.recording import Recording
    from armid.model.base_parameters import BaseParameters, find_base_parameters
    from armid.model.dynamics_model import DynamicsModel
    from armid.model.motion import Motion
    from armid.robot import Robot, load_robot
    from armid.runs.run import load_run, save_run
    from armid.study.config import Study, load_study
    from armid.study.identify import identify

_HOMES = {
    "ArmidError": "errors",
    "BaseParameters": "model.base_parameters",
    "DynamicsModel": "model.dynamics_model",
    "Estimate": "estimation.estimate_record",
    "Excitation": "excitation.fourier",
    "Information": "information.information",
    "Motion": "model.motion",
    "EstimationProblem": "estimation.problem",
    "ProcessingOptions": "measurement.processing.options",
    "LogFormat": "measurement.log_format",
    "Recording": "measurement.recording",
    "Robot": "robot",
    "Study": "study.config",
    "WeightedLeastSquares": "estimation.estimators",
    "build_problem": "estimation.problem",
    "estimate": "estimation.run_estimator",
    "find_base_parameters": "model.base_parameters",
    "identify": "study.identify",
    "accumulate_information": "information.accumulate",
    "load_robot": "robot",
    "load_run": "runs.run",
    "load_study": "study.config",
    "process_recordings": "measurement.processing.pipeline",
    "read_recording": "measurement.convention_conversion",
    "save_run": "runs.run",
}

__all__ = [
    "ArmidError",
    "BaseParameters",
    "DynamicsModel",
    "Estimate",
    "EstimationProblem",
    "Excitation",
    "Information",
    "LogFormat",
    "Motion",
    "ProcessingOptions",
    "Recording",
    "Robot",
    "Study",
    "WeightedLeastSquares",
    "accumulate_information",
    "build_problem",
    "estimate",
    "find_base_parameters",
    "identify",
    "load_robot",
    "load_run",
    "load_study",
    "process_recordings",
    "read_recording",
    "save_run",
]


def __getattr__(name: str) -> Any:
    """Loads a public name from the module in which it is defined."""
    if name in _HOMES:
        return getattr(import_module(f"armid.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'armid' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)

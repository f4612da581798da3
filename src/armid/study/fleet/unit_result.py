"""Result of one unit of a fleet: its samples with the fleet as prior, in the torque scale of the fleet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.fleet.fleet_prior_estimator import FleetPriorEstimator
from armid.estimation.fleet.layout import FleetLayout
from armid.estimation.fleet.unit_update import FleetPrior, update_unit
from armid.information.information import Information, JointFactors
from armid.measurement.log_format import LogFormat
from armid.measurement.observations import Observations
from armid.study.identify import Result, conclude
from armid.study.prepare import Prepared
from armid.study.progress import Progress
from armid.study.recordings.processed import ProcessedRecording


def conclude_unit(
    prepared: Prepared, prior: FleetPrior, layout: FleetLayout, *, progress: Progress | None = None
) -> Result:
    """Estimates a unit with a fleet as prior, and validates it on the validation recordings of its study.

    The torque of the unit is divided by its torque scales. The log format of the result contains them as drive gains,
    so that further recordings of the unit are read in the same scale. Their uncertainty enters the covariance.

    Args:
        prepared: The prepared study of the unit.
        prior: What the fleet says about the unit without its own data.
        layout: Order of the unknowns of the fleet.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Raises:
        EstimationError: The unit has other parameters than the fleet.
    """
    found = update_unit(prior, prepared.problem.information, layout)
    scaled = with_scales(prepared, found.scale, found.scale_deviation)
    return conclude(scaled, progress=progress, method=FleetPriorEstimator(prior))


def with_scales(prepared: Prepared, scale: Array, deviation: Array) -> Prepared:
    """Prepared study whose measured torques are divided by torque scales.

    Args:
        prepared: The prepared study.
        scale: Torque scale of each joint, shape (n,).
        deviation: Standard deviations of the torque scales, shape (n,).
    """
    recordings = tuple(_scaled_recording(each, scale) for each in prepared.recordings)
    observations = prepared.problem.observations
    problem = replace(
        prepared.problem,
        information=_scaled_information(prepared.problem.information, scale, deviation),
        observations=None if observations is None else _scaled_observations(observations, scale),
    )
    choices = tuple(each.choice for each in recordings)
    return replace(
        prepared, recordings=recordings, problem=problem, study=replace(prepared.study, recordings=choices)
    )


def _scaled_recording(processed: ProcessedRecording, scale: Array) -> ProcessedRecording:
    """Processed recording whose torques are divided by torque scales (n,), as its log format then says."""
    choice = replace(processed.choice, reading=_scaled_format(processed.choice.reading, scale))
    observations = _scaled_observations(processed.observations, scale)
    return replace(processed, choice=choice, observations=observations)


def _scaled_format(reading: LogFormat, scale: Array) -> LogFormat:
    """Log format with drive gains that divide the torques by torque scales, shape (n,)."""
    given = 1.0 if reading.drive_gain is None else np.asarray(reading.drive_gain, dtype=np.float64)
    return replace(reading, drive_gain=tuple((given / scale).tolist()))


def _scaled_observations(observations: Observations, scale: Array) -> Observations:
    """Observations whose torques are divided by torque scales, shape (n,)."""
    return replace(observations, runs=tuple(replace(run, torque=run.torque / scale) for run in observations.runs))


def _scaled_information(information: Information, scale: Array, deviation: Array) -> Information:
    """Information whose torques are divided by torque scales with given standard deviations, shape (n,) each."""
    joints: list[JointFactors] = []
    for joint, factor in zip(information.joints, scale, strict=True):
        R = joint.R.copy()
        R[:, :, -1] /= factor
        joints.append(JointFactors(joint.parameters, R))
    return replace(information, joints=tuple(joints), scale_deviation=deviation / scale)

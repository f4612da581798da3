"""Result of one unit of a fleet: its samples with the fleet as prior, in the torque scale of the fleet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.fleet.fleet_prior_estimator import FleetPriorEstimator
from armid.estimation.fleet.layout import FleetLayout, fleet_layout
from armid.estimation.fleet.scaled_problem import scaled_observations, scaled_problem
from armid.estimation.fleet.unit_update import FleetPrior, update_unit
from armid.measurement.recording import Recording
from armid.study.config import Study
from armid.study.identify import Result, conclude
from armid.study.prepare import Prepared, prepare
from armid.study.progress import Progress
from armid.study.recordings.processed import ProcessedRecording


def concluded_unit(
    prepared: Prepared, prior: FleetPrior, layout: FleetLayout, progress: Progress | None = None
) -> tuple[Prepared, Result]:
    """Estimates a unit with a fleet as prior, and validates it on the validation recordings of its study.

    The torque of the unit is divided by its torque scales. The log format of the result contains them as drive gains,
    so that further recordings of the unit are read in the same scale. Their uncertainty enters the covariance.

    Args:
        prepared: The prepared study of the unit.
        prior: What the fleet says about the unit without its own data.
        layout: Order of the unknowns of the fleet.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Returns:
        The study with its measured torques in the scale of the fleet, and the result.

    Raises:
        EstimationError: The unit has other parameters than the fleet.
    """
    found = update_unit(prior, prepared.problem.information, layout)
    scaled = with_scales(prepared, found.scale, found.scale_deviation)
    return scaled, conclude(scaled, progress=progress, method=FleetPriorEstimator(prior))


def identify_unit(
    study: Study,
    prior: FleetPrior,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> tuple[Prepared, Result]:
    """Identifies a new unit, of which a few seconds of motion are enough, with a fleet as prior.

    Args:
        study: Study of the unit, with the torque terms of the fleet.
        prior: The fleet.
        given: Recordings that are in memory already, by their path in the study.
        threads: Number of threads of the compiled kernel.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Returns:
        The study with its measured torques in the scale of the fleet, and the result.

    Raises:
        ArmidError: An input is wrong, or the unit has other parameters than the fleet.
    """
    prepared = prepare(study, given=given, threads=threads, progress=progress)
    information = prepared.problem.information
    prior.require_names(information)
    return concluded_unit(prepared, prior, fleet_layout(information, np.isin(prior.names, prior.own)), progress)


def with_scales(prepared: Prepared, scale: Array, deviation: Array) -> Prepared:
    """Prepared study whose measured torques are divided by torque scales.

    Args:
        prepared: The prepared study.
        scale: Torque scale of each joint, shape (n,).
        deviation: Standard deviations of the torque scales, shape (n,).
    """
    recordings = tuple(_scaled_recording(each, scale) for each in prepared.recordings)
    study = replace(prepared.study, recordings=tuple(each.choice for each in recordings))
    problem = scaled_problem(prepared.problem, scale, deviation)
    return replace(prepared, recordings=recordings, problem=problem, study=study)


def _scaled_recording(processed: ProcessedRecording, scale: Array) -> ProcessedRecording:
    """Processed recording whose torques are divided by torque scales (n,), as its log format then says."""
    reading = processed.choice.reading
    given = 1.0 if reading.drive_gain is None else np.asarray(reading.drive_gain, dtype=np.float64)
    gains = np.broadcast_to(given / scale, len(scale))
    choice = replace(processed.choice, reading=replace(reading, drive_gain=tuple(gains.tolist())))
    return replace(processed, choice=choice, observations=scaled_observations(processed.observations, scale))

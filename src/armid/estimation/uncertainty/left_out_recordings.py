"""Estimates without one of the training recordings, and their error on the recording that was left out.

A recording that was left out shows what changes between recordings: friction, offsets, zeros of sensors, and model
error on another motion. Parts of one recording do not show it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.prediction_error import (
    PredictionError,
    prediction_error,
    with_model_error,
)
from armid.estimation.uncertainty.recording_change import mean_parameter_variance, recording_change
from armid.information.information import Information, select, total
from armid.information.kept_rows import runs_of
from armid.measurement.observations import Observations

MOST = 5
"""Largest number of estimates with left-out recordings; of more recordings, several are left out together."""


@dataclass(frozen=True, eq=False, slots=True)
class LeftOut:
    """Estimate without some training recordings, and its error on these recordings.

    Attributes:
        recordings: Numbers of the recordings that were left out.
        fit: Estimate from the other recordings, in the parameters of one recording.
        squares: Sum of squared errors of each joint on the left-out recordings, shape (n,) [(N·m)² or N²].
        rows: Number of rows of each joint in the left-out recordings, shape (n,).
        variance: Variance of the torque error by noise, parameters, model error and the change of friction and
            offsets, mean over these rows, shape (n,) [(N·m)² or N²].
    """

    recordings: tuple[int, ...]
    fit: Fit
    squares: Array
    rows: NDArray[np.int64]
    variance: Array

    @property
    def log_factors(self) -> Array:
        """Logarithm of the ratio of the RMS torque error to its predicted standard deviation, the root of `variance`.

        The array has one element for each joint that has rows, so at most n elements.
        """
        known = (self.rows > 0) & (self.variance > 0.0) & (self.squares > 0.0)
        return 0.5 * np.log(self.squares[known] / self.rows[known] / self.variance[known])


def leave_out_recordings(
    problem: EstimationProblem, solve: Callable[[EstimationProblem], Fit]
) -> tuple[LeftOut, ...]:
    """Leaves out each training recording in turn, and estimates from the others; torque scales count as exact.

    Recordings are left out in at most `MOST` groups. A group without which the data do not determine the parameters
    is skipped.

    Args:
        problem: Problem of all training recordings, with samples; its parameters are common to all recordings.
        solve: Function that solves an estimation problem and returns a fit with one value for each parameter. If the
            estimator has separate parameters for each recording, these are the means.

    Returns:
        One result for each group; empty if there is only one recording.
    """
    model, base, observations = problem.require_samples("cross-validation")
    numbers = np.unique(problem.information.recording)
    if len(numbers) < 2:
        return ()
    found: list[LeftOut] = []
    for group in np.array_split(numbers, min(MOST, len(numbers))):
        kept = [k for k, run in enumerate(observations.runs) if run.recording not in group]
        others = runs_of(model, base, observations, kept)
        training = _of_runs(problem, kept, others)
        try:
            fit = solve(training)
        except EstimationError:
            continue
        held_out = total(select(problem.information, np.isin(problem.information.recording, group)))
        out = [run.motion.q[run.rows][run.mask.any(axis=1)] for run in observations.runs if run.recording in group]
        change = recording_change(model, base, fit.values, training.information, others)
        error = prediction_error(training.information, fit, others, change)
        found.append(_left_out(tuple(int(k) for k in group), fit, error, held_out, np.concatenate(out)))
    return tuple(found)


def _of_runs(problem: EstimationProblem, runs: list[int], observations: Observations) -> EstimationProblem:
    """Problem of some runs, whose factors are those of all runs; the scales of torques are exact.

    Args:
        problem: Problem of all runs.
        runs: Indices of the runs, ascending.
        observations: The observations of these runs.
    """
    information = problem.information
    rest = select(information, np.isin(information.run, runs))
    exact = replace(rest, run=np.searchsorted(runs, rest.run), scale_deviation=np.zeros(information.n))
    return replace(problem, information=exact, observations=observations)


def _left_out(
    recordings: tuple[int, ...], fit: Fit, error: PredictionError, held_out: Information, positions: Array
) -> LeftOut:
    """Computes the error of an estimate on left-out recordings.

    Args:
        recordings: Numbers of the left-out recordings.
        fit: Estimate from the other recordings.
        error: Facts about the other recordings.
        held_out: Factors of the left-out recordings, one block.
        positions: Joint positions in their M rows in use, shape (M, n) [rad or m].
    """
    share = mean_parameter_variance(held_out, error.effective(fit.covariance))
    variance = with_model_error(error, share, fit.noise, positions).mean(axis=0)
    variance += mean_parameter_variance(held_out, error.change.covariance) + error.change.offset**2
    return LeftOut(recordings, fit, held_out_squares(held_out, fit.values), held_out.rows[0], variance)

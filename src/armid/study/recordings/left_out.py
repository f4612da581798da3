"""Error on left-out data: training recordings, or parts of a single one, are predicted from the remaining data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.catalogue import Estimator, EstimatorWithPrior
from armid.estimation.crossvalidation import folds, held_out_squares, training_information
from armid.estimation.estimate_record import Estimate, averaged
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty.left_out_recordings import LeftOut, leave_out_recordings
from armid.estimation.uncertainty.prediction_error import prediction_error, updated
from armid.estimation.uncertainty.recording_change import recording_change
from armid.estimation.uncertainty.recording_scatter import covariance_by_scales, with_recording_scatter
from armid.information.information import Information, select
from armid.measurement.observations import Observations
from armid.validation.left_out_error import LeftOutError, left_out_error

Separated = Callable[[EstimationProblem], EstimationProblem]
"""Function that gives each recording of a problem its own friction or offsets, if the study asks for this."""


def with_left_out(
    result: Estimate, problem: EstimationProblem, separated: Separated, method: Estimator
) -> tuple[Estimate, LeftOutError]:
    """Leaves out training data in turn, and completes an estimate with the errors on the left-out data.

    If there are several recordings, each one is left out; a single recording is left out part by part. The scatter
    between recordings is added to the covariance of the estimate. The quantities from which prediction intervals are
    computed are stored in the estimate.

    Args:
        result: Estimate from all training recordings.
        problem: Problem of all training recordings; its parameters are common to all recordings.
        separated: Function that gives each recording its own friction or offsets, if the study asks for this.
        method: Estimator of the estimate, with its options.

    Returns:
        The estimate, and the error on left-out data, which is NaN if nothing can be left out.
    """
    fixed = method.with_prior_of(separated(problem), result.fit) if isinstance(method, EstimatorWithPrior) else method

    def solve(part: EstimationProblem) -> Fit:
        # Predictions are judged without systematic errors, because errors on left-out recordings contain them.
        return averaged(result.base.names, estimate(separated(part), fixed, systematic_errors=False))

    found = leave_out_recordings(problem, solve)
    whole = separated(problem)
    by_scales = covariance_by_scales(result.fit, whole)
    model, base, observations = problem.require_samples("cross-validation")
    values = averaged(base.names, result.fit).values
    change = recording_change(model, base, values, problem.information, observations)
    count = len(np.unique(problem.information.recording))
    fit = with_recording_scatter(result.fit, found, count, by_scales, change.covariance)
    scales = by_scales if by_scales.any() else None
    error = prediction_error(whole.information, result.fit, observations, change, scales, left_out=bool(found))
    if found:  # their errors contain the scatter between recordings
        error = replace(error, without_effect=fit.covariance - error.effective(result.fit.covariance))
    error = updated(error, [each.log_factors for each in found])
    nothing = np.zeros((0, 0))  # the parts of the covariance are needed only for the facts above
    report = replace(fit.report, by_misfit=nothing, by_systematic=nothing)
    result = replace(result, fit=replace(fit, report=report), prediction=error)
    rows = problem.information.rows.sum(axis=0)
    if found:
        rows = np.sum([each.rows for each in found], axis=0)
        squares = np.sum([each.squares for each in found], axis=0)
        kind, left = "recordings", _recordings_of(problem.information, found)
    else:
        squares = _squares_of_parts(whole, method, result.fit)
        kind, left = "parts", problem.information
    return result, left_out_error(
        kind, squares, rows, error, fit.noise, problem.require_standard("cross-validation"), left
    )


def left_out_squares(problem: EstimationProblem, method: Estimator, fit: Fit) -> Array | None:
    """Sum of squared errors of each joint on parts that are left out in turn, shape (n,) [(N·m)² or N²].

    Args:
        problem: Problem of all training recordings.
        method: Estimator with its options; if it has a prior, the weight of the prior is that of `fit`.
        fit: Estimate from all training recordings.

    Returns:
        The sums; `None` if the recording is too short to leave a part of it out.

    Raises:
        EstimationError: Without one of the parts, the data do not determine the parameters.
    """
    information = problem.information
    fold = folds(information)
    numbers = np.unique(fold)
    if len(numbers) < 2:
        return None
    fixed = method.with_prior_of(problem, fit) if isinstance(method, EstimatorWithPrior) else method
    squares = np.zeros(information.n)
    for k in numbers:
        out = fold == k
        fit_without = fixed.solve(_without(problem, out | training_information(information, out)))
        squares += held_out_squares(select(information, out), fit_without.values)
    return squares


def _squares_of_parts(problem: EstimationProblem, method: Estimator, fit: Fit) -> Array:
    """Sums (n,) of `left_out_squares`; NaN if no part can be left out, or if the method fails or is too slow."""
    nothing = np.full(problem.information.n, np.nan)
    if not method.quick:
        return nothing
    try:
        found = left_out_squares(problem, method, fit)
    except (ArmidError, np.linalg.LinAlgError):
        return nothing
    return nothing if found is None else found


def _recordings_of(information: Information, found: tuple[LeftOut, ...]) -> Information:
    """Information that contains only the blocks of the recordings that were left out."""
    return select(information, np.isin(information.recording, [k for each in found for k in each.recordings]))


def _without(problem: EstimationProblem, left_out: NDArray[np.bool_]) -> EstimationProblem:
    """Estimation problem without the blocks that a mask selects, both in its factors and in its samples."""
    information = problem.information
    observations = problem.observations
    if observations is not None:
        runs = list(observations.runs)
        for k, run in enumerate(runs):
            removed_blocks = np.unique(run.block)[left_out[information.run == k]]
            runs[k] = replace(run, mask=run.mask & ~np.isin(run.block, removed_blocks)[:, None])
        observations = Observations(tuple(runs), observations.band)
    return replace(problem, information=select(information, ~left_out), observations=observations)

"""Comparison of all estimation methods on one data set: training error, held-out error, physical consistency.

Recordings are read and processed once, and all methods use the same information. The held-out error is the error on
the validation recordings. Without validation recordings, quick methods are cross-validated on blocks of the training
data; the weight of the prior is determined on all training data. If friction was selected on the training data, no
motion is held out, and there is no held-out error.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, EstimationError
from armid.estimation.catalogue import ESTIMATORS, Estimator, MultiStartEstimator
from armid.estimation.crossvalidation import held_out_squares, rms_by_joint
from armid.estimation.estimate_record import collapse
from armid.estimation.fit_result import Fit
from armid.estimation.link_properties import bodies_of
from armid.estimation.problem import EstimationProblem
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, total
from armid.model.parameter_name import ParameterName
from armid.study.config import build_estimator
from armid.study.prepare import Prepared, stated_problem
from armid.study.progress import Progress
from armid.study.recordings.left_out import left_out_squares
from armid.study.recordings.processed import joined_observations, of_role
from armid.validation.distance_to_consistency import certify_values

VALIDATE = "use one recording for validation only."

NOTES = {
    "validation": "on the validation recordings",
    "cross-validation": (
        "on segments of the training data that are left out in turn, with the weight of the prior that was "
        "determined on all data"
    ),
    "none": "not known, since friction and the prior's weight were chosen on all training data: " + VALIDATE[:-1],
}
"""Text that says on which motion the held-out error is computed, for each value of `MethodTable.unseen`."""

UnseenError = Callable[[Estimator, Fit], Array]
"""Function that computes the RMS torque error of each joint on held-out motion, shape (n,) [N·m or N], for a method
and its fit."""


@dataclass(frozen=True, eq=False, slots=True)
class MethodScore:
    """Scores of one estimation method; if its estimate fails, the scores are NaN, and `failure` gives the reason.

    Attributes:
        method: Name of the method.
        training: RMS residual of each joint in the band, shape (n,) [N·m or N].
        unseen: RMS error on held-out motion, shape (n,) [N·m or N]; NaN if no motion is held out.
        consistent: True if the base parameters are physically consistent; `None` if this is not known.
        distance: Distance between the base parameters and the nearest consistent parameters; NaN if it is not known.
        relative_distance: `distance` divided by the norm of the base parameters.
        eigenvalue: Smallest eigenvalue of the pseudo-inertias of all links; `None` if the method estimates only base
            parameters.
        dropped: Number of parameters that the method sets to zero.
        seconds: Computing time of the estimate [s].
        failure: Reason why the estimate or its cross-validation failed; empty without failure.
    """

    method: str
    training: Array
    unseen: Array
    consistent: bool | None = None
    distance: float = np.nan
    relative_distance: float = np.nan
    eigenvalue: float | None = None
    dropped: int = 0
    seconds: float = 0.0
    failure: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class MethodEstimate:
    """Values that one method estimates.

    Attributes:
        method: Name of the method.
        base: Base parameters π_b, shape (b,).
        bodies: Mass, centre of mass and inertia of each link, in the order of `QUANTITIES` of
            `armid.estimation.link_properties`, shape (n, 10); `None` if the method estimates only base parameters.
    """

    method: str
    base: Array
    bodies: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class MethodTable:
    """Scores of all estimation methods on one data set.

    Attributes:
        joints: Names of the joints.
        unseen: Kind of held-out motion: `validation` (recordings), `cross-validation` (parts of the training
            recordings that are left out in turn), or `none`.
        scores: Scores of each method.
        seconds: Computing time of the comparison, without the estimate of the run [s].
        share: Share of the rows of the validation recordings on which each joint is scored, shape (n,); all methods
            are scored on the same rows; `None` without validation recordings.
        names: Names of the base parameters, shape (b,).
        estimates: Estimated values of each method that succeeded.
    """

    joints: tuple[str, ...]
    unseen: str
    scores: tuple[MethodScore, ...]
    seconds: float
    share: Array | None = None
    names: tuple[ParameterName, ...] = ()
    estimates: tuple[MethodEstimate, ...] = ()

    @property
    def note(self) -> str:
        """Text that says on which motion, and on which share of its rows, the held-out error is computed."""
        used = 1.0 if self.share is None else float(np.nanmin(self.share))
        rows = (
            ""
            if used == 1.0
            else f", at least {100.0 * used:.0f} % of their rows, which are the same for all methods"
        )
        return NOTES[self.unseen] + rows


def compare_methods(
    prepared: Prepared, methods: Sequence[str] | None = None, *, progress: Progress | None = None
) -> MethodTable:
    """Estimates the parameters of a study with every method, each with its options in the study, and scores them.

    Args:
        prepared: Data and model of the study, which all methods share.
        methods: Names of the methods; all methods if no names are given.
        progress: Function that is called before each method, with the share of the methods that are done.

    Raises:
        ArmidError: No row of the validation recordings can be used.
    """
    began = time.perf_counter()
    problem = stated_problem(prepared)
    held_out = of_role(prepared.recordings, "validate")
    share = None
    if held_out:
        observations = joined_observations(held_out)
        validation = total(accumulate_information(prepared.model, prepared.base, observations))
        given = np.sum([run.mask.sum(axis=0) for run in observations.runs], axis=0)
        share = np.where(given > 0, validation.rows[0] / np.maximum(given, 1), np.nan)
        kind, unseen = "validation", _on_recordings(prepared, validation)
    elif prepared.friction_selection is not None and prepared.friction_selection.evidence:
        kind, unseen = "none", _no_error  # terms, load and prior depend on all training data already
    else:
        kind, unseen = "cross-validation", _on_folds(problem)
    names, scores, estimates = tuple(methods or ESTIMATORS), list[MethodScore](), list[MethodEstimate]()
    for k, name in enumerate(names):
        if progress is not None:
            progress("comparison", k / len(names))
        score, estimate = _score(prepared, problem, name, unseen)
        scores.append(score)
        estimates += [] if estimate is None else [estimate]
    seconds = time.perf_counter() - began
    joints, base = prepared.model.robot.joint_names, prepared.base.names
    return MethodTable(joints, kind, tuple(scores), seconds, share, base, tuple(estimates))


def compare_record(table: MethodTable) -> dict[str, Any]:
    """Content of `compare.json`: scores of each method. A total is the root of the sum of squares over the joints."""
    return {
        "joints": table.joints,
        "unseen": table.unseen,
        "share": table.share,
        "methods": [
            {
                "name": each.method,
                "training_rms": each.training,
                "training_total": float(np.linalg.norm(each.training)),
                "unseen_rms": each.unseen,
                "unseen_total": float(np.linalg.norm(each.unseen)),
                "consistent": each.consistent,
                "distance": each.distance,
                "relative_distance": each.relative_distance,
                "smallest_eigenvalue": each.eigenvalue,
                "dropped": each.dropped,
                "seconds": each.seconds,
                "failure": each.failure or None,
            }
            for each in table.scores
        ],
        "base_parameters": table.names,
        "estimates": [{"name": each.method, "base": each.base, "bodies": each.bodies} for each in table.estimates],
        "seconds": table.seconds,
    }


def _score(
    prepared: Prepared, problem: EstimationProblem, name: str, unseen: UnseenError
) -> tuple[MethodScore, MethodEstimate | None]:
    """Estimates with one method; returns its scores and its values, which are `None` if the method fails."""
    model, base = prepared.model, prepared.base
    nothing = np.full(model.n, np.nan)
    began = time.perf_counter()
    try:
        method = _quick(build_estimator(replace(prepared.study.estimation, method=name)))
        fit = method.solve(problem)
    except (ArmidError, np.linalg.LinAlgError) as error:
        seconds = time.perf_counter() - began
        return MethodScore(name, nothing, nothing, seconds=seconds, failure=_reason(error)), None
    seconds = time.perf_counter() - began
    failure, error_unseen = "", nothing
    consistency: tuple[bool | None, float, float] = (None, np.nan, np.nan)
    try:
        found = certify_values(model, base.names, collapse(base.names, fit), base.regrouping)
        consistency = found.feasible, found.distance, found.relative_distance
        error_unseen = unseen(method, fit)
    except (ArmidError, np.linalg.LinAlgError) as error:
        failure = _reason(error)
    eigenvalue = None if fit.standard is None else fit.standard.proof.smallest_eigenvalue
    dropped = len(fit.dropped)
    score = MethodScore(name, fit.residual_rms, error_unseen, *consistency, eigenvalue, dropped, seconds, failure)
    bodies = None if fit.standard is None else bodies_of(model, fit.standard)
    return score, MethodEstimate(name, collapse(base.names, fit), bodies)


def _quick(method: Estimator) -> Estimator:
    """Estimator with a single start instead of several, because its estimate is only used for a comparison."""
    return method.with_one_start() if isinstance(method, MultiStartEstimator) else method


def _reason(error: Exception) -> str:
    """Text that says why a method failed, from the error that it raised."""
    return error.problem if isinstance(error, ArmidError) else str(error)


def _on_recordings(prepared: Prepared, unseen: Information) -> UnseenError:
    """Function that computes the torque error of a fit on the validation recordings."""

    def error(method: Estimator, fit: Fit) -> Array:
        del method
        return rms_by_joint(held_out_squares(unseen, collapse(prepared.base.names, fit)), unseen.rows[0])

    return error


def _no_error(method: Estimator, fit: Fit) -> Array:
    """Torque errors (n,) that are all NaN, because no motion is held out."""
    del method
    return np.full(len(fit.rows), np.nan)


def _on_folds(problem: EstimationProblem) -> UnseenError:
    """Function that computes the cross-validation error of a method on folds of the training data."""

    def error(method: Estimator, fit: Fit) -> Array:
        if not method.quick:
            raise EstimationError(
                "Cross-validation was left out, because the method would take too long.", remedy=VALIDATE
            )
        squares = left_out_squares(problem, method, fit)
        if squares is None:
            raise EstimationError(
                "Cross-validation is not possible, because the recording is too short to leave a part of it out.",
                remedy=VALIDATE,
            )
        return rms_by_joint(squares, problem.information.rows.sum(axis=0))

    return error

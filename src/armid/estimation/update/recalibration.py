"""Recalibration: new recordings determine the changed parameters, all recordings determine the other parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.estimate_record import collapse
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.update.parameter_change import ParameterChange
from armid.estimation.update.stacked_problem import stack_problems
from armid.estimation.update.stacked_solution import JointSolution, solve_stacked
from armid.information.information import Information, JointFactors, merge
from armid.maths.distributions import student_quantile


@dataclass(frozen=True, eq=False, slots=True)
class RecalibratedFit:
    """Estimate after a recalibration with new recordings.

    Attributes:
        fit: The new estimate.
        information: Factors whose least-squares solution is the new estimate: the factors of the new recordings, and
            the factors of the earlier recordings with torques shifted by the effect of the changed parameters.
        changes: Change of every base parameter.
    """

    fit: Fit
    information: Information
    changes: tuple[ParameterChange, ...]


def recalibrate_fit(
    earlier: Information,
    fit: Fit,
    new: Information,
    changing: NDArray[np.bool_],
    tool: Array | None = None,
    samples: EstimationProblem | None = None,
) -> RecalibratedFit:
    """Recalibrates an estimate with new recordings.

    Args:
        earlier: Factors from which the earlier estimate was computed.
        fit: The earlier estimate.
        new: Factors of the new recordings.
        changing: Mask of the base parameters that have separate values in the new recordings, shape (b,).
        tool: Derivative of the base parameters with respect to the ten inertial parameters of a new tool, shape (b,
            10); `None` if the tool has not changed.
        samples: Samples of the new recordings, from which the correlation of their residuals in time is estimated;
            with `None` it is estimated from the blocks of `new`.

    Raises:
        EstimationError: The new recordings do not determine the effect of the tool.
    """
    stacked = stack_problems(earlier, fit, new, changing, tool, samples)
    solved = solve_stacked(stacked)
    to_new = stacked.to_new
    undetermined = np.abs(to_new @ solved.undetermined.T).max(axis=1, initial=0.0) > 0.0
    if undetermined.any():
        names = ", ".join(name for name, each in zip(new.names, undetermined, strict=True) if each)
        raise EstimationError(
            f"The recordings do not determine the new values of {names}.",
            remedy="move every joint through wide angles, or let fewer parameters change (without --tool or --all).",
        )
    estimate = _fit(new, to_new, solved)
    difference = to_new - stacked.before
    changes = _changes(new.names, fit, estimate, difference, solved)
    shifted = (
        earlier if changing.all() else _shifted(earlier, stacked.information.names, estimate.values, solved.values)
    )
    last = int(shifted.recording.max(initial=-1)) + 1
    runs = new.run + 1 + int(shifted.run.max(initial=-1))
    latest = replace(new, recording=new.recording + last, run=runs)
    return RecalibratedFit(estimate, new if changing.all() else merge([shifted, latest]), changes)


def _fit(new: Information, to_new: Array, solved: JointSolution) -> Fit:
    """Makes the fit of the new base parameters, with the residuals of the new recordings.

    Args:
        new: Factors of the new recordings.
        to_new: Matrix from the unknowns of the stacked problem to the new base parameters, shape (b, c).
        solved: Solution of the stacked problem.
    """
    part = np.abs(to_new) / np.abs(to_new).sum(axis=1, keepdims=True)
    values = to_new @ solved.values
    rows, moved = new.rows.sum(axis=0), solved.fit.report.moved
    left = np.sqrt(held_out_squares(new, values) / np.maximum(rows, 1))
    return replace(
        solved.fit,
        names=new.names,
        values=values,
        residual_rms=np.where(rows > 0, left, solved.fit.residual_rms),
        white_deviation=np.sqrt(np.diag(to_new @ solved.white @ to_new.T)),
        covariance=to_new @ solved.whole_covariance @ to_new.T,
        freedom=part @ solved.freedom[: len(solved.values)],
        prior_precision=None,
        report=replace(solved.fit.report, moved=to_new @ moved if len(moved) else moved),
    )


def _changes(
    names: tuple[str, ...], fit: Fit, estimate: Fit, difference: Array, solved: JointSolution
) -> tuple[ParameterChange, ...]:
    """Computes the change of every base parameter, with its standard deviation.

    If a parameter has separate values in earlier and new recordings, the standard deviation of the difference follows
    from the common solution of all recordings. If a parameter has one common value, the earlier and the new estimate
    are compared as if they were independent.

    Args:
        names: Names of the base parameters.
        fit: The earlier estimate.
        estimate: The new estimate.
        difference: Matrix from the unknowns of the common solution to the changes, zero for common parameters, shape
            (b, c).
        solved: The common solution.
    """
    before = collapse(names, fit)
    earlier = np.array([[name == copy.of_all for copy in fit.names] for name in names], dtype=np.float64)
    earlier /= earlier.sum(axis=1, keepdims=True)
    variance = np.einsum("ik,kl,il->i", difference, solved.whole_covariance, difference)
    apart = np.einsum("ik,kl,il->i", earlier, fit.covariance, earlier) + np.diag(estimate.covariance)
    has_own_value = difference.any(axis=1)
    change = np.where(has_own_value, difference @ solved.values, estimate.values - before)
    deviation = np.sqrt(np.where(has_own_value, variance, apart))
    half = student_quantile(estimate.freedom) * deviation
    return tuple(
        ParameterChange(
            name, float(before[k]), float(estimate.values[k]), float(change[k]), float(deviation[k]), float(half[k])
        )
        for k, name in enumerate(names)
    )


def _shifted(earlier: Information, unknowns: tuple[str, ...], values: Array, solution: Array) -> Information:
    """Shifts the torques of earlier factors by the effect of the changed parameters.

    The residuals of the factors stay the same. Therefore least squares on the shifted factors and the factors of the
    new recordings gives the new values.

    Args:
        earlier: Factors of the earlier recordings.
        unknowns: Names of the c unknowns of the common solution.
        values: New values of the parameters of the factors.
        solution: Common solution, shape (c,).
    """
    position = {name: k for k, name in enumerate(unknowns)}
    joints = [np.array(joint.R) for joint in earlier.joints]
    for recording in np.unique(earlier.recording):
        blocks = earlier.recording == recording
        positions = [_earlier_position(position, name, int(recording)) for name in earlier.names]
        difference = values - solution[positions]
        for joint, R in zip(earlier.joints, joints, strict=True):
            R[blocks, :, -1] += R[blocks, :, :-1] @ difference[joint.parameters]
    factors = tuple(JointFactors(joint.parameters, R) for joint, R in zip(earlier.joints, joints, strict=True))
    return replace(earlier, joints=factors)


def _earlier_position(position: dict[str, int], name: str, recording: int) -> int:
    """Index of the unknown that stands for a parameter in an earlier recording.

    The unknown may be common to all recordings, belong to this recording, or be common to all earlier recordings.
    """
    for each in (name, f"{name}[{recording + 1}]", f"{name}[1]"):
        if each in position:
            return position[each]
    raise KeyError(name)

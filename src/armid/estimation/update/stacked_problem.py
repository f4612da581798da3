"""Least-squares problem of an earlier estimate and new recordings.

Parameters that may have changed (friction, a tool, or all parameters) have separate values in the new recordings; all
other parameters are common. The earlier data are represented by their stored triangular factors and the prior of the
earlier estimate. The right-hand sides are shifted so that the earlier estimate minimises the cost of the earlier
data; the shift contains the effect of constraints. If factors and prior do not determine every parameter, the earlier
estimate with its covariance is used instead of the factors. In this way, the uncertainty of the earlier parameters,
their correlations and the common torque scales are part of the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.problem import EstimationProblem
from armid.information.information import Information, JointFactors, merge, select, stack, total
from armid.maths.linalg import null_directions, unit_columns
from armid.model.parameter_name import ParameterName

MIN_PRECISION = 1e-9
"""Smallest eigenvalue of the precision of a prior, scaled to a unit diagonal, with which the precision counts as
positive definite."""

MIN_VARIANCE_SHARE = 1e-6
"""Lower limit of the eigenvalues of the earlier covariance without torque scales, divided by the largest one: a
rounding error."""


@dataclass(frozen=True, eq=False, slots=True)
class EarlierErrors:
    """Errors of an earlier estimate: its covariance, and the shift that rows near velocity reversals cause.

    The information of the earlier estimate is stacked with new data.

    Attributes:
        blocks: Mask of the blocks that belong to the earlier estimate, shape (blocks,).
        prior: Number of rows of the prior of the earlier estimate; these are the last rows of the prior of the
            stacked problem.
        selection: Matrix from the c unknowns to the b' parameters of the earlier estimate, shape (b', c).
        covariance: Covariance of the b' parameters by noise, without torque scales and reversals, shape (b', b').
        freedom: Degrees of freedom of this covariance, shape (b',).
        moved: Shift of the b' parameters by rows near velocity reversals, shape (b',).
        reach: Share of `moved` that counts as one standard deviation.
    """

    blocks: NDArray[np.bool_]
    prior: int
    selection: Array
    covariance: Array
    freedom: Array
    moved: Array
    reach: float


@dataclass(frozen=True, eq=False, slots=True)
class StackedProblem:
    """Least-squares problem of earlier and new recordings in c unknowns x.

    Attributes:
        information: Factors of all blocks in use.
        prior: The k whitened rows P of the prior, with the right-hand side p in the last column, shape (k, c + 1).
        scale_sensitivity: Derivative of p by the relative error of each joint's torque scale, shape (k, n).
        before: Matrix from x to the earlier base parameters, shape (b, c).
        after: Matrix from x to the base parameters in the new recordings, without the payload, shape (b, c).
        load: Positions of the ten payload parameters in x, shape (10,) or (0,).
        weights: Initial weights of the joints' rows, shape (n,).
        to_new: Matrix from x to the base parameters in the new recordings, payload included, shape (b, c).
        samples: The new recordings with their samples; `None` if only factors are available.
        earlier: Errors of the earlier estimate; `None` if the earlier estimate is represented by rows of the prior.
    """

    information: Information
    prior: Array
    scale_sensitivity: Array
    before: Array
    after: Array
    load: NDArray[np.intp]
    weights: Array
    to_new: Array
    samples: EstimationProblem | None = None
    earlier: EarlierErrors | None = None


def stack_problems(
    earlier: Information,
    fit: Fit,
    new: Information,
    changing: NDArray[np.bool_],
    load: Array | None = None,
    samples: EstimationProblem | None = None,
) -> StackedProblem:
    """Stacks an earlier estimate and new recordings into one problem.

    Args:
        earlier: Factors from which the earlier estimate was computed.
        fit: The earlier estimate.
        new: Factors of the new recordings, in the same base parameters.
        changing: Mask of the base parameters that have separate values in the new recordings, shape (b,).
        load: Derivative of the base parameters by the ten parameters of a payload, if there is one, shape (b, 10).
        samples: The new recordings with their samples, in the base parameters.
    """
    with_copies = {name.of_all for name in fit.names if name.recording}  # friction of each earlier recording
    recording = earlier.recording if with_copies else np.zeros(earlier.blocks, dtype=np.int64)
    last = int(recording.max(initial=0)) + 1
    runs = new.run + 1 + int(earlier.run.max(initial=-1))
    both = merge([replace(earlier, recording=recording), replace(new, recording=np.full(new.blocks, last), run=runs)])
    changing = changing | np.isin(both.names, list(with_copies))
    separated = separate_by_recording(both, changing)
    before, after = _maps(both.names, separated.names, changing, last)
    is_new = np.arange(both.blocks) >= earlier.blocks
    prior = _continuity_rows(earlier, before, after, changing)
    sensitivity = np.zeros((len(prior), earlier.n))
    errors = None
    if fit.prior_precision is not None and _is_definite(fit.prior_precision):
        prior_rows = _prior_rows(earlier, separated.names, fit)
        prior = np.vstack([prior, prior_rows])
        sensitivity = np.vstack([sensitivity, np.zeros((len(prior_rows), earlier.n))])
        errors = _errors(earlier, separated.names, fit, ~is_new, len(prior_rows))
    elif _is_determined(earlier, fit):
        separated = _shift_to_estimate(separated, ~is_new, earlier, fit)
        errors = _errors(earlier, separated.names, fit, ~is_new, 0)
    else:
        prior_rows, prior_sensitivity = _estimate_rows(earlier, separated.names, fit)
        prior, sensitivity = np.vstack([prior, prior_rows]), np.vstack([sensitivity, prior_sensitivity])
        separated, is_new = select(separated, is_new), np.ones(new.blocks, dtype=np.bool_)
    separated = replace(separated, scale_deviation=new.scale_deviation)
    if load is None:
        none = np.arange(0)
        return StackedProblem(separated, prior, sensitivity, before, after, none, fit.weights, after, samples, errors)
    if errors is not None:
        errors = replace(errors, selection=np.hstack([errors.selection, np.zeros((len(errors.selection), 10))]))
    return StackedProblem(
        with_load_columns(separated, is_new, after.T @ load),
        np.insert(prior, [-1] * 10, 0.0, axis=1),
        sensitivity,
        np.hstack([before, np.zeros((len(before), 10))]),
        np.hstack([after, np.zeros((len(after), 10))]),
        np.arange(separated.count, separated.count + 10),
        fit.weights,
        np.hstack([after, load]),
        samples,
        errors,
    )


def _maps(
    names: tuple[ParameterName, ...], separated: tuple[ParameterName, ...], changing: NDArray[np.bool_], last: int
) -> tuple[Array, Array]:
    """Two matrices (b, c) from the unknowns to base parameters: of the earlier recordings, and of the new recordings.

    If the earlier recordings have separate parameters, the mean is taken.

    Args:
        names: Names of the b base parameters.
        separated: Names of the c unknowns.
        changing: Mask of the base parameters that have separate values in the new recordings, shape (b,).
        last: Number of the last earlier recording.
    """
    position = {name: k for k, name in enumerate(separated)}
    before, after = np.zeros((2, len(names), len(separated)))
    for k, name in enumerate(names):
        if not changing[k]:
            before[k, position[name]] = after[k, position[name]] = 1.0
            continue
        copy = name.of_recording(last + 1)
        copies = [position[other] for other in separated if other.of_all == name and other != copy]
        before[k, copies] = 1.0 / len(copies)
        after[k, position[copy]] = 1.0
    return before, after


def _continuity_rows(earlier: Information, before: Array, after: Array, changing: NDArray[np.bool_]) -> Array:
    """Rows of a weak prior with mean zero on the changes of parameters between earlier and new recordings.

    The prior has an effect only on changes that the data do not determine. One standard deviation is a change whose
    torque is as large as the whole torque of the joints on which it acts.

    Args:
        earlier: Factors of the earlier recordings.
        before: Matrix from the unknowns to the earlier base parameters, shape (b, c).
        after: Matrix from the unknowns to the base parameters in the new recordings, shape (b, c).
        changing: Mask of the base parameters that have separate values in the new recordings, shape (b,).
    """
    A, y = stack(total(earlier))
    length = np.linalg.norm(A, axis=0)
    torque = np.array([np.linalg.norm(y[A[:, k] != 0.0]) for k in range(len(length))])
    chosen = np.flatnonzero(changing & (torque > 0.0))
    rows = (after - before)[chosen] * (length / np.where(torque > 0.0, torque, 1.0))[chosen, None]
    return np.column_stack([rows, np.zeros(len(rows))])


def _is_determined(earlier: Information, fit: Fit) -> bool:
    """True if the factors alone determine every parameter."""
    return not len(null_directions(stack(total(earlier), fit.weights)[0]))


def _shift_to_estimate(separated: Information, old: NDArray[np.bool_], earlier: Information, fit: Fit) -> Information:
    """Shifts the torques of earlier blocks so that the earlier estimate minimises the cost with equal residuals.

    The shift is zero if the earlier estimate is a least-squares solution. It is not zero if constraints were active
    or if single rows had weights.

    Args:
        separated: Factors of all blocks in the unknowns.
        old: Mask of the earlier blocks, shape (blocks,).
        earlier: Factors from which the earlier estimate was computed.
        fit: The earlier estimate.
    """
    kept, selection = _in_estimate_parameters(earlier, separated.names, fit)
    order = [kept.names.index(name) for name in fit.names]
    A, y = stack(total(kept), fit.weights)
    A, length = unit_columns(A[:, order])
    shift = selection.T @ (np.linalg.lstsq(A, A @ (fit.values * length) - y)[0] / length)
    joints: list[JointFactors] = []
    for joint in separated.joints:
        R = np.array(joint.R)
        R[old, :, -1] += R[old, :, :-1] @ shift[joint.parameters]
        joints.append(JointFactors(joint.parameters, R))
    return replace(separated, joints=tuple(joints))


def _errors(
    earlier: Information, names: tuple[str, ...], fit: Fit, blocks: NDArray[np.bool_], prior: int
) -> EarlierErrors:
    """Computes covariance and shift by reversals of the earlier estimate, for use in a stacked problem.

    Args:
        earlier: Factors of the earlier estimate.
        names: Names of the c unknowns.
        fit: The earlier estimate.
        blocks: Mask of the blocks that belong to the earlier estimate, shape (blocks,).
        prior: Number of rows of the prior of the earlier estimate.
    """
    kept, selection = _in_estimate_parameters(earlier, names, fit)
    scale_sensitivity = (
        _scale_sensitivity(kept, fit)[[kept.names.index(name) for name in fit.names]] * earlier.scale_deviation
    )
    moved = fit.report.moved if len(fit.report.moved) == len(fit.names) else np.zeros(len(fit.names))
    reach = fit.report.reach
    covariance = fit.covariance - scale_sensitivity @ scale_sensitivity.T - reach**2 * np.outer(moved, moved)
    whole, remaining = np.diag(fit.covariance), np.maximum(np.diag(covariance), 0.0)
    # The part of the variance from torque scales and reversals has infinite degrees of freedom.
    share = np.divide(remaining, whole, out=np.ones_like(remaining), where=whole > 0.0)
    return EarlierErrors(blocks, prior, selection, covariance, np.maximum(fit.freedom * share**2, 1.0), moved, reach)


def _is_definite(precision: Array) -> bool:
    """True if a precision is positive definite when it is scaled to a unit diagonal."""
    if not (np.diag(precision) > 0.0).all():
        return False
    size = np.sqrt(np.diag(precision))
    return bool(np.linalg.eigvalsh(precision / np.outer(size, size))[0] > MIN_PRECISION)


def _in_estimate_parameters(earlier: Information, names: tuple[str, ...], fit: Fit) -> tuple[Information, Array]:
    """Factors in the b' parameters of the earlier estimate, and matrix (b', c) from unknowns to these parameters."""
    with_copies = [name.of_all for name in fit.names if name.recording]
    kept = separate_by_recording(earlier, np.isin(earlier.names, with_copies)) if with_copies else earlier
    selection = np.zeros((len(fit.names), len(names)))
    position = {name: k for k, name in enumerate(names)}
    for k, name in enumerate(fit.names):  # without copies, what all earlier recordings share is the first copy
        selection[k, position[name] if name in position else position[name.of_recording(1)]] = 1.0
    return kept, selection


def _prior_rows(earlier: Information, names: tuple[str, ...], fit: Fit) -> Array:
    """Whitened rows (b', c + 1) of the prior of the earlier estimate.

    With these rows, the earlier estimate minimises the cost. The mean π₀ of the prior is computed from P (π - π₀) =
    -g, with the precision P of the prior, the earlier estimate π and the gradient g of the cost of the data. In this
    way, the effect of constraints becomes part of the mean.
    """
    assert fit.prior_precision is not None  # the caller has made sure
    kept, selection = _in_estimate_parameters(earlier, names, fit)
    order = [kept.names.index(name) for name in fit.names]
    A, y = stack(total(kept), fit.weights)
    A = A[:, order]
    slope = A.T @ (A @ fit.values - y)
    size = 1.0 / np.sqrt(np.diag(fit.prior_precision))
    half = np.linalg.cholesky(size[:, None] * fit.prior_precision * size).T
    side = half @ (fit.values / size) + np.linalg.solve(half.T, size * slope)
    return np.column_stack([(half / size) @ selection, side])


def _estimate_rows(earlier: Information, names: tuple[str, ...], fit: Fit) -> tuple[Array, Array]:
    """Whitened rows (b', c + 1) that represent the earlier estimate, and derivatives of their right-hand sides.

    The derivatives (b', n) are by the relative errors of the torque scales of the joints.
    """
    kept, selection = _in_estimate_parameters(earlier, names, fit)
    unit = _scale_sensitivity(kept, fit)[[kept.names.index(name) for name in fit.names]]
    scale_sensitivity = unit * earlier.scale_deviation
    size = np.sqrt(np.diag(fit.covariance))
    size = np.where(size > 0.0, size, 1.0)
    share, directions = np.linalg.eigh(
        (fit.covariance - scale_sensitivity @ scale_sensitivity.T) / np.outer(size, size)
    )
    whitening = (directions / np.sqrt(np.maximum(share, MIN_VARIANCE_SHARE * share[-1]))).T / size
    return np.column_stack([whitening @ selection, whitening @ fit.values]), whitening @ unit


def _scale_sensitivity(information: Information, fit: Fit) -> Array:
    """Derivative (b', n) of a least-squares estimate by the relative error of each joint's torque scale."""
    whole = total(information)
    A = stack(whole, fit.weights)[0]
    normal = A.T @ A
    if fit.prior_precision is not None:
        at = [fit.names.index(name) for name in whole.names]
        normal = normal + fit.prior_precision[np.ix_(at, at)]
    # Scaled with the prior, which may be far surer of some parameters than the data.
    length = np.sqrt(np.diag(normal))
    length = np.where(length > 0.0, length, 1.0)
    inverse = np.linalg.pinv(normal / np.outer(length, length), hermitian=True) / np.outer(length, length)
    return inverse @ right_hand_sides(whole, fit.weights)


def right_hand_sides(whole: Information, weights: Array) -> Array:
    """Right-hand sides w_j² R_jᵀ ρ_j of the normal equations for each joint j, shape (c, n).

    Here w_j is the weight, R_j the triangular factor and ρ_j the right-hand side of the rows of joint j.
    """
    sides = np.zeros((whole.count, whole.n))
    for j, joint in enumerate(whole.joints):
        sides[joint.parameters, j] = weights[j] ** 2 * (joint.R[0, :, :-1].T @ joint.R[0, :, -1])
    return sides


def with_load_columns(information: Information, new: NDArray[np.bool_], added: Array) -> Information:
    """Appends ten columns for the parameters of a payload to factors.

    Args:
        information: Factors, any number of blocks.
        new: Mask of the blocks with the payload, shape (blocks,).
        added: Derivative of the c parameters by the payload parameters, shape (c, 10).
    """
    joints: list[JointFactors] = []
    for joint in information.joints:
        columns, side = joint.R[:, :, :-1], joint.R[:, :, -1:]
        load = (columns @ added[joint.parameters]) * new[:, None, None]
        parameters = np.append(joint.parameters, information.count + np.arange(10)).astype(np.int32)
        joints.append(JointFactors(parameters, triangular(np.concatenate([columns, load, side], axis=2))))
    names = tuple(f"load {k}" for k in range(10))
    return replace(information, names=(*information.names, *names), joints=tuple(joints))


def triangular(rows: Array) -> Array:
    """Triangular factors (blocks, k, k) of the rows of each block (blocks, m, k), padded with zero rows if m < k."""
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    return np.concatenate([R, np.zeros((len(R), R.shape[2] - R.shape[1], R.shape[2]))], axis=1)

"""Solution of a stacked problem of earlier and new recordings; the torque scales of the joints may be unknowns, too.

    minimise Σ_j w_j² |ρ_j - s_j R_j x|² + |P x - p|²,        s_j = 1 unless estimated

The unknowns are x. For each joint j, w_j is the weight, R_j the triangular factor, ρ_j the right-hand side and s_j
the torque scale; P and p are the rows and the right-hand side of the prior. A scale multiplies the model and not the
measured torque. If a scale multiplied the measured torque, the noise in this column would bias the scale by the share
of noise in the torque.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.update.stacked_covariance import JointCovariance, prior_information
from armid.estimation.update.stacked_problem import StackedProblem, right_hand_sides, triangular
from armid.information.information import Information, JointFactors, select, stack, total
from armid.maths.linalg import condition, null_directions, scaled_condition, unit_columns

TOLERANCE = 1e-9
"""Largest relative change of weights and scales at which the iteration ends: far below any effect on the estimate."""

RESOLUTION = 1e-7
"""Lower limit of the residual of a joint, divided by the torque of the joint. Without this limit, a joint with
noise-free data would get so large a weight that the rounding errors of its rows would be larger than the rows of
other joints and of the prior."""

ITERATIONS = 200

ROUNDING_SHARE = 1e-6
"""Ratio of an entry of an undetermined direction to its largest entry, for columns of unit length, below which the
entry is a rounding error."""


@dataclass(frozen=True, eq=False, slots=True)
class JointSolution:
    """Solution of a stacked problem.

    Attributes:
        values: The c parameters, shape (c,).
        covariance: Covariance of the parameters, without the uncertainty of torque scales that are not estimated,
            shape (c, c).
        white: Covariance of the parameters for white residuals, shape (c, c).
        scale_effect: Change of the parameters by one standard deviation of each joint's torque scale, shape (c,
            n).
        undetermined: The d directions of the parameters that neither data nor prior determine, shape (d, c).
        scale: Ratio of measured torque to the torque of the model, shape (n,); ones if the scales are not estimated.
        scale_covariance: Covariance of the scales, shape (n, n); zero if the scales are not estimated.
        undetermined_scale: Mask of the scales that neither data nor prior determine, shape (n,).
        freedom: Degrees of freedom of the parameters and the scales, shape (c + n,).
        fit: Weights, residuals, and the report on the covariance with the shift of the c parameters by reversals.
    """

    values: Array
    covariance: Array
    white: Array
    scale_effect: Array
    undetermined: Array
    scale: Array
    scale_covariance: Array
    undetermined_scale: NDArray[np.bool_]
    freedom: Array
    fit: Fit

    @property
    def whole_covariance(self) -> Array:
        """Covariance of the parameters with the uncertainty of the torque scales, shape (c, c)."""
        return self.covariance + self.scale_effect @ self.scale_effect.T


def solve_stacked(
    stacked: StackedProblem, *, scale_deviation: Array | None = None, fixed: Array | None = None
) -> JointSolution:
    """Solves a stacked problem; the weight of each joint is iterated as in weighted least squares.

    Args:
        stacked: The problem.
        scale_deviation: Standard deviations of the torque scales about one, shape (n,); infinite for unknown scales.
            If not given, the scales are not estimated.
        fixed: Known parameters of the payload, NaN for unknown ones, shape (10,).

    Raises:
        EstimationError: Weights or scales do not converge.
    """
    return _solution_with_covariance(stacked, *_solve(stacked, scale_deviation, fixed))


def solve_values(
    stacked: StackedProblem, *, scale_deviation: Array | None = None, fixed: Array | None = None
) -> tuple[Array, Array]:
    """Solves a stacked problem without its covariance; returns parameters (c,) and torque scales (n,).

    Args:
        stacked: The problem.
        scale_deviation: Standard deviations of the torque scales about one, shape (n,); if not given, the scales are
            not estimated.
        fixed: Known parameters of the payload, NaN for unknown ones, shape (10,).

    Raises:
        EstimationError: Weights or scales do not converge.
    """
    return _solve(stacked, scale_deviation, fixed)[2:]


def _solve(
    stacked: StackedProblem, scale_deviation: Array | None, fixed: Array | None
) -> tuple[_Unknowns, Array, Array, Array]:
    """Solves a stacked problem without its covariance: unknowns, weights (n,), parameters (c,) and scales (n,)."""
    count, n = stacked.information.count, stacked.information.n
    known, free = np.zeros(count), np.ones(count, dtype=np.bool_)
    if fixed is not None:
        known[stacked.load], free[stacked.load] = np.nan_to_num(fixed), np.isnan(fixed)
    side = stacked.prior[:, -1] - stacked.prior[:, :-1] @ known
    fixed_scales = _Unknowns(known, free, np.column_stack([stacked.prior[:, :-1][:, free], side]), scaled=False)
    whole = total(stacked.information)
    weights, values, scale = _iterate_weights(whole, fixed_scales, stacked.weights, known, np.ones(n))
    if scale_deviation is None:
        return fixed_scales, weights, values, scale
    bounded = np.flatnonzero(np.isfinite(scale_deviation))
    rows = np.zeros((len(bounded), fixed_scales.count + n + 1))
    rows[np.arange(len(bounded)), fixed_scales.count + bounded] = rows[:, -1] = 1.0 / scale_deviation[bounded]
    # An earlier estimate changes with the true torque, 1 / s of the measured: its rows are P x + sensitivity (s - 1)
    # = p.
    side = fixed_scales.prior[:, -1] + stacked.scale_sensitivity.sum(axis=1)
    with_scales = np.column_stack([fixed_scales.prior[:, :-1], stacked.scale_sensitivity, side])
    unknowns = replace(fixed_scales, prior=np.vstack([with_scales, rows]), scaled=True)
    return unknowns, *_iterate_weights(whole, unknowns, weights, values, scale)


@dataclass(frozen=True, eq=False, slots=True)
class _Unknowns:
    """The u unknowns among the c parameters, and their prior.

    Attributes:
        known: Values of the known parameters, zero elsewhere, shape (c,).
        free: Mask of the unknowns, shape (c,).
        prior: The k whitened rows for unknowns and scales, right-hand side last, shape (k, u + 1) or (k, u + n + 1).
        scaled: True if the scales are unknowns, too; their columns follow those of the parameters.
    """

    known: Array
    free: NDArray[np.bool_]
    prior: Array
    scaled: bool

    @property
    def count(self) -> int:
        """Number of unknown parameters u."""
        return int(self.free.sum())


def _linearise(information: Information, unknowns: _Unknowns, values: Array, scale: Array) -> Information:
    """Linearises the problem at parameters x (c,) and scales s (n,).

    With the triangular factor R and the right-hand side ρ of a joint, the equation for the new parameters x' and the
    new scale s' is s R x' + s' R x = ρ + s R x.
    """
    position = np.cumsum(unknowns.free) - 1
    joints: list[JointFactors] = []
    for j, joint in enumerate(information.joints):
        own = joint.parameters
        columns, side = joint.R[:, :, :-1], joint.R[:, :, -1] - scale[j] * (joint.R[:, :, :-1] @ unknowns.known[own])
        free = unknowns.free[own]
        parameters, parts = position[own[free]], [scale[j] * columns[:, :, free]]
        if unknowns.scaled:
            torque = columns @ values[own]
            side = side + scale[j] * torque
            parameters, parts = np.append(parameters, unknowns.count + j), [*parts, torque[:, :, None]]
        rows = np.concatenate([*parts, side[:, :, None]], axis=2)
        joints.append(JointFactors(parameters.astype(np.int32), triangular(rows)))
    names = tuple(name for name, free in zip(information.names, unknowns.free, strict=True) if free)
    if unknowns.scaled:
        names += tuple(f"scale {j + 1}" for j in range(information.n))
    return replace(information, names=names, joints=tuple(joints), scale_deviation=np.zeros(information.n))


@dataclass(frozen=True, eq=False, slots=True)
class _Determined:
    """Stacked problem in r coordinates z that data and prior determine; the unknowns are x = basis · z.

    Attributes:
        information: Factors in the coordinates z.
        prior: The k whitened rows of the prior in z, right-hand side last, shape (k, r + 1).
        basis: Matrix from z to the u unknowns, shape (u, r).
        undetermined: The d directions of x that neither data nor prior determine, shape (d, u).
    """

    information: Information
    prior: Array
    basis: Array
    undetermined: Array


def _restrict_to_determined(linear: Information, prior: Array, weights: Array) -> _Determined:
    """Changes the unknowns of a problem to coordinates that data and prior determine."""
    A = np.vstack([stack(total(linear), weights)[0], prior[:, :-1]])
    length = unit_columns(A)[1]
    directions = null_directions(A)
    if not len(directions):
        return _Determined(linear, prior, np.eye(len(length)), directions)
    directions = np.where(
        np.abs(directions) > ROUNDING_SHARE * np.abs(directions).max(axis=1, keepdims=True), directions, 0.0
    )
    basis = np.linalg.svd(directions)[2][len(directions) :].T / length[:, None]
    every = np.arange(basis.shape[1], dtype=np.int32)
    joints = tuple(
        JointFactors(
            every, triangular(np.concatenate([R[:, :, :-1] @ basis[joint.parameters], R[:, :, -1:]], axis=2))
        )
        for joint in linear.joints
        for R in (joint.R,)
    )
    information = replace(linear, names=tuple(map(str, every)), joints=joints)
    rows = np.column_stack([prior[:, :-1] @ basis, prior[:, -1]])
    return _Determined(information, rows, basis, directions / length)


class _WeightedSolution:
    """Least-squares solution from factors and prior for one set of weights.

    Attributes:
        values: The r unknowns, shape (r,).
        inverse: Inverse of the weighted normal matrix, prior included, shape (r, r).
        squares: Sum of squared residuals of each joint, unweighted, shape (n,).
        deviation: Standard deviation of each joint's residual, corrected for the degrees of freedom, shape (n,).
    """

    def __init__(self, whole: Information, prior: Array, weights: Array) -> None:
        A, y = stack(whole, weights)
        scaled, length = unit_columns(np.vstack([A, prior[:, :-1]]))
        Q, R = np.linalg.qr(scaled)
        self.values = np.linalg.solve(R, Q.T @ np.concatenate([y, prior[:, -1]])) / length
        half = np.linalg.inv(R) / length[:, None]
        self.inverse = half @ half.T
        effective_dof, self.squares = np.empty((2, whole.n))
        for j, joint in enumerate(whole.joints):
            rows, side = joint.R[0, :, :-1], joint.R[0, :, -1]
            self.squares[j] = np.sum((side - rows @ self.values[joint.parameters]) ** 2)
            effective_dof[j] = weights[j] ** 2 * np.sum((rows @ half[joint.parameters]) ** 2)
        self.deviation = np.sqrt(self.squares / np.maximum(whole.rows[0] - effective_dof, 1.0))


def _iterate_weights(
    whole: Information, unknowns: _Unknowns, weights: Array, values: Array, scale: Array
) -> tuple[Array, Array, Array]:
    """Repeats solutions with new weights until they converge: weights (n,), parameters (c,) and scales (n,)."""
    torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
    floor = RESOLUTION * torque / np.sqrt(np.maximum(whole.rows[0], 1))
    floor[torque == 0.0] = 1.0
    for _ in range(ITERATIONS):
        determined = _restrict_to_determined(_linearise(whole, unknowns, values, scale), unknowns.prior, weights)
        solved = _WeightedSolution(total(determined.information), determined.prior, weights)
        estimate = determined.basis @ solved.values
        values = unknowns.known.copy()
        values[unknowns.free] = estimate[: unknowns.count]
        deviation = np.maximum(solved.deviation, floor)
        settled = bool((np.abs(deviation - 1.0 / weights) <= TOLERANCE / weights + floor).all())
        weights = 1.0 / deviation
        if unknowns.scaled:
            settled &= bool((np.abs(estimate[unknowns.count :] - scale) <= TOLERANCE).all())
            scale = estimate[unknowns.count :]
        if settled:
            return weights, values, scale
    raise EstimationError(
        f"The weights of the joints and the scales of their torques did not converge in {ITERATIONS} iterations.",
        remedy="record a longer motion, or give the key `drive_gain_deviation`, so that the gains stay near the "
        "given values.",
    )


def _solution_with_covariance(
    stacked: StackedProblem, unknowns: _Unknowns, weights: Array, values: Array, scale: Array
) -> JointSolution:
    """Makes the solution of a stacked problem, with its covariance, from converged weights, parameters and scales."""
    determined = _restrict_to_determined(
        _linearise(stacked.information, unknowns, values, scale), unknowns.prior, weights
    )
    basis, undetermined, P = determined.basis, determined.undetermined, determined.prior[:, :-1]
    solved = _WeightedSolution(total(determined.information), determined.prior, weights)
    fit = _fit_with_covariance(stacked, unknowns, determined, solved, weights, values, scale)
    size, n, count = len(values), determined.information.n, unknowns.count
    scale_effect = np.zeros((size, n))
    if not unknowns.scaled:
        side_change = (
            basis.T @ right_hand_sides(total(stacked.information), weights)[unknowns.free]
            + P.T @ stacked.scale_sensitivity
        )
        scale_effect[unknowns.free] = basis @ (solved.inverse @ side_change)
        scale_effect *= stacked.information.scale_deviation
    every = basis @ fit.covariance @ basis.T
    scales = every[count:, count:] if unknowns.scaled else np.zeros((n, n))
    no_scale = np.zeros(n, dtype=np.bool_)
    if unknowns.scaled:
        no_scale |= (undetermined[:, count:] != 0.0).any(axis=0)
    white = _among_all(basis @ solved.inverse @ basis.T, unknowns)
    lifted = np.zeros((len(undetermined), size))
    lifted[:, unknowns.free] = undetermined[:, :count]
    freedom = np.full(size + n, np.min(fit.freedom))
    if not len(undetermined):  # otherwise the parameters of the fit are combinations of the unknowns
        each = np.broadcast_to(fit.freedom, (basis.shape[1],))
        freedom[:size][unknowns.free] = each[:count]
        freedom[size:] = each[count:] if unknowns.scaled else freedom[size:]
    if len(fit.report.moved):
        moved = np.zeros(size)
        moved[unknowns.free] = (basis @ fit.report.moved)[:count]
        fit = replace(fit, report=replace(fit.report, moved=moved))
    return JointSolution(
        values, _among_all(every, unknowns), white, scale_effect, lifted, scale, scales, no_scale, freedom, fit
    )


def _fit_with_covariance(
    stacked: StackedProblem,
    unknowns: _Unknowns,
    determined: _Determined,
    solved: _WeightedSolution,
    weights: Array,
    values: Array,
    scale: Array,
) -> Fit:
    """Fit in the coordinates z that data and prior determine, with its covariance.

    The covariance is computed from the samples if possible, otherwise from the factors.
    """
    fit = _fit(determined, solved, weights)
    if stacked.samples is None:
        return estimate_covariance(fit, determined.information)
    earlier, prior = stacked.earlier, unknowns.prior[:, :-1]
    prior_rows, rows, own = prior @ determined.basis, np.zeros((0, determined.basis.shape[1])), np.zeros((0, 0))
    is_new = np.ones(stacked.information.blocks, dtype=np.bool_)
    if earlier is not None:
        is_new = ~earlier.blocks
        first, last = stacked.prior.shape[0] - earlier.prior, stacked.prior.shape[0]
        whole = total(select(stacked.information, earlier.blocks))
        rows = (
            np.vstack([_whitened_rows(whole, unknowns, weights, values, scale), prior[first:last]]) @ determined.basis
        )
        prior_rows = np.delete(prior, np.s_[first:last], axis=0) @ determined.basis
        own = np.vstack([stack(whole, weights)[0], stacked.prior[first:last, :-1]]) @ earlier.selection.T
    column_maps: list[Array] = []
    for j in range(stacked.information.n):
        slope = scale[j] * stacked.to_new[:, unknowns.free]
        if unknowns.scaled:
            scale_columns = np.zeros((len(slope), stacked.information.n))
            scale_columns[:, j] = stacked.to_new @ values
            slope = np.hstack([slope, scale_columns])
        column_maps.append(slope @ determined.basis)
    remaining = prior_information(prior_rows, rows, own, earlier, solved.inverse)
    joint_values = np.outer(scale, stacked.to_new @ values)
    return JointCovariance(
        fit, stacked.samples, select(determined.information, is_new), remaining, column_maps, joint_values
    ).with_covariance()


def _whitened_rows(whole: Information, unknowns: _Unknowns, weights: Array, values: Array, scale: Array) -> Array:
    """Whitened rows of all blocks for the u unknowns, shape (m, u), linearised at the solution."""
    A = stack(whole, weights)[0]
    joint = np.concatenate([np.full(len(each.R[0]), j) for j, each in enumerate(whole.joints)])
    slopes = scale[joint][:, None] * A[:, unknowns.free]
    if not unknowns.scaled:
        return slopes
    return np.hstack([slopes, (A @ values)[:, None] * (joint[:, None] == np.arange(whole.n))])


def _fit(determined: _Determined, solved: _WeightedSolution, weights: Array) -> Fit:
    """Fit in the coordinates z that data and prior determine, with the covariance for white residuals."""
    whole = total(determined.information)
    rows, P = whole.rows[0], determined.prior[:, :-1]
    unweighted = stack(whole)[0]
    return Fit(
        whole.names,
        solved.values,
        np.sqrt(np.diag(solved.inverse)),
        solved.inverse,
        "white",
        max(float(rows.sum()) - len(solved.values), 1.0),
        np.sqrt(solved.squares / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
        weights,
        P.T @ P,
    )


def _among_all(covariance: Array, unknowns: _Unknowns) -> Array:
    """Covariance (c, c) of all parameters from that of the unknowns (u, u); zero for known parameters."""
    whole = np.zeros((len(unknowns.free), len(unknowns.free)))
    whole[np.ix_(unknowns.free, unknowns.free)] = covariance[: unknowns.count, : unknowns.count]
    return whole

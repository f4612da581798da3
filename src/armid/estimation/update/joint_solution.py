"""Solve earlier and new recordings together, with the scales of the joints' torques where these are asked for.

    minimise Σ_j w_j² |ρ_j - s_j R_j x|² + |P x - p|²,        s_j = 1 unless estimated

A scale multiplies the model and not the measured torque: a column of measured torque would carry its noise into the
regressor, and the scale would come out wrong by the share of noise in the torque.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError
from armid.estimation.fit import Fit
from armid.estimation.together import Together, rest_of
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.update.stacked_problem import StackedProblem, scores, triangular
from armid.information.information import Information, JointFactors, select, stack, total
from armid.maths.linalg import condition, null_directions, scaled_condition, unit_columns
from armid.values import Array

__all__ = ["JointSolution", "solve_joined"]

STANDSTILL = 1e-9
"""Largest relative change of weights and scales that ends the iteration: far below any effect on the estimate."""

RESOLUTION = 1e-7
"""Smallest residual over torque that counts as noise: larger weights, which only data without noise would have, would
leave the other joints and what was known beforehand no digits."""

ITERATIONS = 200

PART = 1e-6
"""Share of its largest entry, columns of unit length, below which an entry of an unseen direction is rounding."""


@dataclass(frozen=True, eq=False, slots=True)
class JointSolution:
    """Solution of a joined problem.

    Attributes:
        values: The unknowns, shape (c,).
        covariance: Theirs, scales of torque taken as exact or estimated, shape (c, c).
        white: The same as if residuals were white, shape (c, c).
        moves: Change of the unknowns with one standard deviation of each joint's torque scale, shape (c, n).
        unseen: Directions of the unknowns that nothing determines, shape (u, c).
        scale: Measured torque over the model's, shape (n,); ones unless estimated.
        scale_covariance: Covariance of the scales, shape (n, n); zero unless estimated.
        unseen_scale: Whether nothing determines a scale, shape (n,).
        freedom: Degrees of freedom of the unknowns and the scales, shape (c + n,).
        fit: Weights, residuals, and how the covariance was made; moves by reversals are those of the c unknowns.
    """

    values: Array
    covariance: Array
    white: Array
    moves: Array
    unseen: Array
    scale: Array
    scale_covariance: Array
    unseen_scale: NDArray[np.bool_]
    freedom: Array
    fit: Fit

    @property
    def whole_covariance(self) -> Array:
        """Covariance with the uncertain scales of torque, shape (c, c)."""
        return self.covariance + self.moves @ self.moves.T


def solve_joined(
    joined: StackedProblem, *, scale_deviation: Array | None = None, fixed: Array | None = None
) -> JointSolution:
    """Solve with one weight a joint, found by iteration as in weighted least squares.

    Args:
        joined: The problem.
        scale_deviation: How far the scales may be from one, shape (n,), infinite where nothing is known; where this
            is given, the scales are unknowns too.
        fixed: Known parameters of the load, NaN where they are not, shape (10,).

    Raises:
        EstimationError: Weights or scales do not settle.
    """
    count, n = joined.information.count, joined.information.n
    known, free = np.zeros(count), np.ones(count, dtype=np.bool_)
    if fixed is not None:
        known[joined.load], free[joined.load] = np.nan_to_num(fixed), np.isnan(fixed)
    side = joined.prior[:, -1] - joined.prior[:, :-1] @ known
    plain = _Unknowns(known, free, np.column_stack([joined.prior[:, :-1][:, free], side]), scaled=False)
    whole = total(joined.information)
    weights, values, scale = _iterate(whole, plain, joined.weights, known, np.ones(n))
    if scale_deviation is None:
        return _solved(joined, plain, weights, values, scale)
    tight = np.flatnonzero(np.isfinite(scale_deviation))
    rows = np.zeros((len(tight), plain.count + n + 1))
    rows[np.arange(len(tight)), plain.count + tight] = rows[:, -1] = 1.0 / scale_deviation[tight]
    # An earlier estimate moves with the true torque, 1 / s of the measured: its rows say P x + moves (s - 1) = p.
    side = plain.prior[:, -1] + joined.moves.sum(axis=1)
    with_scales = np.column_stack([plain.prior[:, :-1], joined.moves, side])
    unknowns = replace(plain, prior=np.vstack([with_scales, rows]), scaled=True)
    return _solved(joined, unknowns, *_iterate(whole, unknowns, weights, values, scale))


@dataclass(frozen=True, eq=False, slots=True)
class _Unknowns:
    """Unknowns among the c parameters, and what is known beforehand.

    Attributes:
        known: Values of those that are known, zero elsewhere, shape (c,).
        free: Which are unknown, u of them, shape (c,).
        prior: Whitened rows about the unknowns and the scales, side last, shape (k, u + 1) or (k, u + n + 1).
        scaled: Whether the scales are unknowns, after the parameters.
    """

    known: Array
    free: NDArray[np.bool_]
    prior: Array
    scaled: bool

    @property
    def count(self) -> int:
        """Number of unknown parameters u."""
        return int(self.free.sum())


def _linear(information: Information, unknowns: _Unknowns, values: Array, scale: Array) -> Information:
    """The problem in its unknowns, linear about values (c,) and scales (n,): s R x' + s' R x = ρ + s R x."""
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
class _Seen:
    """The problem in coordinates z that the data see, x = basis · z.

    Attributes:
        information: Factors in z.
        prior: Whitened rows in z, side last, shape (k, r + 1).
        basis: Shape (u, r).
        unseen: Directions of x that nothing determines, shape (d, u).
    """

    information: Information
    prior: Array
    basis: Array
    unseen: Array


def _seen(linear: Information, prior: Array, weights: Array) -> _Seen:
    """The problem without the directions that neither the data nor the prior determine."""
    A = np.vstack([stack(total(linear), weights)[0], prior[:, :-1]])
    length = unit_columns(A)[1]
    directions = null_directions(A)
    if not len(directions):
        return _Seen(linear, prior, np.eye(len(length)), directions)
    directions = np.where(np.abs(directions) > PART * np.abs(directions).max(axis=1, keepdims=True), directions, 0.0)
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
    return _Seen(information, rows, basis, directions / length)


class _Least:
    """Least squares on factors and prior for one set of weights.

    Attributes:
        values: Shape (r,).
        inverse: Inverse of the weighted normal equations, prior included, shape (r, r).
        squares: Sum of squared residuals of each joint, unweighted, shape (n,).
        deviation: Standard deviation of each joint's residual, degrees of freedom paid, shape (n,).
    """

    def __init__(self, whole: Information, prior: Array, weights: Array) -> None:
        A, y = stack(whole, weights)
        scaled, length = unit_columns(np.vstack([A, prior[:, :-1]]))
        Q, R = np.linalg.qr(scaled)
        self.values = np.linalg.solve(R, Q.T @ np.concatenate([y, prior[:, -1]])) / length
        half = np.linalg.inv(R) / length[:, None]
        self.inverse = half @ half.T
        spent, self.squares = np.empty((2, whole.n))
        for j, joint in enumerate(whole.joints):
            rows, side = joint.R[0, :, :-1], joint.R[0, :, -1]
            self.squares[j] = np.sum((side - rows @ self.values[joint.parameters]) ** 2)
            spent[j] = weights[j] ** 2 * np.sum((rows @ half[joint.parameters]) ** 2)
        self.deviation = np.sqrt(self.squares / np.maximum(whole.rows[0] - spent, 1.0))


def _iterate(
    whole: Information, unknowns: _Unknowns, weights: Array, values: Array, scale: Array
) -> tuple[Array, Array, Array]:
    """Weights (n,), parameters (c,) and scales (n,) that reproduce themselves."""
    torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
    floor = RESOLUTION * torque / np.sqrt(np.maximum(whole.rows[0], 1))
    floor[torque == 0.0] = 1.0
    for _ in range(ITERATIONS):
        seen = _seen(_linear(whole, unknowns, values, scale), unknowns.prior, weights)
        least = _Least(total(seen.information), seen.prior, weights)
        found = seen.basis @ least.values
        values = unknowns.known.copy()
        values[unknowns.free] = found[: unknowns.count]
        deviation = np.maximum(least.deviation, floor)
        settled = bool((np.abs(deviation - 1.0 / weights) <= STANDSTILL / weights + floor).all())
        weights = 1.0 / deviation
        if unknowns.scaled:
            settled &= bool((np.abs(found[unknowns.count :] - scale) <= STANDSTILL).all())
            scale = found[unknowns.count :]
        if settled:
            return weights, values, scale
    raise EstimationError(
        f"Weights of the joints and scales of their torques did not settle in {ITERATIONS} iterations.",
        remedy="record a longer motion, or give drive_gain_deviation so that the gains stay near what is given.",
    )


def _solved(
    joined: StackedProblem, unknowns: _Unknowns, weights: Array, values: Array, scale: Array
) -> JointSolution:
    """The solution with its covariance from all blocks."""
    seen = _seen(_linear(joined.information, unknowns, values, scale), unknowns.prior, weights)
    basis, unseen, P = seen.basis, seen.unseen, seen.prior[:, :-1]
    least = _Least(total(seen.information), seen.prior, weights)
    fit = _covered(joined, unknowns, seen, least, weights, values, scale)
    size, n, count = len(values), seen.information.n, unknowns.count
    moves = np.zeros((size, n))
    if not unknowns.scaled:
        pull = basis.T @ scores(total(joined.information), weights)[unknowns.free] + P.T @ joined.moves
        moves[unknowns.free] = basis @ (least.inverse @ pull)
        moves *= joined.information.scale_deviation
    every = basis @ fit.covariance @ basis.T
    scales = every[count:, count:] if unknowns.scaled else np.zeros((n, n))
    blind = np.zeros(n, dtype=np.bool_)
    if unknowns.scaled:
        blind |= (unseen[:, count:] != 0.0).any(axis=0)
    white = _among_all(basis @ least.inverse @ basis.T, unknowns)
    left = np.zeros((len(unseen), size))
    left[:, unknowns.free] = unseen[:, :count]
    freedom = np.full(size + n, np.min(fit.freedom))
    if not len(unseen):  # else the fit's parameters are other combinations
        each = np.broadcast_to(fit.freedom, (basis.shape[1],))
        freedom[:size][unknowns.free] = each[:count]
        freedom[size:] = each[count:] if unknowns.scaled else freedom[size:]
    if len(fit.report.moved):
        moved = np.zeros(size)
        moved[unknowns.free] = (basis @ fit.report.moved)[:count]
        fit = replace(fit, report=replace(fit.report, moved=moved))
    return JointSolution(values, _among_all(every, unknowns), white, moves, left, scale, scales, blind, freedom, fit)


def _covered(
    joined: StackedProblem,
    unknowns: _Unknowns,
    seen: _Seen,
    least: _Least,
    weights: Array,
    values: Array,
    scale: Array,
) -> Fit:
    """The solution in z with its covariance: from samples where these are at hand, or else from factors."""
    fit = _fit(seen, least, weights)
    if joined.samples is None:
        return estimate_covariance(fit, seen.information)
    earlier, prior = joined.earlier, unknowns.prior[:, :-1]
    ties, rows, own = prior @ seen.basis, np.zeros((0, seen.basis.shape[1])), np.zeros((0, 0))
    is_new = np.ones(joined.information.blocks, dtype=np.bool_)
    if earlier is not None:
        is_new = ~earlier.blocks
        first, last = joined.prior.shape[0] - earlier.prior, joined.prior.shape[0]
        whole = total(select(joined.information, earlier.blocks))
        rows = np.vstack([_slopes(whole, unknowns, weights, values, scale), prior[first:last]]) @ seen.basis
        ties = np.delete(prior, np.s_[first:last], axis=0) @ seen.basis
        own = np.vstack([stack(whole, weights)[0], joined.prior[first:last, :-1]]) @ earlier.pick.T
    through: list[Array] = []
    for j in range(joined.information.n):
        slope = scale[j] * joined.to_new[:, unknowns.free]
        if unknowns.scaled:
            further = np.zeros((len(slope), joined.information.n))
            further[:, j] = joined.to_new @ values
            slope = np.hstack([slope, further])
        through.append(slope @ seen.basis)
    rest = rest_of(ties, rows, own, earlier, least.inverse)
    shown = np.outer(scale, joined.to_new @ values)
    return Together(fit, joined.samples, select(seen.information, is_new), rest, through, shown).covered()


def _slopes(whole: Information, unknowns: _Unknowns, weights: Array, values: Array, scale: Array) -> Array:
    """Whitened rows in the unknowns, shape (m, u), as `_linear` has them, not made triangular."""
    A = stack(whole, weights)[0]
    joint = np.concatenate([np.full(len(each.R[0]), j) for j, each in enumerate(whole.joints)])
    slopes = scale[joint][:, None] * A[:, unknowns.free]
    if not unknowns.scaled:
        return slopes
    return np.hstack([slopes, (A @ values)[:, None] * (joint[:, None] == np.arange(whole.n))])


def _fit(seen: _Seen, least: _Least, weights: Array) -> Fit:
    """The solution in z as a fit, residuals taken as white."""
    whole = total(seen.information)
    rows, P = whole.rows[0], seen.prior[:, :-1]
    unweighted = stack(whole)[0]
    return Fit(
        whole.names,
        least.values,
        np.sqrt(np.diag(least.inverse)),
        least.inverse,
        "white",
        max(float(rows.sum()) - len(least.values), 1.0),
        np.sqrt(least.squares / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
        weights,
        P.T @ P,
    )


def _among_all(covariance: Array, unknowns: _Unknowns) -> Array:
    """Covariance (c, c) of all parameters; those that are known have none."""
    whole = np.zeros((len(unknowns.free), len(unknowns.free)))
    whole[np.ix_(unknowns.free, unknowns.free)] = covariance[: unknowns.count, : unknowns.count]
    return whole

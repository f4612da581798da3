"""Recursive least squares with forgetting: the state of the estimate is updated block by block.

The state is square-root information [Bierman1977]: factors of each joint's rows, discounted by λ = exp(-Δt/τ), and
whitened rows of information that must not be forgotten (`armid.estimation.recursive.forgetting`) or that was given
initially. Blocks are merged as in batch estimation, so that without forgetting the result is the batch estimate. The
size of the state and the computing time for each block are constant.

Forgetting changes neither the estimate nor its errors, so the covariance P changes only by new rows,

    P' = (1 - X G) P (1 - X G)ᵀ + X S X,        X = H'⁻¹,

Here G is the normal matrix of the block, H' the normal matrix of all stored information including the block, and S
the covariance of the gradient of the block. S is the sum over the joints of the part of G from the rows of the joint,
times a factor: the variance of the gradients of this joint divided by the variance for white noise. The factor
includes the correlation with the previous block. P is stored as a factor L with P = L Lᵀ. Its update stacks (1 - X G)
L and X A_jᵀ for the whitened rows A_j of each joint and makes the result square by an orthogonal transformation, so
that no variance becomes negative [Bierman1977].
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import EstimationError
from armid.estimation.fit_result import CovarianceReport, Fit
from armid.estimation.recursive.forgetting import discount, retained_rows
from armid.estimation.recursive.innovations import after_a_gap, normalized_innovation, update_noise_color
from armid.estimation.recursive.state import JUMP, ForgettingOptions, Innovations, RecursiveState
from armid.estimation.uncertainty.jackknife import blend_with_textbook
from armid.estimation.whitened_system import RESOLUTION, minimum_norm_solution
from armid.information.information import Information, JointFactors, merge, stack, total
from armid.kernel import factor_columns
from armid.maths.linalg import condition, inverse_of, scaled_condition
from armid.maths.median import median

ITERATIONS = 1000
STANDSTILL = 1e-9
"""Largest relative change of the standard deviation of a joint's residual at which the iteration of the weights ends,
as in weighted least squares."""

ENOUGH = 1.5
"""Smallest ratio of the number of rows to the sum of their leverages at which the residual is used to estimate the
noise."""

FIRST = 10.0
"""Number of blocks to which the noise level and the correlation of an earlier run are equivalent."""


def begin(
    block: Information, memory: ForgettingOptions | None = None, *, weights: Array | None = None
) -> RecursiveState:
    """Creates the state of a recursive estimate before the first block: it contains no information.

    Args:
        block: Example of a block, from which names and indices of the parameters are taken; its rows are not used.
        memory: Options of forgetting; if not given, nothing is forgotten.
        weights: One divided by the standard deviation of the noise of each joint, shape (n,); if not given, the
            weights are computed from the residuals.
    """
    b, n, zero = block.count, block.n, np.zeros(block.n)
    joints = tuple(JointFactors(joint.parameters, np.zeros((1, *joint.R.shape[1:]))) for joint in block.joints)
    given = np.ones(n) if weights is None else array(weights, (n,), "weights")
    stats = Innovations(zero, np.ones(n), zero, np.zeros((n, b)), zero, zero)
    empty = np.zeros((b, b + 1))
    chosen = _checked(memory or ForgettingOptions(), b)
    return RecursiveState(block.names, joints, zero, empty, given, weights is not None, empty, None, chosen, stats)


def resume(
    block: Information,
    earlier: Fit,
    memory: ForgettingOptions | None = None,
    *,
    further: Array | None = None,
    factors: Information | None = None,
) -> RecursiveState:
    """Creates a state from an earlier estimate with its covariance and the noise level of each joint.

    The ratio of the covariance of the earlier estimate to the covariance for white residuals is the number of
    correlated rows that count as one independent row. The weights of new rows are divided by the square root of this
    number.

    Args:
        block: Example of a block, from which names and indices of the parameters are taken.
        earlier: The earlier estimate; its parameters must be among those of the block.
        memory: Options of forgetting.
        further: Standard deviations of the m parameters of the blocks that the estimate does not contain, shape (m,);
            the earlier values of these parameters are zero.
        factors: Information from which the earlier estimate was computed. If a covariance was computed from few
            periods or blocks, its rank is low, as if the estimate were exact in the other directions. If the factors
            are given, such a covariance is blended with the covariance for white residuals.

    Raises:
        EstimationError: The estimate has other parameters than the blocks.
    """
    extra = np.zeros(0) if further is None else further
    if earlier.names != block.names[: block.count - len(extra)]:
        raise EstimationError(
            "The parameters of the earlier estimate differ from those of the new blocks.",
            remedy="use the model of the earlier run; if the run has separate friction for each recording, merge "
            "it into one friction first.",
        )
    textbook = earlier.white_deviation**2
    known = textbook > 0.0
    ratio = np.diag(earlier.covariance)[known] / textbook[known]
    inflation = max(float(median(ratio)), 1.0) if known.any() else 1.0
    start = begin(block, memory, weights=earlier.weights / np.sqrt(inflation))
    covariance = np.diag(np.concatenate([np.zeros(len(earlier.values)), extra**2]))
    covariance[: len(earlier.values), : len(earlier.values)] = _definite(earlier, factors)
    root = _root_of_inverse(covariance)
    kept = _triangle(np.column_stack([root, root[:, : len(earlier.values)] @ earlier.values]))
    first = np.full(block.n, FIRST)
    stats = replace(start.innovations, level=1.0 / inflation + 0.0 * first, blocks=first, power=first, expected=first)
    jump = JUMP * np.sqrt(np.diag(covariance)) if start.memory.jump is None else start.memory.jump
    forgets = replace(start.memory, jump=jump)
    return replace(start, whitened_rows=kept, whole=kept, root=_root(covariance), memory=forgets, innovations=stats)


def _definite(earlier: Fit, factors: Information | None) -> Array:
    """Covariance of an earlier estimate, shape (b, b), changed to have full rank if the factors are given."""
    if factors is None or earlier.covariance_kind not in ("period", "block"):
        return earlier.covariance
    A = stack(total(factors), earlier.weights)[0]
    prior = np.zeros_like(earlier.covariance) if earlier.prior_precision is None else earlier.prior_precision
    return blend_with_textbook(earlier.covariance, inverse_of(A.T @ A + prior), float(np.min(earlier.freedom)))


def update(state: RecursiveState, block: Information, seconds: float) -> RecursiveState:
    """Updates a state with new rows.

    Args:
        state: State before the rows.
        block: Information of the new rows; its blocks are merged first.
        seconds: Time from the last update to this one [s].

    Raises:
        EstimationError: The rows have other parameters than the state, or the time is negative.
    """
    if not seconds >= 0.0:
        raise EstimationError(f"The time from one block to the next must not be negative; found {seconds:g} s.")
    new = total(block)
    if not new.rows.any():  # nothing is excited, so nothing is forgotten
        return replace(state, innovations=after_a_gap(state.innovations))
    values = state.values
    error = normalized_innovation(state, values, new)
    changed = bool((error[1] >= state.memory.renewal).any())
    factor = float(np.exp(-seconds / state.memory.seconds))
    if changed:
        state = _after_change(state)
    both = merge([state.information, new])
    rows = factor * state.rows + new.rows[0]
    joints = tuple(_discounted(old, fresh, factor) for old, fresh in zip(state.joints, new.joints, strict=True))
    after = replace(both, joints=joints, rows=both.rows[:1], run=both.run[:1], recording=both.recording[:1])
    kept = np.sqrt(factor) * state.whitened_rows
    if factor < 1.0:
        A, y = stack(new, state.weights)
        retained = retained_rows(state.whole, _triangle(np.column_stack([A, y])), 1.0 - factor, _changing(state))
        kept = _triangle(np.vstack([kept, retained]))
    weights = state.weights if state.fixed else _next_weights(state, after, rows, kept)
    whole = _whole(after, kept, weights)
    moved = replace(state, joints=joints, rows=rows, whitened_rows=kept, weights=weights, whole=whole)
    _, half, unseen = minimum_norm_solution(*_parted(whole))
    if len(unseen):
        return moved
    if state.memory.jump is None:
        jump = JUMP * np.sqrt(np.sum(half**2, axis=1))
        moved = replace(moved, memory=replace(state.memory, jump=jump))
    stats = update_noise_color(replace(state, weights=weights), values, new, half, error, factor, usual=not changed)
    return replace(moved, root=_spread(state, weights, new, half), innovations=stats)


def fit(state: RecursiveState) -> Fit:
    """Makes the fit of a state; without forgetting, the estimate equals weighted least squares.

    Raises:
        EstimationError: The rows that were added do not determine every parameter.
    """
    covariance = state.covariance
    if covariance is None:
        unseen = minimum_norm_solution(state.whole[:, :-1], state.whole[:, -1])[2]
        raise EstimationError(
            f"The rows that were added so far determine only {len(state.names) - len(unseen)} of {len(state.names)} "
            "parameters.",
            remedy="add more blocks, move more joints, or begin with the estimate of an earlier run.",
        )
    data = state.information
    weights = state.weights if state.fixed else _settled(state, data)
    values, half, _ = minimum_norm_solution(*_parted(_whole(data, state.whitened_rows, weights)))
    squares, effective = _residual_statistics(data, values, weights, half)
    A = stack(data)[0]
    c = state.innovations.correlation
    free = np.maximum(state.rows - effective, 1.0)
    known = state.whitened_rows[:, :-1].T @ state.whitened_rows[:, :-1]
    reason = f"the variance of the blocks' gradients is {c.min():.3g} to {c.max():.3g} times that of white noise"
    return Fit(
        state.names,
        values,
        np.sqrt(np.sum(half**2, axis=1)),
        covariance,
        "recursive",
        max(float(np.sum(state.innovations.expected)), 1.0),
        np.sqrt(squares / np.where(state.rows > 0.0, state.rows, 1.0)),
        data.rows[0],
        condition(A),
        scaled_condition(A),
        weights,
        known if known.any() else None,
        CovarianceReport(reason, noise=np.where(state.rows >= 1.0, np.sqrt(squares / free), 1.0 / weights)),
    )


def _checked(memory: ForgettingOptions, b: int) -> ForgettingOptions:
    for name in ("changing", "jump"):
        given = getattr(memory, name)
        if given is not None and np.shape(given) != (b,):
            raise EstimationError(
                f"ForgettingOptions.{name} must have shape ({b},); found {np.shape(given)}.",
                remedy="give one value for each base parameter of the blocks.",
            )
    return memory


def _changing(state: RecursiveState) -> NDArray[np.bool_]:
    given = state.memory.changing
    return np.ones(len(state.names), dtype=np.bool_) if given is None else given


def _triangle(rows: Array) -> Array:
    """Triangular factor (b, b + 1) of rows whose last column is the right-hand side.

    The row of the residual is left out.
    """
    return factor_columns(np.ascontiguousarray(rows.T))[0][:-1]


def _parted(whole: Array) -> tuple[Array, Array]:
    return whole[:, :-1], whole[:, -1]


def _whole(data: Information, kept: Array, weights: Array) -> Array:
    """Triangular factor of all whitened rows, right-hand side last, shape (b, b + 1).

    Args:
        data: Factors of the joints' rows.
        kept: Whitened rows of retained and initial information, shape (b, b + 1).
        weights: Weights of the rows of each joint, shape (n,).
    """
    A, y = stack(data, weights)
    return _triangle(np.vstack([np.column_stack([A, y]), kept]))


def _discounted(old: JointFactors, new: JointFactors, factor: float) -> JointFactors:
    """Merges old and new factors of one joint, after the old factors are multiplied by the discount factor."""
    rows = np.vstack([np.sqrt(factor) * old.R[0], new.R[0]])
    return JointFactors(old.parameters, factor_columns(rows.T))


def _root(covariance: Array) -> Array:
    """Factor L (b, b) of a covariance L Lᵀ; eigenvalues that rounding has made negative are set to zero."""
    size, share, directions = _scaled_eigenvalues(covariance)
    return size[:, None] * directions * np.sqrt(np.maximum(share, 0.0))


def _root_of_inverse(covariance: Array) -> Array:
    """Square root of the inverse of a covariance (b, b), computed with the correlation matrix for accuracy."""
    size, share, directions = _scaled_eigenvalues(covariance)
    return (directions / np.sqrt(np.maximum(share, np.finfo(np.float64).eps * share[-1]))).T / size


def _scaled_eigenvalues(covariance: Array) -> tuple[Array, Array, Array]:
    """Standard deviations of a covariance (b, b), and eigenvalues and eigenvectors of its correlation matrix."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    share, directions = np.linalg.eigh(covariance / np.outer(size, size))
    return size, share, directions


def _residual_statistics(data: Information, values: Array, weights: Array, half: Array) -> tuple[Array, Array]:
    """Sum of squared residuals of each joint, unweighted, and sum of the leverages of its rows, shape (n,) each.

    Args:
        data: Factors of the joints' rows, one block.
        values: Parameters, shape (b,).
        weights: Weights of the rows of each joint, shape (n,).
        half: Square root of the inverse normal matrix, shape (b, b).
    """
    squares, effective = np.empty((2, data.n))
    for j, joint in enumerate(data.joints):
        R = joint.R[0]
        squares[j] = np.sum((R[:, -1] - R[:, :-1] @ values[joint.parameters]) ** 2)
        effective[j] = weights[j] ** 2 * np.sum((R[:, :-1] @ half[joint.parameters]) ** 2)
    return squares, effective


def _next_weights(state: RecursiveState, data: Information, rows: Array, kept: Array) -> Array:
    """Weights of the joints for the next iteration, shape (n,).

    A weight is one divided by the standard deviation of the joint's residual with the present weights. A joint with
    too few rows keeps its weight.

    Args:
        state: State with the present weights.
        data: Factors of the joints' rows.
        rows: Discounted number of rows of each joint, shape (n,).
        kept: Whitened rows of retained and initial information, shape (b, b + 1).
    """
    values, half, _ = minimum_norm_solution(*_parted(_whole(data, kept, state.weights)))
    squares, effective = _residual_statistics(data, values, state.weights, half)
    torque = np.array([np.sum(joint.R[0, :, -1] ** 2) for joint in data.joints])
    deviation = np.sqrt(np.maximum(squares, RESOLUTION**2 * torque) / np.maximum(rows - effective, 1.0))
    # Rows of a joint that has none for long are discounted below one; they leave its weight as it is.
    usable = (deviation > 0.0) & (rows > ENOUGH * effective) & (rows >= 1.0)
    return np.where(usable, 1.0 / np.where(usable, deviation, 1.0), state.weights)


def _settled(state: RecursiveState, data: Information) -> Array:
    """Weights (n,) of the rows of each joint, after the iteration has converged."""
    for _ in range(ITERATIONS):
        weights = _next_weights(state, data, state.rows, state.whitened_rows)
        if (np.abs(state.weights / weights - 1.0) <= STANDSTILL).all():
            return weights
        state = replace(state, weights=weights)
    raise EstimationError(
        f"The weights of the joints did not converge in {ITERATIONS} iterations.",
        remedy="give the argument `weights`, or begin with the estimate of an earlier run.",
    )


def _after_change(state: RecursiveState) -> RecursiveState:
    """State after a sudden change of parameters: all information is moved to `whitened_rows` and discounted."""
    assert state.root is not None  # a block without a covariance before it shows no sudden change
    assert state.memory.jump is not None
    changing = _changing(state)
    kept = _triangle(discount(state.whole, changing, state.memory.jump))
    empty = tuple(JointFactors(joint.parameters, np.zeros_like(joint.R)) for joint in state.joints)
    root = _square(np.column_stack([state.root, np.diag(np.where(changing, state.memory.jump, 0.0))]))
    return replace(state, joints=empty, rows=np.zeros_like(state.rows), whitened_rows=kept, whole=kept, root=root)


def _spread(before: RecursiveState, weights: Array, new: Information, half: Array) -> Array:
    """Factor L of the covariance L Lᵀ of the estimate after new rows, shape (b, b).

    Args:
        before: State before the rows.
        weights: Weights of the rows of each joint, shape (n,).
        new: The new rows.
        half: Square root of the inverse normal matrix after the rows, shape (b, b).
    """
    if before.root is None:  # the noise counts as white until blocks have given its correlation
        return _square(half)
    X, b = half @ half.T, len(before.names)
    G, S = np.zeros((b, b)), []
    for weight, c, joint in zip(weights, before.innovations.correlation, new.joints, strict=True):
        A = weight * joint.R[0, :, :-1]
        G[np.ix_(joint.parameters, joint.parameters)] += A.T @ A
        S.append(np.sqrt(c) * (X[:, joint.parameters] @ A.T))
    return _square(np.column_stack([before.root - X @ (G @ before.root), *S]))


def _square(root: Array) -> Array:
    """Lower triangular factor (b, b) of the covariance root · rootᵀ, where `root` has shape (b, k) with k >= b."""
    R: Any = np.linalg.qr(root.T, mode="r")
    return R.T

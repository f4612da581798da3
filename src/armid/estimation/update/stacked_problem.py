"""New recordings beside an earlier estimate, as one least-squares problem.

What may have changed (friction, a tool, or all) has values of its own in the new recordings; the rest is shared. The
earlier recordings enter as the factors that they left, so made that the earlier estimate is their optimum: with the
prior that it was made with, and with what constraints had to say. Where factors and prior do not determine every
parameter, the estimate itself enters, with its covariance. The uncertainty of the earlier parameters, their
correlations, and the scales of torque that both have in common go into whatever is asked of the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.fit import Fit
from armid.estimation.per_recording import separate_by_recording
from armid.estimation.problem import EstimationProblem
from armid.information.information import Information, JointFactors, merge, select, stack, total
from armid.maths.linalg import null_directions, unit_columns
from armid.values import Array

__all__ = ["Earlier", "StackedProblem", "scores", "stack_problems", "triangular", "with_load_columns"]

SMALLEST_PRECISION = 1e-9
"""Smallest eigenvalue of a prior's precision, diagonal one, at which it still says something of every direction."""

LEAST_KNOWN = 1e-6
"""Smallest share of an earlier variance that is left when the scales' part is taken out: rounding of the rest."""


@dataclass(frozen=True, eq=False, slots=True)
class Earlier:
    """Errors of the earlier estimate, where its factors are among those of a joined problem.

    Attributes:
        blocks: Which blocks are its own, shape (blocks,).
        prior: Number of rows, the last of the prior's, that are its own prior's.
        pick: Its b' parameters = pick · x, shape (b', c).
        covariance: Their covariance by noise, without scales of torque and reversals, shape (b', b').
        freedom: Degrees of freedom of that, shape (b',).
        moved: What reversals move them by, shape (b',).
        reach: Share of that that counts as a deviation.
    """

    blocks: NDArray[np.bool_]
    prior: int
    pick: Array
    covariance: Array
    freedom: Array
    moved: Array
    reach: float


@dataclass(frozen=True, eq=False, slots=True)
class StackedProblem:
    """A least-squares problem of earlier and new recordings in c unknowns.

    Attributes:
        information: Factors of all blocks that count.
        prior: Whitened rows P with their side p in the last column, shape (k, c + 1).
        moves: Change of p with a unit relative error of each joint's torque scale, shape (k, n).
        before: Earlier base parameters = before · x, shape (b, c).
        after: Base parameters in the new recordings, without the load, = after · x, shape (b, c).
        load: Positions of the ten parameters of the load, shape (10,) or (0,).
        weights: Weights to begin with, shape (n,).
        to_new: Base parameters in the new recordings, the load in them, = to_new · x, shape (b, c).
        samples: The new recordings with their samples, where these are at hand.
        earlier: How the earlier estimate errs; `None` where it stands among the prior's rows.
    """

    information: Information
    prior: Array
    moves: Array
    before: Array
    after: Array
    load: NDArray[np.intp]
    weights: Array
    to_new: Array
    samples: EstimationProblem | None = None
    earlier: Earlier | None = None


def stack_problems(
    earlier: Information,
    fit: Fit,
    new: Information,
    own: NDArray[np.bool_],
    load: Array | None = None,
    samples: EstimationProblem | None = None,
) -> StackedProblem:
    """Put new recordings beside an earlier estimate.

    Args:
        earlier: Factors that the earlier estimate was made from.
        fit: The earlier estimate.
        new: Factors of the new recordings, about the same base parameters.
        own: Which of the b base parameters the new recordings have for themselves, shape (b,).
        load: Base parameters that each of ten further parameters adds in the new recordings, shape (b, 10).
        samples: The new recordings with their samples, about the base parameters.
    """
    copied = {name.split("[", 1)[0] for name in fit.names if "[" in name}  # friction of each earlier recording
    recording = earlier.recording if copied else np.zeros(earlier.blocks, dtype=np.int64)
    last = int(recording.max(initial=0)) + 1
    runs = new.run + 1 + int(earlier.run.max(initial=-1))
    both = merge([replace(earlier, recording=recording), replace(new, recording=np.full(new.blocks, last), run=runs)])
    changing = own | np.isin(both.names, list(copied))
    apart = separate_by_recording(both, changing)
    before, after = _maps(both.names, apart.names, changing, last)
    is_new = np.arange(both.blocks) >= earlier.blocks
    prior = _ties(earlier, before, after, changing)
    moves = np.zeros((len(prior), earlier.n))
    errs = None
    if fit.prior_precision is not None and _is_definite(fit.prior_precision):
        known = _as_believed(earlier, apart.names, fit)
        prior, moves = np.vstack([prior, known]), np.vstack([moves, np.zeros((len(known), earlier.n))])
        errs = _errors(earlier, apart.names, fit, ~is_new, len(known))
    elif _is_determined(earlier, fit):
        apart = _towards_estimate(apart, ~is_new, earlier, fit)
        errs = _errors(earlier, apart.names, fit, ~is_new, 0)
    else:
        known, known_moves = _as_estimated(earlier, apart.names, fit)
        prior, moves = np.vstack([prior, known]), np.vstack([moves, known_moves])
        apart, is_new = select(apart, is_new), np.ones(new.blocks, dtype=np.bool_)
    apart = replace(apart, scale_deviation=new.scale_deviation)
    if load is None:
        return StackedProblem(apart, prior, moves, before, after, np.arange(0), fit.weights, after, samples, errs)
    wide = None if errs is None else replace(errs, pick=np.hstack([errs.pick, np.zeros((len(errs.pick), 10))]))
    return StackedProblem(
        with_load_columns(apart, is_new, after.T @ load),
        np.insert(prior, [-1] * 10, 0.0, axis=1),
        moves,
        np.hstack([before, np.zeros((len(before), 10))]),
        np.hstack([after, np.zeros((len(after), 10))]),
        np.arange(apart.count, apart.count + 10),
        fit.weights,
        np.hstack([after, load]),
        samples,
        wide,
    )


def _maps(
    names: tuple[str, ...], apart: tuple[str, ...], changing: NDArray[np.bool_], last: int
) -> tuple[Array, Array]:
    """Matrices (b, c) from the unknowns to the base parameters before, their mean over recordings, and after."""
    position = {name: k for k, name in enumerate(apart)}
    before, after = np.zeros((2, len(names), len(apart)))
    for k, name in enumerate(names):
        if not changing[k]:
            before[k, position[name]] = after[k, position[name]] = 1.0
            continue
        own = f"{name}[{last + 1}]"
        copies = [position[other] for other in apart if other.split("[", 1)[0] == name and other != own]
        before[k, copies] = 1.0 / len(copies)
        after[k, position[own]] = 1.0
    return before, after


def _ties(earlier: Information, before: Array, after: Array, changing: NDArray[np.bool_]) -> Array:
    """Rows that hold what changes near what it was, so loosely that they count only where no data say more.

    One standard deviation is a change that by itself makes as much torque as the joint's whole torque was.
    """
    A, y = stack(total(earlier))
    length = np.linalg.norm(A, axis=0)
    torque = np.array([np.linalg.norm(y[A[:, k] != 0.0]) for k in range(len(length))])
    chosen = np.flatnonzero(changing & (torque > 0.0))
    rows = (after - before)[chosen] * (length / np.where(torque > 0.0, torque, 1.0))[chosen, None]
    return np.column_stack([rows, np.zeros(len(rows))])


def _is_determined(earlier: Information, fit: Fit) -> bool:
    """Tell whether the factors alone determine every parameter."""
    return not len(null_directions(stack(total(earlier), fit.weights)[0]))


def _towards_estimate(apart: Information, old: NDArray[np.bool_], earlier: Information, fit: Fit) -> Information:
    """The earlier blocks with torques moved so that the earlier estimate is their optimum, residuals as they were.

    Nothing moves where it was least squares; it does where constraints or weights of single rows had a say.
    """
    kept, pick = _of_estimate(earlier, apart.names, fit)
    order = [kept.names.index(name) for name in fit.names]
    A, y = stack(total(kept), fit.weights)
    A, length = unit_columns(A[:, order])
    missed = pick.T @ (np.linalg.lstsq(A, A @ (fit.values * length) - y)[0] / length)
    joints: list[JointFactors] = []
    for joint in apart.joints:
        R = np.array(joint.R)
        R[old, :, -1] += R[old, :, :-1] @ missed[joint.parameters]
        joints.append(JointFactors(joint.parameters, R))
    return replace(apart, joints=tuple(joints))


def _errors(earlier: Information, names: tuple[str, ...], fit: Fit, blocks: NDArray[np.bool_], prior: int) -> Earlier:
    """Errors of the earlier estimate: arguments as in `Earlier`, and names of the unknowns."""
    kept, pick = _of_estimate(earlier, names, fit)
    moves = _moves_of(kept, fit)[[kept.names.index(name) for name in fit.names]] * earlier.scale_deviation
    moved = fit.report.moved if len(fit.report.moved) == len(fit.names) else np.zeros(len(fit.names))
    reach = fit.report.reach
    covariance = fit.covariance - moves @ moves.T - reach**2 * np.outer(moved, moved)
    whole, left = np.diag(fit.covariance), np.maximum(np.diag(covariance), 0.0)
    # What was known for certain had no degrees of freedom to pay for.
    share = np.divide(left, whole, out=np.ones_like(left), where=whole > 0.0)
    return Earlier(blocks, prior, pick, covariance, np.maximum(fit.freedom * share**2, 1.0), moved, reach)


def _is_definite(precision: Array) -> bool:
    """Tell whether every direction has a precision, in units of its diagonal."""
    if not (np.diag(precision) > 0.0).all():
        return False
    size = np.sqrt(np.diag(precision))
    return bool(np.linalg.eigvalsh(precision / np.outer(size, size))[0] > SMALLEST_PRECISION)


def _of_estimate(earlier: Information, names: tuple[str, ...], fit: Fit) -> tuple[Information, Array]:
    """Earlier factors in the parameters of the estimate, and the matrix (b', c) from the unknowns to these."""
    copied = [name.split("[", 1)[0] for name in fit.names if "[" in name]
    kept = separate_by_recording(earlier, np.isin(earlier.names, copied)) if copied else earlier
    pick = np.zeros((len(fit.names), len(names)))
    position = {name: k for k, name in enumerate(names)}
    for k, name in enumerate(fit.names):  # without copies, what all earlier recordings share is the first copy
        pick[k, position[name] if name in position else position[f"{name}[1]"]] = 1.0
    return kept, pick


def _as_believed(earlier: Information, names: tuple[str, ...], fit: Fit) -> Array:
    """Whitened rows (b', c + 1) of the prior of the earlier estimate, which make it the optimum of its factors.

    Its mean π₀ follows from P (π - π₀) = -g, with g the slope of the data's cost. What constraints had to say becomes
    part of the mean.
    """
    assert fit.prior_precision is not None  # the caller has made sure
    kept, pick = _of_estimate(earlier, names, fit)
    order = [kept.names.index(name) for name in fit.names]
    A, y = stack(total(kept), fit.weights)
    A = A[:, order]
    slope = A.T @ (A @ fit.values - y)
    size = 1.0 / np.sqrt(np.diag(fit.prior_precision))
    half = np.linalg.cholesky(size[:, None] * fit.prior_precision * size).T
    side = half @ (fit.values / size) + np.linalg.solve(half.T, size * slope)
    return np.column_stack([(half / size) @ pick, side])


def _as_estimated(earlier: Information, names: tuple[str, ...], fit: Fit) -> tuple[Array, Array]:
    """Whitened rows (b', c + 1) that say what the earlier estimate says, and how scales of torque move their side."""
    kept, pick = _of_estimate(earlier, names, fit)
    unit = _moves_of(kept, fit)[[kept.names.index(name) for name in fit.names]]
    moves = unit * earlier.scale_deviation
    size = np.sqrt(np.diag(fit.covariance))
    size = np.where(size > 0.0, size, 1.0)
    share, directions = np.linalg.eigh((fit.covariance - moves @ moves.T) / np.outer(size, size))
    white = (directions / np.sqrt(np.maximum(share, LEAST_KNOWN * share[-1]))).T / size
    return np.column_stack([white @ pick, white @ fit.values]), white @ unit


def _moves_of(information: Information, fit: Fit) -> Array:
    """Change (b', n) of a least-squares estimate with a unit relative error of each joint's torque scale."""
    whole = total(information)
    A, length = unit_columns(stack(whole, fit.weights)[0])
    normal = A.T @ A
    if fit.prior_precision is not None:
        at = [fit.names.index(name) for name in whole.names]
        normal = normal + fit.prior_precision[np.ix_(at, at)] / np.outer(length, length)
    inverse = np.linalg.pinv(normal, hermitian=True) / np.outer(length, length)
    return inverse @ scores(whole, fit.weights)


def scores(whole: Information, weights: Array) -> Array:
    """w_j² R_jᵀ ρ_j of each joint, shape (c, n)."""
    pulls = np.zeros((whole.count, whole.n))
    for j, joint in enumerate(whole.joints):
        pulls[joint.parameters, j] = weights[j] ** 2 * (joint.R[0, :, :-1].T @ joint.R[0, :, -1])
    return pulls


def with_load_columns(information: Information, new: NDArray[np.bool_], added: Array) -> Information:
    """Ten more columns, those of a load.

    Args:
        information: Any number of blocks.
        new: Which of the blocks have the load, shape (blocks,).
        added: What each of its parameters adds to those that are there, shape (c, 10).
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
    """Square triangular factors (blocks, k, k) of rows (blocks, m, k)."""
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    return np.concatenate([R, np.zeros((len(R), R.shape[2] - R.shape[1], R.shape[2]))], axis=1)

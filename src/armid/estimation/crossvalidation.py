"""Error on rows that an estimate has not seen, from the factors of each block; no recording is read again.

Neighbouring rows err alike, so folds are stretches of neighbouring blocks: rows drawn at random would make every
method look as good as its fit. With R_j and ρ_j a joint's factor and right-hand side over the fold left out,

    error = Σ_j w_j² |ρ_j - R_j π|² / Σ_j M_j,        π from the other folds, M_j rows of joint j.

Blocks beside the fold do not train either: they know of it through the filter and the pose. Where each recording has
friction of its own, a fold has a part of every recording, so that no parameter is judged that no row has shown.

Where a motion repeats, the repetition left out is motion that the others have seen; the error then tells of noise and
drift, not of other motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.information.information import Information, merge, select, total

FOLDS = 5
"""Folds where nothing else is said: each estimate sees four fifths of the data, the usual compromise between the
bias of small training sets and folds that are too short to be unlike their neighbours [Hastie2009]."""


@dataclass(frozen=True, eq=False, slots=True)
class Fold:
    """A stretch that is left out, and the rest.

    Attributes:
        training: All other blocks as one, those beside the stretch excluded.
        held_out: The stretch as one block.
    """

    training: Information
    held_out: Information


def folds(information: Information, count: int = FOLDS) -> NDArray[np.int64]:
    """Fold of each block, shape (blocks,), counted from 0.

    A fold is a stretch of neighbouring blocks of one run. Longer runs are cut into more folds; runs far shorter than
    a fold join the run after them, or before them at the end. Blocks without a row that counts go with their
    neighbours. Where parameters have copies for each recording, `FV_1[2]`, a fold is one stretch of every recording.

    Args:
        information: Blocks in their order.
        count: Folds wanted; there are about as many, but no more than blocks, and at least one a long run.

    Raises:
        EstimationError: A recording with parameters of its own is too short to leave a part of it out.
    """
    rows = information.rows.sum(axis=1).astype(np.float64)
    if count > 1 and any(name.recording for name in information.names):
        return _parts_of_each(information, rows, count)
    fold = np.zeros(information.blocks, dtype=np.int64)
    first = 0
    for group in _long_runs(information.run, rows, count):
        share = rows[group].sum() / max(rows.sum(), 1.0)
        parts = min(max(1, round(count * share)), max(1, int(np.count_nonzero(rows[group]))))
        fold[group] = first + _stretches(rows[group], parts)
        first += parts
    return fold


def split(information: Information, fold: NDArray[np.int64]) -> tuple[Fold, ...]:
    """The information with each fold in turn left out; none where a fold would leave nothing to train on.

    Args:
        information: All blocks.
        fold: Fold of each block, shape (blocks,).
    """
    numbers = np.unique(fold)
    parts = [total(select(information, fold == k)) for k in numbers]
    result: list[Fold] = []
    for k, out in enumerate(parts):
        near = training_information(information, fold == numbers[k])
        rest: list[Information] = []
        for number, part in zip(numbers, parts, strict=True):
            kept = (fold == number) & ~near
            if number != numbers[k] and kept.any():
                untouched = not near[fold == number].any()
                rest.append(part if untouched else total(select(information, kept)))
        if not any(part.rows.any() for part in rest):
            return ()
        result.append(Fold(total(merge(rest)), out))
    return tuple(result)


def training_information(information: Information, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Blocks beside the chosen ones in the same run, which know of them through the filter and the pose.

    Args:
        information: Blocks in their order.
        chosen: Blocks that are left out, shape (blocks,).
    """
    same = information.run[1:] == information.run[:-1]
    near = np.zeros_like(chosen)
    near[1:] |= chosen[:-1] & same
    near[:-1] |= chosen[1:] & same
    return near & ~chosen


def held_out_squares(held_out: Information, values: Array) -> Array:
    """Sum of each joint's squared residuals for given parameters (b,), shape (n,) [(N·m)²]."""
    squares = np.empty(held_out.n)
    for j, joint in enumerate(held_out.joints):
        residual = joint.R[:, :, -1] - joint.R[:, :, :-1] @ values[joint.parameters]
        squares[j] = np.sum(residual**2)
    return squares


def held_out_error(held_out: Information, values: Array, weights: Array) -> float:
    """Weighted mean square of the residuals: one where each joint errs by one over its weight.

    Args:
        held_out: The fold.
        values: Parameters, shape (b,).
        weights: One over each joint's noise, shape (n,).
    """
    rows = float(held_out.rows.sum())
    return float(weights**2 @ held_out_squares(held_out, values)) / max(rows, 1.0)


def one_standard_error(errors: Array) -> int:
    """The first candidate whose mean error exceeds the smallest by no more than that excess's own standard error.

    Folds differ in level far more than candidates differ on a fold, so excess is taken fold by fold.

    Args:
        errors: Shape (candidates, folds), the simplest candidate first; infinite where one failed.
    """
    mean = errors.mean(axis=1)
    best = int(np.argmin(mean))
    if errors.shape[1] < 2 or not np.isfinite(mean[best]):
        return best
    for k in range(best):
        if np.isfinite(mean[k]):
            excess = errors[k] - errors[best]
            if excess.mean() <= excess.std(ddof=1) / np.sqrt(len(excess)):
                return k
    return best


def can_cross_validate(information: Information, count: int = FOLDS) -> bool:
    """Checks whether recordings with parameters of their own are long enough to leave a part of each out.

    Args:
        information: Blocks in their order, separated by recording.
        count: Folds wanted.
    """
    try:
        folds(information, count)
    except EstimationError:
        return False
    return True


def _parts_of_each(information: Information, rows: Array, count: int) -> NDArray[np.int64]:
    """Fold of each block: as many as every recording can be cut into and still train without any of them."""
    recordings = [information.recording == each for each in np.unique(information.recording[rows > 0.0])]
    for parts in range(count, 1, -1):
        fold = np.zeros(information.blocks, dtype=np.int64)
        for recording in recordings:
            fold[recording] = _stretches(rows[recording], parts)
        if all(_trains(information, recording, fold, parts) for recording in recordings):
            return fold
    raise EstimationError(
        "Cross-validation is not possible: the model has separate parameters for each recording, and one recording "
        "is too short to leave out a part of it.",
        remedy="record for longer, estimate one friction for all recordings, or give the key `weight` a number.",
    )


def _trains(information: Information, recording: NDArray[np.bool_], fold: NDArray[np.int64], parts: int) -> bool:
    """Checks whether a recording has a part in every fold, and rows of each joint left without it."""
    if len(np.unique(fold[recording])) < parts:
        return False
    seen = information.rows[recording].any(axis=0)
    for k in range(parts):
        left = recording & (fold != k) & ~training_information(information, fold == k)
        if (seen & ~information.rows[left].any(axis=0)).any():
            return False
    return True


def _long_runs(run: NDArray[np.int64], rows: Array, count: int) -> list[NDArray[np.intp]]:
    """Blocks of each run, runs of less than half a fold together with a neighbour."""
    enough = 0.5 * rows.sum() / count
    groups: list[NDArray[np.intp]] = []
    open_ = np.zeros(0, dtype=np.intp)
    for each in dict.fromkeys(run.tolist()):
        open_ = np.concatenate([open_, np.flatnonzero(run == each)])
        if rows[open_].sum() >= enough:
            groups.append(open_)
            open_ = np.zeros(0, dtype=np.intp)
    if len(open_) and groups:
        groups[-1] = np.concatenate([groups[-1], open_])
    elif len(open_):
        groups.append(open_)
    return groups


def _stretches(rows: Array, parts: int) -> NDArray[np.int64]:
    """Number of the stretch of each block: `parts` of them with about the same rows, none without."""
    counted = np.flatnonzero(rows)
    if not len(counted):
        return np.zeros(len(rows), dtype=np.int64)
    middle = np.cumsum(rows[counted]) - 0.5 * rows[counted]
    number = np.minimum((parts * middle / rows.sum()).astype(np.int64), parts - 1)
    number = np.searchsorted(np.unique(number), number)
    return number[np.minimum(np.searchsorted(counted, np.arange(len(rows))), len(counted) - 1)]

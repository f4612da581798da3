"""Cross-validation: error on rows that were left out of the fit, computed from the triangular factors of the blocks.

The errors of neighbouring rows are correlated. Therefore a fold consists of consecutive blocks; with rows drawn at
random, the held-out error would be as small as the residual of the fit. The held-out error is

    error = Σ_j w_j² |ρ_j - R_j π|² / Σ_j M_j.

Here R_j and ρ_j are the factor and the right-hand side of joint j in the fold that is left out, M_j is the number of
rows of joint j in this fold, and w_j its weight. The parameters π are estimated from the other folds. Blocks next to
the left-out fold are not used in the fit either, because filter and pose correlate them with this fold. If each
recording has separate friction parameters, a fold contains a part of every recording, so that the other folds
determine all parameters.

If a motion repeats, the other folds contain the same motion. The error then measures noise and drift, not the
prediction of other motions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.information.information import Information, merge, select, total

FOLDS = 5
"""Default number of folds: each estimate uses four fifths of the data. This is the usual compromise between the bias
of small training sets and folds so short that they resemble their neighbours [Hastie2009]."""


@dataclass(frozen=True, eq=False, slots=True)
class Fold:
    """Consecutive blocks that are left out of a fit, and the blocks for the fit.

    Attributes:
        training: Blocks for the fit, merged into one: all blocks except the left-out blocks and the blocks next to
            them.
        held_out: The blocks that are left out, merged into one.
    """

    training: Information
    held_out: Information


def folds(information: Information, count: int = FOLDS) -> NDArray[np.int64]:
    """Assigns each block to a fold; returns the number of the fold from 0, shape (blocks,).

    A fold consists of consecutive blocks of one run of a recording. Longer runs are divided into more folds. A run
    that is far shorter than a fold is joined with the next run; the last run is joined with the run before it. Blocks
    without rows in use belong to the fold of their neighbours. If recordings have separate copies of parameters
    (`FV_1[2]` is the copy of recording 2), a fold consists of one part of every recording.

    Args:
        information: Blocks in the order of time.
        count: Approximate number of folds. There are no more folds than blocks, and each long run has at least one.

    Raises:
        EstimationError: A recording with separate parameters is too short to leave a part of it out.
    """
    rows = information.rows.sum(axis=1).astype(np.float64)
    if count > 1 and any(name.recording for name in information.names):
        return _parts_of_each(information, rows, count)
    fold = np.zeros(information.blocks, dtype=np.int64)
    first = 0
    for group in _long_runs(information.run, rows, count):
        share = rows[group].sum() / max(rows.sum(), 1.0)
        parts = min(max(1, round(count * share)), max(1, int(np.count_nonzero(rows[group]))))
        fold[group] = first + _consecutive_parts(rows[group], parts)
        first += parts
    return fold


def split(information: Information, fold: NDArray[np.int64]) -> tuple[Fold, ...]:
    """Leaves out each fold in turn, and returns for each fold the blocks for the fit and the left-out blocks.

    The result is empty if no data for the fit remain when one of the folds is left out.

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
    """Mask of the blocks that are next to a left-out block in the same run, and not left out themselves.

    Filter and pose correlate these blocks with the left-out blocks, so the fit does not use them.

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
    """Sum of squared residuals of each joint in held-out blocks, shape (n,) [(N·m)² or N²], for parameters (b,)."""
    squares = np.empty(held_out.n)
    for j, joint in enumerate(held_out.joints):
        residual = joint.R[:, :, -1] - joint.R[:, :, :-1] @ values[joint.parameters]
        squares[j] = np.sum(residual**2)
    return squares


def rms_by_joint(squares: Array, rows: NDArray[np.int64]) -> Array:
    """Root mean square (n,) from sums of squares and numbers of rows, each (n,); NaN for a joint without rows."""
    return np.sqrt(np.where(rows > 0, squares / np.maximum(rows, 1), np.nan))


def held_out_error(held_out: Information, values: Array, weights: Array) -> float:
    """Weighted mean square of the residuals in a fold; 1 if the RMS residual of each joint is 1 / weight.

    Args:
        held_out: The fold.
        values: Parameters, shape (b,).
        weights: One divided by the standard deviation of each joint's noise, shape (n,).
    """
    rows = float(held_out.rows.sum())
    return float(weights**2 @ held_out_squares(held_out, values)) / max(rows, 1.0)


def one_standard_error(errors: Array) -> int:
    """Index of the first candidate whose mean error exceeds the smallest mean error by at most one standard error.

    The standard error is that of the difference between the errors of the two candidates. It is computed from the
    differences in each fold, because errors differ far more between folds than between candidates.

    Args:
        errors: Error of each candidate, for instance a weight of a prior, in each fold, shape (candidates, folds),
            the simplest candidate first; infinite if a candidate failed.
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
    """True if every recording with separate parameters is long enough to leave a part of it out of the fit.

    Args:
        information: Blocks in their order, separated by recording.
        count: Number of folds.
    """
    try:
        folds(information, count)
    except EstimationError:
        return False
    return True


def _parts_of_each(information: Information, rows: Array, count: int) -> NDArray[np.int64]:
    """Fold of each block, if every recording is divided into `count` parts, or fewer if it is too short."""
    recordings = [information.recording == each for each in np.unique(information.recording[rows > 0.0])]
    for parts in range(count, 1, -1):
        fold = np.zeros(information.blocks, dtype=np.int64)
        for recording in recordings:
            fold[recording] = _consecutive_parts(rows[recording], parts)
        if all(_trains(information, recording, fold, parts) for recording in recordings):
            return fold
    raise EstimationError(
        "Cross-validation is not possible: the model has separate parameters for each recording, and one recording "
        "is too short to leave out a part of it.",
        remedy="record for longer, estimate one friction for all recordings, or set the key `weight` to a number.",
    )


def _trains(information: Information, recording: NDArray[np.bool_], fold: NDArray[np.int64], parts: int) -> bool:
    """True if a recording has a part in every fold, and rows of each joint remain when any one part is left out.

    Args:
        information: All blocks.
        recording: Mask of the blocks of the recording, shape (blocks,).
        fold: Fold of each block, shape (blocks,).
        parts: Number of folds.
    """
    if len(np.unique(fold[recording])) < parts:
        return False
    seen = information.rows[recording].any(axis=0)
    for k in range(parts):
        left = recording & (fold != k) & ~training_information(information, fold == k)
        if (seen & ~information.rows[left].any(axis=0)).any():
            return False
    return True


def _long_runs(run: NDArray[np.int64], rows: Array, count: int) -> list[NDArray[np.intp]]:
    """Indices of the blocks of each run; a run shorter than half a fold is joined with a neighbouring run."""
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


def _consecutive_parts(rows: Array, parts: int) -> NDArray[np.int64]:
    """Index of the part of each block, if blocks are divided into `parts` parts with about equal numbers of rows."""
    counted = np.flatnonzero(rows)
    if not len(counted):
        return np.zeros(len(rows), dtype=np.int64)
    middle = np.cumsum(rows[counted]) - 0.5 * rows[counted]
    number = np.minimum((parts * middle / rows.sum()).astype(np.int64), parts - 1)
    number = np.searchsorted(np.unique(number), number)
    return number[np.minimum(np.searchsorted(counted, np.arange(len(rows))), len(counted) - 1)]

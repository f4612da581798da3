"""Covariance from the scatter between blocks of rows, from the factors alone.

The estimate without block k differs from the estimate by

    Δ_k = (H - H_k)⁻¹ s_k,        s_k = Σ_j w_j² R_jkᵀ (ρ_jk - R_jk π),

and the jackknife cov = (B - 1) / B Σ_k (Δ_k - mean)(Δ_k - mean)ᵀ holds whatever the correlation inside a block and
between joints, with few blocks and many parameters too. There the plain sandwich H⁻¹ Σ s_k s_kᵀ H⁻¹ is too small: a
block pulls the estimate towards itself [Bell2002]. Where blocks are periods of one motion, all H_k are alike and the
jackknife is the variance of the mean of the periods' own estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.information.information import Information
from armid.measurement.observations import ObservedRun
from armid.values import Array

__all__ = ["RepetitionBlocks", "block_products", "correlation", "filled", "group_blocks", "jackknife", "periods"]

RIDGE = 1e-12
"""Added to the diagonal of H, relative: a block that alone shows a direction then gives a huge variance."""

Groups = NDArray[np.int64]

TOGETHER = 32
"""Blocks solved for at a time: a few megabytes."""

SAME_MOTION = 0.2
"""Largest difference of two blocks' products, over their size, that still are periods of one motion. Noise of the
positions and rows masked near an end make a few hundredths, other motion makes about one."""


@dataclass(frozen=True, eq=False, slots=True)
class RepetitionBlocks:
    """Repetitions of motions.

    Attributes:
        groups: Repetition that each block is in, -1 for none, shape (blocks,).
        motions: Motion that each repetition is of, shape (repetitions,).
    """

    groups: Groups
    motions: Groups

    @property
    def free(self) -> int:
        """Degrees of freedom of the scatter between repetitions of a motion."""
        return len(self.motions) - len(np.unique(self.motions))

    @classmethod
    def of_blocks(cls, motions: Groups) -> RepetitionBlocks:
        """Blocks that are a repetition each, by the motion that they are of."""
        used = np.flatnonzero(motions >= 0)
        groups = np.full(len(motions), -1, dtype=np.int64)
        groups[used] = np.arange(len(used))
        return cls(groups, motions[used])

    @classmethod
    def of_runs(cls, runs: Sequence[ObservedRun], filled: NDArray[np.bool_]) -> RepetitionBlocks:
        """Repetitions of runs that know theirs; blocks without rows are in none.

        Args:
            runs: In the order of their blocks.
            filled: Which blocks have rows, shape (blocks,).
        """
        labels: list[tuple[int, int]] = []
        for k, run in enumerate(runs):
            first = np.unique(run.block, return_index=True)[1]
            repetition = run.block if run.repetition is None else run.repetition
            labels += [(k, int(repetition[row])) for row in first]
        used = sorted({label for label, any_row in zip(labels, filled, strict=True) if any_row})
        number = {label: k for k, label in enumerate(used)}
        groups = [number[label] if any_row else -1 for label, any_row in zip(labels, filled, strict=True)]
        return cls(np.array(groups, dtype=np.int64), np.array([k for k, _ in used], dtype=np.int64))


def group_blocks(information: Information, together: int = 1) -> Groups:
    """Number of the group that each block is in, -1 for a block without rows, shape (blocks,).

    Args:
        information: Factors, blocks in the order of time.
        together: Neighbouring blocks of one run that make a group; what is left over joins the last.
    """
    result = np.full(information.blocks, -1, dtype=np.int64)
    first = 0
    for run in np.unique(information.run):
        own = np.flatnonzero((information.run == run) & information.rows.any(axis=1))
        if not len(own):
            continue
        count = max(1, len(own) // together)
        result[own] = first + np.arange(len(own)) * count // len(own)
        first += count
    return result


def periods(information: Information) -> Groups | None:
    """Number of the motion of which each block is a period; `None` where some block has no other like it.

    Periods of one motion have nearly the same products of columns, which blocks of other motion never have.
    """
    length = [np.linalg.norm(joint.R[:, :, :-1], axis=(0, 1)) for joint in information.joints]
    length = [np.where(each > 0.0, each, 1.0) for each in length]

    def products(k: int) -> list[Array]:
        own = [joint.R[k, :, :-1] / size for joint, size in zip(information.joints, length, strict=True)]
        return [R.T @ R for R in own]

    result = np.full(information.blocks, -1, dtype=np.int64)
    left = np.flatnonzero(information.rows.any(axis=1)).tolist()
    motion = 0
    while left:
        first = products(left[0])
        size = sum(float(np.sum(X**2)) for X in first)
        alike = [
            k
            for k in left
            if sum(float(np.sum((X - Y) ** 2)) for X, Y in zip(first, products(k), strict=True))
            <= SAME_MOTION**2 * size
        ]
        if len(alike) < 2:
            return None
        result[alike] = motion
        left = [k for k in left if result[k] < 0]
        motion += 1
    return result if motion else None


def jackknife(
    information: Information, groups: Groups, motions: Groups, values: Array, weights: Array, inverse: Array
) -> Array:
    """Jackknife covariance over groups of blocks, shape (b, b).

    Args:
        information: Factors, one set a block.
        groups: Group that each block is in, -1 for none, shape (blocks,).
        motions: Motion that each group is about, shape (groups,); groups of one motion scatter about their own mean.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: H⁻¹ of the weighted normal equations, prior included, shape (b, b).
    """
    scale = 1.0 / np.sqrt(np.diag(inverse))  # of the size of the columns, whatever their units
    whole = np.asarray(np.linalg.inv(inverse * np.outer(scale, scale)), dtype=np.float64)
    whole[np.diag_indices(len(values))] *= 1.0 + RIDGE
    count = len(motions)
    change = np.empty((count, len(values)))
    for begin in range(0, count, TOGETHER):
        some = np.where((groups >= begin) & (groups < begin + TOGETHER), groups - begin, -1)
        normal, gradient = block_products(information, some, values, weights, scale)
        part = slice(begin, begin + len(normal))
        change[part] = np.linalg.solve(whole - normal, gradient[:, :, None])[:, :, 0] / scale
    covariance = np.zeros((len(values), len(values)))
    for motion in np.unique(motions):
        own = change[motions == motion]
        own = own - own.mean(axis=0)
        covariance += own.T @ own * (len(own) - 1) / len(own)
    return covariance


def filled(scatter: Array, textbook: Array, freedom: float) -> Array:
    """A scatter that can be inverted.

    With f degrees of freedom it has the rank f, and its inverse would take the estimate as exact in all further
    directions; single variances are only known to √(2/f), too. It is drawn to the covariance under white residuals,
    as much larger as it is on the whole, as if b degrees of freedom had shown that.

    Args:
        scatter: Covariance from the scatter between blocks or periods, shape (b, b).
        textbook: That under white residuals, shape (b, b).
        freedom: Degrees of freedom f of the scatter.
    """
    known = np.diag(textbook) > 0.0
    larger = float(np.mean(np.diag(scatter)[known] / np.diag(textbook)[known])) if known.any() else 1.0
    b = len(scatter)
    return np.asarray((freedom * scatter + b * larger * textbook) / (freedom + b), dtype=np.float64)


def correlation(information: Information, groups: Groups, values: Array, weights: Array, inverse: Array) -> float:
    """Tell how far groups pull the same way as their neighbours: s_kᵀ H⁻¹ s_k+1 over s_kᵀ H⁻¹ s_k, summed.

    Args:
        information: Factors, one set a block.
        groups: Group that each block is in, in the order of time, shape (blocks,).
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: H⁻¹, shape (b, b).
    """
    count = int(groups.max()) + 1
    run = np.zeros(count, dtype=np.int64)
    run[groups[groups >= 0]] = information.run[groups >= 0]
    gradient = np.zeros((count, len(values)))
    for begin in range(0, count, TOGETHER):
        some = np.where((groups >= begin) & (groups < begin + TOGETHER), groups - begin, -1)
        part = block_products(information, some, values, weights, np.ones(len(values)))[1]
        gradient[begin : begin + len(part)] = part
    moved = gradient @ inverse
    beside = run[1:] == run[:-1]
    total = float(np.sum(gradient * moved))
    return float(np.sum((gradient[1:] * moved[:-1])[beside])) / total if total > 0.0 else 0.0


def block_products(
    information: Information, groups: Groups, values: Array, weights: Array, scale: Array
) -> tuple[Array, Array]:
    """H_k (groups, b, b) and s_k (groups, b) of groups of blocks, parameters in units of 1 / scale.

    Args:
        information: Factors, one set a block.
        groups: Group that each block is in, -1 for none, shape (blocks,).
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        scale: Of the columns, shape (b,).
    """
    used = np.flatnonzero(groups >= 0)
    into = groups[used]
    count = int(into.max()) + 1
    normal = np.zeros((count, len(values), len(values)))
    gradient = np.zeros((count, len(values)))
    for weight, joint in zip(weights, information.joints, strict=True):
        own = joint.parameters
        R = joint.R[used]
        residual = weight * (R[:, :, -1] - R[:, :, :-1] @ values[own])
        scaled = np.ascontiguousarray((weight * R[:, :, :-1] / scale[own]).transpose(0, 2, 1))
        products = scaled @ scaled.transpose(0, 2, 1)
        pulls = (scaled @ residual[:, :, None])[:, :, 0]
        for k in range(count):
            normal[k, own[:, None], own] += products[into == k].sum(axis=0)
            gradient[k, own] += pulls[into == k].sum(axis=0)
    return normal, gradient

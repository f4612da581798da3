"""Covariance from the scatter between blocks of rows, computed from the triangular factors alone.

If block k is left out, the estimate π changes by -Δ_k with

    Δ_k = (H - H_k)⁻¹ s_k,        s_k = Σ_j w_j² R_jkᵀ (ρ_jk - R_jk π),

Here H is the normal matrix, H_k the normal matrix of block k, w_j the weight of joint j, and R_jk and ρ_jk are
triangular factor and right-hand side of joint j in block k. For B blocks, the jackknife covariance is (B - 1) / B Σ_k
(Δ_k - mean)(Δ_k - mean)ᵀ. It is valid for any correlation inside a block and between joints, even for few blocks and
many parameters. For few blocks, the sandwich covariance H⁻¹ Σ s_k s_kᵀ H⁻¹ is too small, because each block has
leverage on the estimate [Bell2002]. If the blocks are periods of one motion, all H_k are nearly equal, and the
jackknife is the variance of the mean of the estimates from single periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.uncertainty.covariance_choice_thresholds import (
    FEWEST_BLOCKS,
    MAX_NEIGHBOUR_CORRELATION,
    MIN_MERGED_BLOCKS,
    SAME_PRODUCTS,
)
from armid.information.information import Information
from armid.measurement.observations import ObservedRun

RIDGE = 1e-12
"""Number that is added to the diagonal of H, relative to its elements. If only one block determines a direction,
the direction then gets a very large variance."""

Groups = NDArray[np.int64]

BATCH = 32
"""Number of blocks for which equations are solved together, which takes a few megabytes."""


@dataclass(frozen=True, eq=False, slots=True)
class RepetitionBlocks:
    """Assignment of blocks to repetitions of motions.

    Attributes:
        groups: Index of the repetition to which each block belongs, -1 for blocks of no repetition, shape (blocks,).
        motions: Index of the motion that is repeated, for each repetition, shape (repetitions,).
    """

    groups: Groups
    motions: Groups

    @property
    def free(self) -> int:
        """Degrees of freedom of the scatter between repetitions: number of repetitions minus number of motions."""
        return len(self.motions) - len(np.unique(self.motions))

    @classmethod
    def of_blocks(cls, motions: Groups) -> RepetitionBlocks:
        """Makes the assignment in which each block is one repetition.

        `motions` contains the index of the motion of each block, -1 for blocks of no motion, shape (blocks,).
        """
        used = np.flatnonzero(motions >= 0)
        groups = np.full(len(motions), -1, dtype=np.int64)
        groups[used] = np.arange(len(used))
        return cls(groups, motions[used])

    @classmethod
    def of_runs(cls, runs: Sequence[ObservedRun], has_rows: NDArray[np.bool_]) -> RepetitionBlocks:
        """Assigns blocks to the repetitions that are stored with the runs; blocks without rows get no repetition.

        Args:
            runs: Runs in the order of their blocks.
            has_rows: Mask of the blocks that have rows, shape (blocks,).
        """
        labels: list[tuple[int, int]] = []
        for k, run in enumerate(runs):
            first = np.unique(run.block, return_index=True)[1]
            repetition = run.block if run.repetition is None else run.repetition
            labels += [(k, int(repetition[row])) for row in first]
        used = sorted({label for label, any_row in zip(labels, has_rows, strict=True) if any_row})
        number = {label: k for k, label in enumerate(used)}
        groups = [number[label] if any_row else -1 for label, any_row in zip(labels, has_rows, strict=True)]
        return cls(np.array(groups, dtype=np.int64), np.array([k for k, _ in used], dtype=np.int64))


def group_blocks(information: Information, per_group: int = 1) -> Groups:
    """Joins neighbouring blocks to groups; returns the group of each block, -1 for blocks without rows, (blocks,).

    Args:
        information: Factors of each block, in the order of time.
        per_group: Number of neighbouring blocks of one run in a group; remaining blocks join the last group.
    """
    result = np.full(information.blocks, -1, dtype=np.int64)
    first = 0
    for run in np.unique(information.run):
        of_run = np.flatnonzero((information.run == run) & information.rows.any(axis=1))
        if not len(of_run):
            continue
        count = max(1, len(of_run) // per_group)
        result[of_run] = first + np.arange(len(of_run)) * count // len(of_run)
        first += count
    return result


def periods(information: Information) -> Groups | None:
    """Finds blocks that repeat the same motion; returns the index of the motion of each block, shape (blocks,).

    Blocks of the same motion have nearly the same normal matrix; blocks of different motions do not. The result is
    `None` if a block is similar to no other block.
    """
    length = [np.linalg.norm(joint.R[:, :, :-1], axis=(0, 1)) for joint in information.joints]
    length = [np.where(each > 0.0, each, 1.0) for each in length]

    def products(k: int) -> list[Array]:
        factors = [joint.R[k, :, :-1] / size for joint, size in zip(information.joints, length, strict=True)]
        return [R.T @ R for R in factors]

    result = np.full(information.blocks, -1, dtype=np.int64)
    remaining = np.flatnonzero(information.rows.any(axis=1)).tolist()
    motion = 0
    while remaining:
        first = products(remaining[0])
        size = sum(float(np.sum(X**2)) for X in first)
        alike = [
            k
            for k in remaining
            if sum(float(np.sum((X - Y) ** 2)) for X, Y in zip(first, products(k), strict=True))
            <= SAME_PRODUCTS**2 * size
        ]
        if len(alike) < 2:
            return None
        result[alike] = motion
        remaining = [k for k in remaining if result[k] < 0]
        motion += 1
    return result if motion else None


def jackknife(
    information: Information, groups: Groups, motions: Groups, values: Array, weights: Array, inverse: Array
) -> Array:
    """Jackknife covariance over groups of blocks, shape (b, b).

    Args:
        information: Factors of each block.
        groups: Group of each block, -1 for blocks that are not used, shape (blocks,).
        motions: Motion of each group, shape (groups,); the scatter of the groups of one motion is taken about their
            mean.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: Inverse H⁻¹ of the weighted normal matrix, prior included, shape (b, b).
    """
    scale = 1.0 / np.sqrt(np.diag(inverse))  # of the size of the columns, whatever their units
    whole = np.asarray(np.linalg.inv(inverse * np.outer(scale, scale)), dtype=np.float64)
    whole[np.diag_indices(len(values))] *= 1.0 + RIDGE
    count = len(motions)
    change = np.empty((count, len(values)))
    for begin in range(0, count, BATCH):
        batch = np.where((groups >= begin) & (groups < begin + BATCH), groups - begin, -1)
        normal, gradient = block_products(information, batch, values, weights, scale)
        part = slice(begin, begin + len(normal))
        change[part] = np.linalg.solve(whole - normal, gradient[:, :, None])[:, :, 0] / scale
    covariance = np.zeros((len(values), len(values)))
    for motion in np.unique(motions):
        of_motion = change[motions == motion]
        of_motion = of_motion - of_motion.mean(axis=0)
        covariance += of_motion.T @ of_motion * (len(of_motion) - 1) / len(of_motion)
    return covariance


def blend_with_textbook(scatter: Array, textbook: Array, freedom: float) -> Array:
    """Weighted mean of a covariance from scatter and the covariance for white residuals, which can be inverted.

    A covariance from scatter with f degrees of freedom has the rank f; in all other directions the estimate would
    count as exact. Moreover, each variance has the relative error √(2/f). For the blend, the white covariance is
    scaled by the mean ratio of the variances and gets the weight of b degrees of freedom.

    Args:
        scatter: Covariance from the scatter between blocks or periods, shape (b, b).
        textbook: Covariance for white residuals, shape (b, b).
        freedom: Degrees of freedom f of the scatter.
    """
    known = np.diag(textbook) > 0.0
    larger = float(np.mean(np.diag(scatter)[known] / np.diag(textbook)[known])) if known.any() else 1.0
    b = len(scatter)
    return np.asarray((freedom * scatter + b * larger * textbook) / (freedom + b), dtype=np.float64)


def correlation(information: Information, groups: Groups, values: Array, weights: Array, inverse: Array) -> float:
    """Correlation of the gradients s_k of neighbouring groups k: (Σ s_kᵀ H⁻¹ s_k+1) / (Σ s_kᵀ H⁻¹ s_k).

    Args:
        information: Factors of each block.
        groups: Group of each block, in the order of time, shape (blocks,).
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: Inverse H⁻¹ of the weighted normal matrix, prior included, shape (b, b).
    """
    count = int(groups.max()) + 1
    run = np.zeros(count, dtype=np.int64)
    run[groups[groups >= 0]] = information.run[groups >= 0]
    gradient = np.zeros((count, len(values)))
    for begin in range(0, count, BATCH):
        batch = np.where((groups >= begin) & (groups < begin + BATCH), groups - begin, -1)
        part = block_products(information, batch, values, weights, np.ones(len(values)))[1]
        gradient[begin : begin + len(part)] = part
    moved = gradient @ inverse
    same_run = run[1:] == run[:-1]
    total = float(np.sum(gradient * moved))
    return float(np.sum((gradient[1:] * moved[:-1])[same_run])) / total if total > 0.0 else 0.0


def block_products(
    information: Information, groups: Groups, values: Array, weights: Array, scale: Array
) -> tuple[Array, Array]:
    """Normal matrix H_k and right-hand side s_k of each group k of blocks, shape (groups, b, b) and (groups, b).

    The right-hand side is computed from the residuals of the estimate. Columns are divided by `scale`, so the
    unknowns are the parameters multiplied by `scale`.

    Args:
        information: Factors of each block.
        groups: Group of each block, -1 for none, shape (blocks,).
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        scale: Euclidean norm by which each column is divided, shape (b,).
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
        gradients = (scaled @ residual[:, :, None])[:, :, 0]
        for k in range(count):
            normal[k, own[:, None], own] += products[into == k].sum(axis=0)
            gradient[k, own] += gradients[into == k].sum(axis=0)
    return normal, gradient


def block_covariance(
    information: Information, values: Array, weights: Array, inverse: Array
) -> tuple[Array, float] | None:
    """Jackknife covariance (b, b) over blocks, and its degrees of freedom.

    Correlated neighbouring blocks are merged first.

    Args:
        information: Factors of each block, in the order of time.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: Inverse H⁻¹ of the weighted normal matrix, prior included, shape (b, b).

    Returns:
        Covariance and degrees of freedom; `None` if there are too few blocks with rows in use.
    """
    per_group = 1
    groups = group_blocks(information)
    count = int(groups.max()) + 1
    if count < FEWEST_BLOCKS:
        return None
    while (
        count // 2 >= MIN_MERGED_BLOCKS
        and correlation(information, groups, values, weights, inverse) > MAX_NEIGHBOUR_CORRELATION
    ):
        per_group *= 2
        groups = group_blocks(information, per_group)
        count = int(groups.max()) + 1
    one = np.zeros(count, dtype=np.int64)
    return jackknife(information, groups, one, values, weights, inverse), count - 1.0

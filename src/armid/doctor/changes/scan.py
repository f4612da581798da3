"""Search for the change within a log that a fit of one model to all joints asks for.

The fit is linearised: joints keep the weights of the fit without a change. The scalar products of the columns of
each alternative with the model's columns are summed over blocks of rows once; each shape of a change is then a
weighted sum over the blocks [Frisch1933].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.alternatives import Alternative
from armid.doctor.changes.shapes import BLOCKS, ChangeShape, inverted_in_part, shapes
from armid.doctor.fitted_log import LogState

RIDGE = 1e-9
"""Number that is added to the diagonal of the products of unit columns of the model, as in the quick fit."""

WEAK = 3e-3
"""Share of a column that parameters of the model cannot replace, below which the column counts as determined by
rounding and model error only."""

WORTH, MORE = 0.02, 1.3
"""Decrease of the squared residuals for each row, half of that from which a change is fitted, from which steps with a
second part are tried, and ratio of their decrease to that without one from which they are used: a step ends where
it fits best, so that any second part adds a little."""

DECADES = 10.0 ** np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
"""Factors of other units of torque, such as mN·m or N·cm."""

FACTORS = np.concatenate([-np.exp(np.linspace(-0.7, 0.7, 7)), np.exp(np.linspace(-1.2, 1.2, 25)), DECADES])
"""Factors on the torque of the changed part that are tried."""


@dataclass(frozen=True, eq=False, slots=True)
class ChangeCandidate:
    """Change of one kind with the shape that explains a log best.

    Attributes:
        alternative: What changes.
        shape: When it changes.
        values: Coefficients of the columns of the alternative; for a gain, the factor on the torque.
        gain: Decrease of the sum of squared residuals, each divided by its variance, for each row.
        steady: Share of this decrease in that of coefficients that differ from block to block; 1 for gains and
            orders, and for decreases below `WORTH`.
        constant: Share of this decrease that the same coefficients give if they hold for the whole log.
    """

    alternative: Alternative
    shape: ChangeShape
    values: Array
    gain: float
    steady: float
    constant: float

    def with_values(self, values: Array) -> ChangeCandidate:
        """A copy of this change with other sizes, such as the gain or the offset of each joint, shape (k,)."""
        return replace(self, values=values)


@dataclass(frozen=True, eq=False, slots=True)
class BlockSums:
    """Scalar products of e weighted columns, summed over each block of rows.

    Attributes:
        model: With the orthonormal columns of the model, shape (e, b, BLOCKS).
        own: With each other, shape (e, e, BLOCKS).
        residual: With the residual, shape (e, BLOCKS).
        counted: Number of rows that are used for the joints concerned, shape (BLOCKS,).
    """

    model: Array
    own: Array
    residual: Array
    counted: Array


def block_of(samples: int) -> NDArray[np.intp]:
    """Block of each of some rows, shape (M,)."""
    return np.minimum(np.arange(samples) * BLOCKS // max(samples, 1), BLOCKS - 1)


def scan(state: LogState, alternatives: Sequence[Alternative]) -> list[ChangeCandidate]:
    """Finds the shape of each alternative with the largest decrease of the residuals; largest decreases first."""
    rows, fit = state.rows, state.fit
    weight = rows.mask / fit.sigma
    columns = _orthonormal(state, weight)
    residual = fit.residual / fit.sigma
    starts = np.searchsorted(block_of(len(weight)), np.arange(BLOCKS))
    total = float(rows.mask.sum())
    found: list[ChangeCandidate] = []
    known = _products_of_joints(alternatives, columns, weight, starts)
    for k, each in enumerate(alternatives):
        sums = _block_sums(each, columns, residual, weight, starts, known.get(k))
        found.append(_best(each, sums, total))
    return sorted(found, key=lambda candidate: -candidate.gain)


def _orthonormal(state: LogState, weight: Array) -> list[Array]:
    """Weighted columns of the model, made orthonormal over all joints, n of shape (b, M)."""
    rows = state.rows
    products = np.zeros((rows.count, rows.count))
    for j, (own, x) in enumerate(zip(rows.parameters, rows.columns, strict=True)):
        weighted = x * weight[:, j]
        products[np.ix_(own, own)] += weighted @ weighted.T
    size = np.sqrt(products.diagonal())
    size = np.where(size > 0.0, size, 1.0)
    factor = np.linalg.cholesky(products / np.outer(size, size) + RIDGE * np.eye(rows.count))
    to_unit = np.linalg.inv(factor) / size
    each = zip(rows.parameters, rows.columns, strict=True)
    return [to_unit[:, own] @ (x * weight[:, j]) for j, (own, x) in enumerate(each)]


def _products_of_joints(
    alternatives: Sequence[Alternative], columns: Sequence[Array], weight: Array, starts: NDArray[np.intp]
) -> dict[int, Array]:
    """Scalar products with the model of the alternatives that concern one torque, by their number, (e, b, BLOCKS).

    Those of one joint are computed together, which takes a fifth of the time.
    """
    known: dict[int, Array] = {}
    for j, own in enumerate(columns):
        of_joint = [k for k, each in enumerate(alternatives) if each.of_torque == j]
        if not of_joint:
            continue
        each = [alternatives[k].columns[:, :, j] * weight[:, j] for k in of_joint]
        whole = _products(np.concatenate(each), own, starts)
        ends = np.cumsum([len(x) for x in each])
        known |= dict(zip(of_joint, np.split(whole, ends[:-1]), strict=True))
    return known


def _products(x: Array, columns: Array, starts: NDArray[np.intp]) -> Array:
    """Scalar products of some columns (e, M) and columns (b, M) in each block of rows, shape (e, b, BLOCKS)."""
    ends = [*starts[1:], x.shape[1]]
    return np.stack([x[:, a:z] @ columns[:, a:z].T for a, z in zip(starts, ends, strict=True)], axis=-1)


def _block_sums(
    each: Alternative,
    columns: Sequence[Array],
    residual: Array,
    weight: Array,
    starts: NDArray[np.intp],
    known: Array | None,
) -> BlockSums:
    """Computes the block sums of an alternative; its products with the model may be known."""
    extra = each.columns * weight
    e, b = len(extra), len(columns[0])
    model = np.zeros((e, b, BLOCKS))
    own, along = np.zeros((e, e, len(weight))), np.zeros((e, len(weight)))
    concerned = np.flatnonzero(extra.any(axis=(0, 1))) if known is None else np.array([each.of_torque])
    for j in map(int, concerned):
        x = extra[:, :, j]
        own += x[:, None] * x[None]
        along += x * residual[:, j]
        model += _products(x, columns[j], starts) if known is None else known
    counted = np.add.reduceat((weight[:, list(each.joints)] > 0.0).sum(axis=1), starts)
    return BlockSums(
        model, np.add.reduceat(own, starts, axis=2), np.add.reduceat(along, starts, axis=1), counted.astype(float)
    )


def _best(each: Alternative, sums: BlockSums, total: float) -> ChangeCandidate:
    """Finds the best shape of an alternative; a step may have a second part if that explains far more."""
    every, size = shapes()
    gained, values = _gains(each, sums, [shape.form == "step" for shape in every], size)
    gradual = np.array([shape.form != "step" for shape in every[:-1]])
    s = int(np.argmax(np.where(gradual | (each.kind != "balance"), gained[:-1], -np.inf)))
    best, whole, shape, value = float(gained[s]), float(gained[-1]), every[s], values[:, s]
    if shape.form == "step" and best > WORTH * total:
        more, size = inverted_in_part(shape)
        gained, values = _gains(each, sums, [True] * len(more), size)
        s = int(np.argmax(gained))
        if gained[s] > MORE * best:
            best, shape, value = float(gained[s]), more[s], values[:, s]
    compared = each.kind not in ("gain", "order") and best > WORTH * total
    steady = min(_share(best, _varying(sums)), 1.0) if compared else 1.0
    return ChangeCandidate(each, shape, value, best / total, steady, _share(whole, best))


def _gains(each: Alternative, sums: BlockSums, abrupt: Sequence[bool], size: Array) -> tuple[Array, Array]:
    """Decreases (s,) of the squared residuals by an alternative with s shapes, and its coefficients (e, s).

    Args:
        each: The alternative.
        sums: Its block sums.
        abrupt: True for each shape that is a step.
        size: Sizes of the shapes in each block, shape (s, BLOCKS).
    """
    square = size**2
    of_model = sums.model @ size.T
    gram = sums.own @ square.T - np.einsum("ebs,fbs->efs", of_model, of_model)
    side = sums.residual @ size.T
    if each.kind in ("gain", "order"):
        factors = FACTORS if each.kind == "gain" else np.array([1.0])
        step = (1.0 / factors - 1.0 if each.kind == "gain" else factors)[:, None]
        priced = 2.0 * np.log(np.abs(factors))[:, None] * (size @ sums.counted)
        gained = -(2.0 * step * side[0] + step**2 * gram[0, 0]) - priced
        gained[np.ix_((factors < 0.0) | (each.kind == "order"), ~np.array(abrupt))] = -np.inf
        return gained.max(axis=0), factors[np.argmax(gained, axis=0)][None]
    scale = np.sqrt(np.einsum("ees->es", sums.own @ square.T))
    coefficients, gained = _solved(gram, side, np.where(scale > 0.0, scale, 1.0))
    return gained, coefficients


def _share(part: float, whole: float) -> float:
    """Ratio of two decreases; 0 if the second one is none."""
    return part / whole if whole > 0.0 else 0.0


def _solved(gram: Array, side: Array, scale: Array) -> tuple[Array, Array]:
    """Coefficients (e, s) and decreases (s,) of s regularised normal equations with matrices (e, e, s)."""
    matrices = np.moveaxis(gram / (scale[:, None] * scale[None]), -1, 0) + WEAK * np.eye(len(side))
    unit = np.linalg.solve(matrices, (side / scale).T[:, :, None])[:, :, 0].T
    return unit / scale, np.sum(unit * side / scale, axis=0)


def _varying(sums: BlockSums) -> float:
    """Decrease of the residuals by coefficients that differ from block to block."""
    e = len(sums.residual)
    gram = -np.einsum("ebk,fbl->ekfl", sums.model, sums.model)
    across = np.arange(BLOCKS)
    gram[:, across, :, across] += np.moveaxis(sums.own, -1, 0)
    side, scale = sums.residual.reshape(-1), np.sqrt(np.einsum("eek->ek", sums.own)).reshape(-1)
    scale = np.where(scale > 0.0, scale, 1.0)
    flat = gram.reshape(e * BLOCKS, e * BLOCKS, 1)
    return float(_solved(flat, side[:, None], scale[:, None])[1][0])

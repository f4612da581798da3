"""Search for the change within a log that a fit of one model to all joints asks for.

The fit is linearised: joints keep the weights of the fit without a change. The scalar products of the columns of
each alternative with the model's columns are summed over blocks of rows once; each shape of a change is then a
weighted sum over the blocks [Frisch1933].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
        gram: Of each column in each block with each other, after the columns of the model are projected out, shape
            (e, BLOCKS, e, BLOCKS).
        own: Of each column with itself, shape (e, BLOCKS).
        residual: With the residual, shape (e, BLOCKS).
        counted: Number of rows that are used for the joints concerned, shape (BLOCKS,).
    """

    gram: Array
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
    sums = _block_sums(alternatives, columns, residual, weight, starts)
    found = [_best(each, of_each, total) for each, of_each in zip(alternatives, sums, strict=True)]
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


def _block_sums(
    alternatives: Sequence[Alternative],
    columns: Sequence[Array],
    residual: Array,
    weight: Array,
    starts: NDArray[np.intp],
) -> Iterator[BlockSums]:
    """Block sums of each alternative.

    The products of the columns of all alternatives with the model are computed together, joint by joint.

    Args:
        alternatives: What may change.
        columns: Weighted orthonormal columns of the model, n of shape (b, M).
        residual: Residual over its standard deviation, shape (M, n).
        weight: Weight of each row, shape (M, n).
        starts: First row of each block, shape (BLOCKS,).
    """
    flat = [column for each in alternatives for column in each.columns]
    ends = np.cumsum([len(each.columns) for each in alternatives])
    parts = [slice(end - len(each.columns), end) for each, end in zip(alternatives, ends, strict=True)]
    concerned = np.concatenate([each.concerned for each in alternatives])
    model = np.zeros((len(flat), len(columns[0]), BLOCKS))
    along, own = np.zeros((2, len(flat), BLOCKS))
    together = [np.zeros((len(each.columns), len(each.columns), BLOCKS)) for each in alternatives]
    several = [k for k, each in enumerate(alternatives) if len(each.columns) > 1]
    for j, unit in enumerate(columns):
        which = np.flatnonzero(concerned[:, j])
        if not len(which):
            continue
        x = np.stack([flat[k][:, j] for k in which]) * weight[:, j]
        model[which] += _products(x, unit, starts)
        along[which] += np.add.reduceat(x * residual[:, j], starts, axis=1)
        own[which] += np.add.reduceat(x**2, starts, axis=1)
        for k in several:
            inside = (which >= parts[k].start) & (which < parts[k].stop)
            numbers = which[inside] - parts[k].start
            together[k][numbers[:, None], numbers] += _products(x[inside], x[inside], starts)
    used = np.add.reduceat(weight > 0.0, starts, axis=0, dtype=np.float64)
    across = np.arange(BLOCKS)
    for each, part, pairs in zip(alternatives, parts, together, strict=True):
        e = len(each.columns)
        of_model = model[part].swapaxes(1, 2).reshape(e * BLOCKS, -1)
        gram = -(of_model @ of_model.T).reshape(e, BLOCKS, e, BLOCKS)
        gram[:, across, :, across] += pairs.transpose(2, 0, 1) if e > 1 else own[part].T[:, :, None]
        yield BlockSums(gram, own[part], along[part], used[:, list(each.joints)].sum(axis=1))


def _products(x: Array, columns: Array, starts: NDArray[np.intp]) -> Array:
    """Scalar products of some columns (e, M) and columns (b, M) in each block of rows, shape (e, b, BLOCKS)."""
    result = np.empty((len(x), len(columns), BLOCKS))
    for k, (a, z) in enumerate(zip(starts, [*starts[1:], x.shape[1]], strict=True)):
        result[:, :, k] = x[:, a:z] @ columns[:, a:z].T
    return result


def _best(each: Alternative, sums: BlockSums, total: float) -> ChangeCandidate:
    """Finds the best shape of an alternative; a step may have a second part if that explains far more."""
    every, abrupt, size = shapes()
    gained, values = _gains(each, sums, abrupt, size)
    s = int(np.argmax(np.where(abrupt[:-1] & (each.kind == "balance"), -np.inf, gained[:-1])))
    best, whole, shape, value = float(gained[s]), float(gained[-1]), every[s], values[:, s]
    if shape.form == "step" and best > WORTH * total:
        parts, size = inverted_in_part(shape)
        gained, values = _gains(each, sums, np.ones(len(parts), dtype=np.bool_), size)
        s = int(np.argmax(gained))
        if gained[s] > MORE * best:
            best, shape, value = float(gained[s]), replace(shape, inverted=parts[s]), values[:, s]
    compared = each.kind not in ("gain", "order") and best > WORTH * total
    steady = min(_share(best, _varying(sums)), 1.0) if compared else 1.0
    return ChangeCandidate(each, shape, value, best / total, steady, _share(whole, best))


def _gains(each: Alternative, sums: BlockSums, abrupt: NDArray[np.bool_], size: Array) -> tuple[Array, Array]:
    """Decreases (s,) of the squared residuals by an alternative with s shapes, and its coefficients (e, s).

    Args:
        each: The alternative.
        sums: Its block sums.
        abrupt: True for each shape that is a step, shape (s,).
        size: Sizes of the shapes in each block, shape (s, BLOCKS).
    """
    gram = ((size @ sums.gram.swapaxes(1, 2)) * size) @ np.ones(BLOCKS)
    side = sums.residual @ size.T
    if each.kind in ("gain", "order"):
        factors = FACTORS if each.kind == "gain" else np.array([1.0])
        step = (1.0 / factors - 1.0 if each.kind == "gain" else factors)[:, None]
        priced = 2.0 * np.log(np.abs(factors))[:, None] * (size @ sums.counted)
        gained = -(2.0 * step * side[0] + step**2 * gram[0, 0]) - priced
        gained[np.ix_((factors < 0.0) | (each.kind == "order"), ~abrupt)] = -np.inf
        return gained.max(axis=0), factors[np.argmax(gained, axis=0)][None]
    scale = np.sqrt(sums.own @ (size**2).T)
    coefficients, gained = _solved(gram, side, np.where(scale > 0.0, scale, 1.0))
    return gained, coefficients


def _share(part: float, whole: float) -> float:
    """Ratio of two decreases; 0 if the second one is none."""
    return part / whole if whole > 0.0 else 0.0


def _solved(gram: Array, side: Array, scale: Array) -> tuple[Array, Array]:
    """Coefficients (e, s) and decreases (s,) of s regularised normal equations with matrices (e, e, s)."""
    if len(side) == 1:
        unit = side / scale / (gram[0] / scale**2 + WEAK)
        return unit / scale, (unit * side / scale)[0]
    matrices = (gram / (scale[:, None] * scale[None])).transpose(2, 0, 1) + WEAK * np.eye(len(side))
    unit = np.linalg.solve(matrices, (side / scale).T[:, :, None])[:, :, 0].T
    return unit / scale, np.sum(unit * side / scale, axis=0)


def _varying(sums: BlockSums) -> float:
    """Decrease of the residuals by coefficients that differ from block to block."""
    e = len(sums.residual)
    side, scale = sums.residual.reshape(-1), np.sqrt(sums.own).reshape(-1)
    scale = np.where(scale > 0.0, scale, 1.0)
    flat = sums.gram.reshape(e * BLOCKS, e * BLOCKS, 1)
    return float(_solved(flat, side[:, None], scale[:, None])[1][0])

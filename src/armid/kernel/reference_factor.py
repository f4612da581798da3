"""NumPy twin of the kernel functions that process samples block by block: columns, factors, decimation.

To be short, this module stores the whole regressor. The compiled kernel never stores it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.kernel import reference
from armid.kernel.joint_column_layout import ColumnLayout
from armid.kernel.tree import Tree


def columns(tree: Tree, layout: ColumnLayout, q: Array, dq: Array, ddq: Array, torque: Array, terms: Array) -> Array:
    """Regressor columns of every joint, followed by its torque, shape (columns, N)."""
    out = np.zeros((layout.columns, len(q)))
    if len(layout.target):
        Y = reference.regressor(tree, q, dq, ddq)
        pairs = [(i, j) for i in range(tree.n) for j in tree.ancestors(i)]
        for (i, j), targets in zip(pairs, layout.target.reshape(-1, 10), strict=True):
            wanted = targets >= 0
            out[layout.offset[j] + targets[wanted]] = Y[:, j, 10 * i : 10 * i + 10][:, wanted].T
    out[layout.term] = terms
    out[layout.offset[1:] - 1] = torque.T
    return out


def factor_columns(x: Array, bounds: NDArray[np.int64]) -> Array:
    """Upper triangular factors of K columns `x` (K, rows), one for each block of rows, shape (blocks, K, K).

    Block k contains rows `bounds[k]` to `bounds[k + 1] - 1`.
    """
    K = len(x)
    out = np.zeros((len(bounds) - 1, K, K))
    for R, a, b in zip(out, bounds[:-1], bounds[1:], strict=True):
        top = np.linalg.qr(x[:, a:b].T, mode="r")
        R[: len(top)] = top
    return out


def factor(
    tree: Tree,
    layout: ColumnLayout,
    q: Array,
    dq: Array,
    ddq: Array,
    torque: Array,
    terms: Array,
    bounds: NDArray[np.int64],
    mask: NDArray[np.bool_] | None,
) -> Array:
    """Triangular factors of all joints, one row for each block, shape (blocks, sum of the widths squared).

    A row contains the factors (width, width) of all joints one after another.
    """
    x = columns(tree, layout, q, dq, ddq, torque, terms)
    factors: list[Array] = []
    for j, (a, b) in enumerate(zip(layout.offset[:-1], layout.offset[1:], strict=True)):
        rows = x[a:b] if mask is None else x[a:b] * mask[:, j]
        factors.append(factor_columns(rows, bounds).reshape(len(bounds) - 1, -1))
    return np.concatenate(factors, axis=1)


def decimate(
    tree: Tree,
    layout: ColumnLayout,
    q: Array,
    dq: Array,
    ddq: Array,
    torque: Array,
    terms: Array,
    taps: Array,
    step: int,
    first: int,
    out: Array,
) -> None:
    """Adds to entry r of each row of `out` the sum of taps[s - first - r step] · column[s] over the samples s.

    `out` has shape (columns, rows): one row for each regressor column.
    """
    x = columns(tree, layout, q, dq, ddq, torque, terms)
    for r in range(out.shape[1]):
        start = first + r * step
        a, b = max(start, 0), min(start + len(taps), x.shape[1])
        if a < b:
            out[:, r] += x[:, a:b] @ taps[a - start : b - start]


def information(
    tree: Tree,
    layout: ColumnLayout,
    q: Array,
    dq: Array,
    ddq: Array,
    terms: Array,
    weights: Array,
    count: int,
) -> Array:
    """Information matrix: sum of weights[j] · X_jᵀ X_j with the columns X_j of each joint j, shape (count, count)."""
    x = columns(tree, layout, q, dq, ddq, np.zeros_like(q), terms)
    G = np.zeros((count, count))
    for weight, parameters, start in zip(weights, layout.parameters, layout.offset[:-1], strict=True):
        own = x[start : start + len(parameters)]
        G[np.ix_(parameters, parameters)] += weight * (own @ own.T)
    return G

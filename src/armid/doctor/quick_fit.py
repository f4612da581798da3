"""Weighted least squares on a few hundred rows of a recording, in milliseconds.

The doctor fits a model many times: to the log as it is, with channels in another order, with another gravity. As in
an estimate, the same filter is applied to torque and columns, and a triangular factor is computed for each joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.doctor.downsample import DownsampledLog
from armid.information.base_regressor_layout import ColumnSource
from armid.information.filtered_rows import all_rows
from armid.model.motion import Motion

PASSES = 4
"""Largest number of rounds in which joints are weighted by their residuals; two are usually enough."""

SETTLED = 1e-3
"""Relative change of all residuals in a round below which the weighting has converged."""

FLOOR = 1e-9
"""Smallest ratio of residual to torque in the weight of a joint; logs without noise have a residual of zero."""

RIDGE = 1e-9
"""Number that is added to the diagonal of the products of unit columns, so that parameters that are not excited get a
value. For parameters that are excited, the diagonal of the factor has squares of at least 1e-4."""

COARSE_FLOOR = 1e-6
"""`FLOOR` for fits from products, whose rounding error is the square root of the machine epsilon."""

CUT = 1e-9
"""Ratio to the largest singular value below which a direction counts as not excited."""

INDEPENDENT = 1e-6
"""Ratio of the smallest to the largest diagonal element of a triangular factor above which the columns are certainly
independent. The triangular equations are then solved directly, in a sixth of the time of singular values."""

LONGEST_LAG = 1.0
"""Longest lag up to which the autocorrelation of the residuals is summed [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class QuickRows:
    """Filtered regressor columns of the base parameters and filtered torque, at M rows of a log.

    Attributes:
        columns: For each joint, the columns of the k base parameters that its torque depends on, shape (k, M).
        parameters: For each joint, the indices of these k among all base parameters, shape (k,).
        count: Number b of base parameters.
        motion: Motion at the rows.
        torque: Torque at the rows, shape (M, n) [N·m or N].
        mask: Mask of the rows that are used, shape (M, n).
        run: Index of the contiguous run of each row, shape (M,).
        rate: Row rate [Hz].
    """

    columns: tuple[Array, ...]
    parameters: tuple[NDArray[np.int32], ...]
    count: int
    motion: Motion
    torque: Array
    mask: NDArray[np.bool_]
    run: NDArray[np.int64]
    rate: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.columns)


@dataclass(frozen=True, eq=False)
class QuickFit:
    """Result of weighted least squares on M rows of a log, with e extra columns.

    Attributes:
        values: Base parameters, followed by the coefficients of the extra columns, shape (b + e,).
        sigma: RMS residual of each joint, shape (n,) [N·m or N].
        rows: The rows.
        tables: Columns, extra columns and torque of each joint, shape (k + e + 1, M); zero in rows that are not used.
        factor: Triangular factors of the columns of all joints, one below the other, shape (r, b + e).
        side: Torque, transformed in the same way as the rows of the factor, shape (r,) [N·m or N].
        joint: Joint of each row of the factor, shape (r,).
    """

    values: Array
    sigma: Array
    rows: QuickRows
    tables: tuple[Array, ...]
    factor: Array
    side: Array
    joint: NDArray[np.intp]

    @cached_property
    def residual(self) -> Array:
        """Residuals, shape (M, n), zero in rows that are not used."""
        x, rows = self.values, self.rows
        each = zip(self.tables, rows.parameters, strict=True)
        return np.column_stack([_residual(table, parameters, x, rows.count) for table, parameters in each])

    @cached_property
    def autocorrelation(self) -> Array:
        """Autocorrelation time of the residual of each joint, shape (n,) [rows]."""
        return np.array([_autocorrelation_time(each, self.rows.rate) for each in self.residual.T])

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the parameters, shape (b + e, b + e); it is enlarged, because residuals are correlated."""
        scale = _lengths(self.factor)
        weight = 1.0 / (self.sigma * np.sqrt(self.autocorrelation))[self.joint]
        inverse = _inverse(self.factor / scale * weight[:, None])
        return (inverse @ inverse.T) / np.outer(scale, scale)

    @property
    def cost(self) -> float:
        """Mean over the joints of the logarithm of the RMS residual.

        A decrease by 0.1 means that the residuals are smaller by ten percent on average.
        """
        return float(np.mean(np.log(self.sigma)))

    @property
    def deviation(self) -> Array:
        """Standard deviations of the parameters, shape (b + e,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def make_rows(source: ColumnSource, log: DownsampledLog) -> QuickRows:
    """Computes the filtered columns and torque of a downsampled log."""
    parts = [all_rows(source, run, log.band) for run in log.runs]
    x = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
    offset, n = source.layout.offset, source.tree.n
    torque = np.column_stack([x[offset[j + 1] - 1] for j in range(n)])
    pick = [(run, run.rows) for run in log.runs]
    motion = Motion(
        np.concatenate([run.motion.time[rows] for run, rows in pick]),
        np.concatenate([run.motion.q[rows] for run, rows in pick]),
        np.concatenate([run.motion.dq[rows] for run, rows in pick]),
        np.concatenate([run.motion.ddq[rows] for run, rows in pick]),
    )
    return QuickRows(
        tuple(x[offset[j] : offset[j + 1] - 1] for j in range(n)),
        source.layout.parameters,
        len(source.names),
        motion,
        torque,
        log.mask,
        np.concatenate([np.full(len(run.rows), k) for k, run in enumerate(log.runs)]),
        log.runs[0].rate / log.runs[0].step,
    )


def solve(rows: QuickRows, extra: Array | None = None) -> QuickFit:
    """Solves weighted least squares, in which each joint is weighted by its residual.

    Args:
        rows: Columns and torque.
        extra: Columns of additional parameters, shape (e, M, n): torque of each joint for a unit of the parameter.
    """
    extras = 0 if extra is None else len(extra)
    total = rows.count + extras
    blocks: list[Array] = []
    sides: list[Array] = []
    joints: list[NDArray[np.intp]] = []
    filled: list[Array] = []
    counted = np.maximum(rows.mask.sum(axis=0), 1)
    for j, table in enumerate(tables(rows, extra)):
        filled.append(table)
        R = kernel.factor_columns(table)[0]
        wide = np.zeros((len(R), total))
        wide[:, np.concatenate([rows.parameters[j], np.arange(rows.count, total)])] = R[:, :-1]
        blocks.append(wide)
        sides.append(R[:, -1])
        joints.append(np.full(len(R), j))
    A, y, joint = np.concatenate(blocks), np.concatenate(sides), np.concatenate(joints)
    size = np.array([np.linalg.norm(side) for side in sides]) / np.sqrt(counted)
    size = np.where(size > 0.0, size, 1.0)
    scale = _lengths(A)
    sigma = size
    x = np.zeros(total)
    for _ in range(PASSES):
        weight = 1.0 / sigma[joint]
        x = _least_squares(np.column_stack([A / scale, y]) * weight[:, None]) / scale
        remaining = np.bincount(joint, (y - A @ x) ** 2, minlength=rows.n)
        before, sigma = sigma, np.maximum(np.sqrt(remaining / counted), FLOOR * size)
        if (np.abs(sigma - before) < SETTLED * sigma).all():
            break
    return QuickFit(x, sigma, rows, tuple(filled), A, y, joint)


def solve_joint(fit: QuickFit, j: int, rows: QuickRows) -> QuickFit:
    """Fits one joint with separate parameters, using its triangular factor from a fit of all joints.

    Args:
        fit: Fit of all joints, without extra columns.
        j: Index of the joint.
        rows: Rows of this joint alone, with separate parameters.
    """
    own = fit.joint == j
    A, y = fit.factor[own][:, fit.rows.parameters[j]], fit.side[own]
    scale = _lengths(A)
    x = _least_squares(np.column_stack([A / scale, y])) / scale
    counted = max(int(rows.mask.sum()), 1)
    size = float(np.linalg.norm(y)) / np.sqrt(counted)
    sigma = max(float(np.linalg.norm(y - A @ x)) / np.sqrt(counted), FLOOR * (size or 1.0))
    return QuickFit(x, np.array([sigma]), rows, (fit.tables[j],), A, y, np.zeros(len(y), dtype=np.intp))


def _lengths(A: Array) -> Array:
    """Euclidean norms of the columns of a matrix; 1 for columns that are zero."""
    scale = np.linalg.norm(A, axis=0)
    return np.where(scale > 0.0, scale, 1.0)


def _inverse(A: Array) -> Array:
    """Matrix X with X Xᵀ = (Aᵀ A)⁺: inverse of the triangular factor, or the pseudoinverse of dependent columns."""
    R = kernel.factor_columns(A.T)[0]
    diagonal = np.abs(R.diagonal())
    if diagonal.min() > INDEPENDENT * diagonal.max():
        return np.asarray(np.linalg.inv(R), dtype=np.float64)  # an eighth of the time of singular values
    return np.asarray(np.linalg.pinv(R, rcond=CUT), dtype=np.float64)


def _least_squares(A: Array) -> Array:
    """Coefficients (k,) with which the first k columns fit the last column best, in the sense of least squares.

    If the first k columns are linearly dependent, the coefficients with the smallest norm are returned.
    """
    R = kernel.factor_columns(A.T)[0]
    k = A.shape[1] - 1
    diagonal = np.abs(R.diagonal()[:k])
    if diagonal.min() > INDEPENDENT * diagonal.max():
        return np.asarray(np.linalg.solve(R[:k, :k], R[:k, k]), dtype=np.float64)
    return np.asarray(np.linalg.lstsq(R[:, :k], R[:, k], rcond=CUT)[0], dtype=np.float64)


def products(rows: QuickRows, extra: Array | None = None) -> tuple[Array, ...]:
    """Scalar products of columns, extra columns and torque of each joint, shape (k + e + 1, k + e + 1) each.

    Args:
        rows: Columns and torque.
        extra: Columns of e additional parameters, shape (e, M, n).
    """
    return tuple(table @ table.T for table in tables(rows, extra))


def tables(rows: QuickRows, extra: Array | None = None, mask: NDArray[np.bool_] | None = None) -> Iterator[Array]:
    """Columns, extra columns and torque of each joint, shape (k + e + 1, M) each; zero in rows that are not used.

    Args:
        rows: Columns and torque.
        extra: Columns of e additional parameters, shape (e, M, n).
        mask: Mask of the rows that are used, shape (M, n); if not given, that of `rows`.
    """
    counts = rows.mask if mask is None else mask
    extras, every = 0 if extra is None else len(extra), bool(counts.all())
    for j, columns in enumerate(rows.columns):
        k = len(columns)
        table = np.empty((k + extras + 1, len(rows.torque)))
        table[:k] = columns
        if extra is not None:
            table[k:-1] = extra[:, :, j]
        table[-1] = rows.torque[:, j]
        if not every:
            table *= counts[:, j]
        yield table


def cost_of(rows: QuickRows, pairs: Sequence[Array], sign: Array | None = None) -> float:
    """Computes `solve(rows).cost` from scalar products of columns, in a tenth of the time.

    Args:
        rows: The rows, of which only the parameters are used.
        pairs: Scalar products of the columns, from `products`.
        sign: Factor by which the torque of each joint is multiplied, shape (n,); 1 if not given.
    """
    return float(np.mean(np.log(solve_products(rows, pairs, np.maximum(rows.mask.sum(axis=0), 1), sign)[1])))


def solve_coarsely(rows: QuickRows, extra: Array | None = None) -> tuple[Array, Array]:
    """Solves the least squares of `solve` from scalar products, in a third of the time and with half of the digits.

    Args:
        rows: Columns and torque.
        extra: Columns of e additional parameters, shape (e, M, n).

    Returns:
        Parameters, shape (b + e,), and RMS residual of each joint, shape (n,) [N·m or N].
    """
    wide, pairs = rows, products(rows, extra)
    if extra is not None:
        numbers = np.arange(rows.count, rows.count + len(extra), dtype=np.int32)
        parameters = tuple(np.append(own, numbers) for own in rows.parameters)
        wide = replace(rows, parameters=parameters, count=rows.count + len(extra))
    return solve_products(wide, pairs, np.maximum(rows.mask.sum(axis=0), 1))


def solve_products(
    rows: QuickRows,
    pairs: Sequence[Array],
    counted: NDArray[np.int64],
    sign: Array | None = None,
    ridge: float = RIDGE,
) -> tuple[Array, Array]:
    """Solves weighted least squares from scalar products: parameters (b,) and RMS residual of each joint (n,).

    Args:
        rows: The rows, of which only the parameters are used.
        pairs: Scalar products of the columns (see `products`), over all rows or over some of the rows.
        counted: Number of rows of each joint in these products, shape (n,).
        sign: Factor by which the torque of each joint is multiplied, shape (n,); 1 if not given.
        ridge: Number that is added to the diagonal of the products of unit columns.
    """
    return kernel.reweighted_least_squares(
        pairs,
        rows.parameters,
        rows.count,
        counted,
        sign,
        passes=PASSES,
        settled=SETTLED,
        floor=COARSE_FLOOR,
        ridge=ridge,
    )


def _residual(table: Array, parameters: NDArray[np.int32], x: Array, count: int) -> Array:
    """Residual of the torque of one joint, shape (M,).

    Args:
        table: Columns, extra columns and torque of the joint, shape (k + e + 1, M).
        parameters: Indices of the joint's parameters among all base parameters, shape (k,).
        x: Parameters, shape (b + e,).
        count: Number b of base parameters.
    """
    return table[-1] - np.concatenate([x[parameters], x[count:]]) @ table[:-1]


def _autocorrelation_time(residual: Array, rate: float) -> float:
    """Integrated autocorrelation time [rows] of a residual: 1 + 2 Σ of its correlations, with Bartlett's window."""
    lags = min(int(LONGEST_LAG * rate), len(residual) // 4)
    power = float(residual @ residual)
    if lags < 1 or power <= 0.0:
        return 1.0
    taper = 1.0 - np.arange(1, lags + 1) / (lags + 1)
    correlation = np.array([float(residual[k:] @ residual[:-k]) for k in range(1, lags + 1)]) / power
    return max(1.0, 1.0 + 2.0 * float(taper @ correlation))

"""Kernel function for least-squares fits in which each joint is weighted by its residual [Holland1977]."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

import armid.kernel._native as _native
from armid.checked_array import Array
from armid.errors import ArmidError
from armid.kernel import reference_reweighted_solver
from armid.kernel.dispatch import TWIN, in_use


def reweighted_least_squares(
    products: Sequence[Array],
    parameters: Sequence[NDArray[np.int32]],
    count: int,
    rows: ArrayLike,
    sign: ArrayLike | None = None,
    *,
    passes: int,
    settled: float,
    floor: float,
    ridge: float,
    chosen: str | None = None,
) -> tuple[Array, Array]:
    """Iteratively reweighted least squares for all joints with common parameters, from products of columns.

    In each iteration (pass), the weight of a joint is one divided by the square of its RMS residual in the iteration
    before; in the first iteration, one divided by the square of the RMS of its torque. The normal equations of
    columns of unit length are solved, so the relative error of the parameters is ε times the square of the condition
    number of these columns.

    Args:
        products: For each joint, the matrix of products of its k columns and, last, its torque, shape (k + 1, k + 1).
        parameters: For each joint, the indices of the parameters of its columns, in ascending order, shape (k,).
        count: Number b of parameters.
        rows: Number of rows of each joint, shape (n,).
        sign: Factor on the torque of each joint, shape (n,); 1 if not given.
        passes: Largest number of iterations.
        settled: The iteration ends if the relative change of every RMS residual is below this number.
        floor: Smallest ratio of the RMS residual of a joint to the RMS of its torque.
        ridge: Number that is added to the diagonal of the products of unit columns. Parameters that the torque does
            not depend on are then zero.
        chosen: Build of the kernel.

    Returns:
        Parameters (b,) and RMS residual of each joint (n,).

    Raises:
        ArmidError: A shape is wrong, the parameters of a joint are not in ascending order, a joint has no rows,
            `passes` is less than one, or `ridge` is not positive.
    """
    n = len(parameters)
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    sign = np.ones(n) if sign is None else np.ascontiguousarray(sign, dtype=np.float64)
    shapes = [(len(own) + 1, len(own) + 1) for own in parameters]
    if [P.shape for P in products] != shapes or rows.shape != (n,) or sign.shape != (n,):
        found = f"products {[P.shape for P in products]}, rows {rows.shape}, sign {sign.shape}"
        raise ArmidError(f"Expected products {shapes}, rows ({n},) and sign ({n},); found {found}.")
    if not (passes >= 1 and ridge > 0.0 and (rows > 0.0).all()):
        found = f"{passes} passes, a ridge of {ridge:g} and rows {rows.tolist()}"
        raise ArmidError(f"`passes`, `ridge` and the rows of every joint must be positive; found {found}.")
    offset, flat = _flat(tuple(np.asarray(own, dtype=np.int32).tobytes() for own in parameters), count)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_reweighted_solver.reweighted_least_squares(
            products, parameters, count, rows, sign, passes=passes, settled=settled, floor=floor, ridge=ridge
        )
    x, sigma = np.empty(count), np.empty(n)
    values = np.concatenate(products, axis=None, dtype=np.float64)
    _native.reweighted(chosen, offset, flat, values, sign, rows, passes, settled, floor, ridge, x, sigma)
    return x, sigma


@lru_cache(maxsize=32)
def _flat(parameters: tuple[bytes, ...], count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Index of the first column of each joint, and the number of columns, shape (n + 1,); parameters of all columns.

    Args:
        parameters: Parameters of the columns of each joint, as bytes of 32-bit integers.
        count: Number of parameters.

    Raises:
        ArmidError: The parameters of a joint are not in ascending order, or are not between 0 and `count` - 1.
    """
    each = [np.frombuffer(own, dtype=np.int32) for own in parameters]
    if any((np.diff(own) <= 0).any() or (len(own) and not 0 <= own[0] <= own[-1] < count) for own in each):
        found = [own.tolist() for own in each]
        raise ArmidError(
            f"The parameters of each joint must be indices from 0 to {count - 1} in ascending order; found {found}."
        )
    offset = np.concatenate([[0], np.cumsum([len(own) for own in each])]).astype(np.int32)
    return offset, np.concatenate(each)

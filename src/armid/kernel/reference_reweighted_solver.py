"""NumPy twin of the kernel's iteratively reweighted least squares from products of columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array


def reweighted_least_squares(
    products: Sequence[Array],
    parameters: Sequence[NDArray[np.int32]],
    count: int,
    rows: Array,
    sign: Array,
    *,
    passes: int,
    settled: float,
    floor: float,
    ridge: float,
) -> tuple[Array, Array]:
    """Parameters (count,) and RMS residual of each joint (n,) by iteratively reweighted least squares.

    The arguments are those of `armid.kernel.reweighted_solver.reweighted_least_squares`.
    """
    n = len(products)
    # Products of all parameters and the torque, zero for parameters that a joint's torque does not depend on.
    whole = np.zeros((n, count + 1, count + 1))
    for j, (P, own) in enumerate(zip(products, parameters, strict=True)):
        at = np.append(own, count)
        whole[j, at[:, None], at] = P
    whole[:, count] *= sign[:, None]
    whole[:, :, count] *= sign[:, None]
    size = np.sqrt(whole[:, count, count] / rows)
    size = np.where(size > 0.0, size, 1.0)
    sigma, x = size, np.zeros(count)
    for _ in range(passes):
        H = np.einsum("j,jab->ab", sigma**-2, whole)
        scale = np.sqrt(np.maximum(H.diagonal()[:count], np.finfo(float).tiny))
        G = H[:count, :count] / np.outer(scale, scale) + ridge * np.eye(count)
        x = np.linalg.solve(G, H[:count, count] / scale) / scale
        residual = np.append(-x, 1.0)
        power = np.einsum("jab,a,b->j", whole, residual, residual)
        before, sigma = sigma, np.maximum(np.sqrt(np.maximum(power, 0.0) / rows), floor * size)
        if (np.abs(sigma - before) < settled * sigma).all():
            break
    return x, sigma

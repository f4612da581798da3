"""Directional forgetting for blocks of rows: old information is forgotten only if new rows replace this information.

Exponential forgetting discounts all information by the same factor. The information about directions that the motion
no longer excites then tends to zero, and rounding errors move the estimate far along these directions (wind-up). So
only information that new rows replace is forgotten [Cao2000], here for whole blocks of rows of all joints, and only
for parameters that may change [Vahidi2005].

For the stored rows R and the rows B of a new block, there are coordinates, given by a matrix W, in which both normal
matrices are diagonal: Rᵀ R = Wᵀ W and Bᵀ B = Wᵀ g W with a diagonal matrix g. In direction i, the block has g_i times
the stored information. With a discount factor λ, the share

    f_i = min(1 - λ, RETURN g_i)

of the stored information in direction i is forgotten. The share λ is kept in the discounted factors, and the
remaining share 1 - λ - f_i is kept as rows √(1 - λ - f_i) W_i. If g_i ≥ (1 - λ) / RETURN, f_i is 1 - λ and forgetting
is exponential; if the block has no information in direction i, nothing is forgotten. In [Lai2024] a threshold decides
between these two cases; here the transition is linear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

RETURN = 100.0
"""Largest ratio of forgotten to new information in a direction. If the amplitude of the motion is a tenth of the
earlier amplitude, forgetting is still exponential. If noise gives a millionth of the stored information, at most a
10 000th of the stored information is forgotten."""


def retained_rows(whole: Array, block: Array, share: float, changing: NDArray[np.bool_]) -> Array:
    """Computes the rows that remain when a new block replaces a share of the stored information.

    Args:
        whole: All stored information, as triangular whitened rows with the right-hand side last, shape (b, b + 1).
        block: The new block, as triangular whitened rows with the right-hand side last, shape (b, b + 1).
        share: Share 1 - λ of the information that is to be forgotten, from 0 to 1.
        changing: Mask of the parameters that may change, shape (b,); information about other parameters is not
            forgotten.

    Returns:
        Whitened rows with the right-hand side last, shape (b, b + 1). The normal matrix after forgetting is the sum
        of the normal matrix of these rows and λ times the stored normal matrix.
    """
    b = len(changing)
    kept = np.zeros((b, b + 1))
    if share <= 0.0:
        return kept
    c = int(changing.sum())
    if c == 0:
        return np.sqrt(share) * whole
    order, stored = _changing_first(whole, changing)
    new = block[:, :-1] if c == b else np.asarray(np.linalg.qr(block[:, order[:c]], mode="r"))
    Q = np.linalg.qr(np.vstack([stored[:c, :c], new]))[0]
    U, cosine, _ = np.linalg.svd(Q[:c])
    gained = np.maximum(1.0 - cosine**2, 0.0)
    forgotten = np.minimum(share, RETURN * gained / np.maximum(cosine**2, RETURN * np.finfo(np.float64).tiny))
    kept[:c] = np.sqrt(share - forgotten)[:, None] * (U.T @ stored[:c])
    kept[c:] = np.sqrt(share) * stored[c:]
    kept[:, order] = kept.copy()
    return kept


def discount(whole: Array, changing: NDArray[np.bool_], jump: Array) -> Array:
    """Reduces the stored information to the part that is still valid after a sudden change of parameters.

    The estimate stays the same. The conditional covariance of the changing parameters, given all other parameters,
    increases by the covariance of the change. The information about the other parameters stays the same.

    Args:
        whole: All stored information, which must determine all parameters, as triangular whitened rows with the
            right-hand side last, shape (b, b + 1).
        changing: Mask of the parameters that may have changed, shape (b,).
        jump: Standard deviations of the change, shape (b,); values for parameters that do not change are not used.
    """
    c = int(changing.sum())
    order, stored = _changing_first(whole, changing)
    size = jump[order[:c]]
    # In units of the jump, (R Rᵀ)⁻¹ + 1 is well scaled for all units of the parameters.
    root = np.linalg.inv(stored[:c, :c] * size)
    share, directions = np.linalg.eigh(root @ root.T + np.eye(c))
    half = (directions / np.sqrt(share)).T
    rows = np.zeros_like(whole)
    rows[:, order[c:]] = stored[:, c:]
    rows[:c, order] = half @ root @ stored[:c]
    return rows


def _changing_first(whole: Array, changing: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Array]:
    """Order of the columns (changing parameters first, right-hand side last), and triangular factor in this order.

    Args:
        whole: Triangular whitened rows with the right-hand side last, shape (b, b + 1).
        changing: Mask of the parameters that may change, shape (b,).
    """
    b = len(changing)
    order = np.concatenate([np.flatnonzero(changing), np.flatnonzero(~changing), [b]])
    if changing.all():
        return order, whole
    return order, np.asarray(np.linalg.qr(whole[:, order], mode="r"), dtype=np.float64)[:b]

"""Forgetting by a block of rows, and what has to be put aside before it is lost.

Exponential forgetting takes the same share of everything that is known. Directions that the motion no longer shows
then lose all of it, and the first rounding error that looks like them moves the estimate far: it winds up. So only
what new rows replace is forgotten [Cao2000], here for whole blocks of rows of all joints, and only in the parameters
that may change at all [Vahidi2005].

Stored rows R and those of a block B have coordinates in which both are diagonal, Rᵀ R = Wᵀ W and Bᵀ B = Wᵀ g W. In
direction i the block has g_i times the information that is stored there. Of a share 1 - λ,

    f_i = min(1 - λ, RETURN g_i)

is forgotten and the rest put aside, as rows √(1 - λ - f_i) W_i. Where a memory of 1 / (1 - λ) such blocks would leave
more than a RETURN-th of what is stored, f_i = 1 - λ and forgetting is exponential; where the block says nothing,
nothing is lost. [Lai2024] draws a border between the two and forgets fully on one side of it; here it is a slope.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.values import Array

__all__ = ["RETURN", "discount", "retained_rows"]

RETURN = 100.0
"""Most information that is given up for a unit of new. Down to a tenth of the amplitude of the motion that taught a
direction, a direction is forgotten as fast as asked; noise of a millionth of the information costs a 10 000th."""


def retained_rows(whole: Array, block: Array, share: float, changing: NDArray[np.bool_]) -> Array:
    """Rows that are to be kept when a share of all stored information is given up for a block.

    Args:
        whole: All that is stored, triangular whitened rows with their side last, shape (b, b + 1).
        block: The new block likewise, shape (b, b + 1).
        share: 1 - λ, in [0, 1].
        changing: Parameters that may change, shape (b,); what is known of the others, whatever these are, stays.

    Returns:
        Whitened rows with their side last, shape (b, b + 1); Σ of their squares and of λ times what is stored is what
        is left after forgetting.
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
    """Rows that are left, (b, b + 1), once parameters have changed at once; the values stay until rows say more.

    The covariance of those that may change, the others given, grows by that of the jump. What is known of the others
    stays. It grows by so much each time, not as often: what no motion shows is never lost in rounding.

    Args:
        whole: All that is stored, which determines all parameters, as in `retained_rows`.
        changing: Parameters that may have changed, shape (b,).
        jump: Standard deviations of the change, shape (b,); only those of what may change count.
    """
    c = int(changing.sum())
    order, stored = _changing_first(whole, changing)
    size = jump[order[:c]]
    # In units of the jump (R Rᵀ)⁻¹ + 1 is well scaled, whatever the units.
    root = np.linalg.inv(stored[:c, :c] * size)
    share, directions = np.linalg.eigh(root @ root.T + np.eye(c))
    half = (directions / np.sqrt(share)).T
    left = np.zeros_like(whole)
    left[:, order[c:]] = stored[:, c:]
    left[:c, order] = half @ root @ stored[:c]
    return left


def _changing_first(whole: Array, changing: NDArray[np.bool_]) -> tuple[NDArray[np.intp], Array]:
    """Order of the columns with those that may change first and the side last, and the rows, triangular in it."""
    b = len(changing)
    order = np.concatenate([np.flatnonzero(changing), np.flatnonzero(~changing), [b]])
    if changing.all():
        return order, whole
    return order, np.asarray(np.linalg.qr(whole[:, order], mode="r"), dtype=np.float64)[:b]

"""Whiteness of residuals: the test that the textbook's intervals have to pass.

Were the noise white and alike on all weighted rows, the spectrum of the residual would be flat but for what the
estimate took out of it, joints would have nothing in common, and no joint and no part of the time would be noisier
than another. All of that has known means and variances, so what is found is compared with chi-squared, as Ljung and
Box do with autocorrelations [Ljung1978]; here the estimate's own share in the residual is accounted for frequency
by frequency.
"""

from __future__ import annotations

import numpy as np

from armid.estimation.uncertainty.noise_spectrum import NoiseModel
from armid.values import Array

__all__ = ["even", "flat", "whiteness"]


def whiteness(model: NoiseModel, moments: Array, squares: Array, pieces: Array, rows: Array) -> float:
    """Probability of residuals as far from white as these, if the noise were white; small means coloured.

    Args:
        model: Equations for the levels of the noise.
        moments: Products of residuals in each band, shape (E, n, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        pieces: Sum of squares and number of rows of parts of the time, shape (parts, 2, n).
        rows: Rows that counted, shape (n,).
    """
    return min(1.0, 2.0 * min(flat(model, moments, squares, rows), even(pieces, model.weights, model.bands.averaged)))


def flat(model: NoiseModel, moments: Array, squares: Array, rows: Array) -> float:
    """The same for the spectrum of each joint and for what joints have in common, whatever their levels.

    Args:
        model: Equations for the levels of the noise.
        moments: Products of residuals in each band, shape (E, n, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        rows: Rows that counted, shape (n,).
    """
    from scipy.special import chdtrc  # a third of a second to import

    spent = np.einsum("ejj->j", model.spent)
    level = np.sqrt(squares / np.maximum(rows - spent, 1.0)) * model.weights
    level = np.where(level > 0.0, level, 1.0)
    size = np.tile(level[model.pairs[0]] * level[model.pairs[1]], len(model.basis))
    own = np.tile(model.pairs[0] == model.pairs[1], len(model.basis)).astype(np.float64)
    combined = _combined(model)
    apart = combined @ (model.measured(moments) / size - model.left @ own)
    variance = 2.0 * combined @ model.left @ combined.T
    seen = np.diag(variance) > 0.0
    apart, variance = apart[seen], variance[np.ix_(seen, seen)]
    # The mean level of each joint is that of its rows by construction, unless these are means.
    free = len(apart) - (0 if model.bands.averaged else model.bands.n)
    return float(chdtrc(free, apart @ np.linalg.lstsq(variance, apart, rcond=None)[0]))


def even(pieces: Array, weights: Array, averaged: bool) -> float:
    """The same for the variances of joints, weighted, and of parts of the time.

    Args:
        pieces: Sum of squares and number of rows of each part, shape (parts, 2, n).
        weights: Weight of each joint's rows, shape (n,).
        averaged: Whether rows are means of others.
    """
    from scipy.special import chdtrc

    squares, rows = pieces[:, 0] * weights**2, pieces[:, 1]
    known = rows > 0.0
    level = squares.sum() / max(rows.sum(), 1.0)
    if level == 0.0:
        return 1.0
    apart = np.where(known, (squares - rows * level) ** 2 / (2.0 * level**2 * np.where(known, rows, 1.0)), 0.0)
    # Weights that differ were made from the joints' residuals, whose levels then agree by construction.
    made_alike = int(known.any(axis=0).sum()) if np.ptp(weights) > 0.0 and not averaged else 1
    free = int(known.sum()) - made_alike
    return float(chdtrc(free, apart.sum())) if free > 0 else 1.0


def _combined(model: NoiseModel) -> Array:
    """Levels of each joint as they are, those of two joints summed over all frequencies, shape (k, levels)."""
    B, P = len(model.basis), len(model.pairs[0])
    own = model.pairs[0] == model.pairs[1]
    alone = np.eye(B * P)[np.tile(own, B)]
    common = np.tile(np.eye(P)[~own], (1, B))
    return np.concatenate([alone, common])

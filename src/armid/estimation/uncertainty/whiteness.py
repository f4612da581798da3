"""Test of whiteness of the residuals, which decides whether white intervals are valid.

If the noise is white with equal variance in all weighted rows, the residuals have three properties: their spectrum is
flat except for the part that the fit removes, joints are uncorrelated, and all joints and all parts of the time have
the same variance. For each property there is a statistic with known mean and variance. The statistics are compared
with a chi-squared distribution, as Ljung and Box do for autocorrelations [Ljung1978]. The part that the fit removes
is taken into account at each frequency.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.uncertainty.noise_spectrum import NoiseModel
from armid.maths.distributions import chi_squared_survival


def whiteness(model: NoiseModel, moments: Array, squares: Array, parts: Array, rows: Array) -> float:
    """p-value of the hypothesis that the residuals are white; small values mean correlated residuals.

    Args:
        model: Equations for the levels of the noise.
        moments: Products of the unweighted residuals of two joints in each of E bands, shape (E, n, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        parts: Sum of squared residuals and number of rows in each of the P parts of the time, shape (P, 2, n).
        rows: Number of rows in use, shape (n,).
    """
    return min(
        1.0,
        2.0
        * min(
            spectrum_test(model, moments, squares, rows), variance_test(parts, model.weights, model.bands.averaged)
        ),
    )


def spectrum_test(model: NoiseModel, moments: Array, squares: Array, rows: Array) -> float:
    """p-value of the hypothesis that all joints have flat spectra of any level and are uncorrelated.

    Args:
        model: Equations for the levels of the noise.
        moments: Products of the unweighted residuals of two joints in each of E bands, shape (E, n, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        rows: Number of rows in use, shape (n,).
    """
    effective_dof = np.einsum("ejj->j", model.leverage)
    level = np.sqrt(squares / np.maximum(rows - effective_dof, 1.0)) * model.weights
    level = np.where(level > 0.0, level, 1.0)
    size = np.tile(level[model.pairs[0]] * level[model.pairs[1]], len(model.basis))
    is_diagonal = np.tile(model.pairs[0] == model.pairs[1], len(model.basis)).astype(np.float64)
    combined = _combined(model)
    difference = combined @ (model.measured(moments) / size - model.equations @ is_diagonal)
    variance = 2.0 * combined @ model.equations @ combined.T
    seen = np.diag(variance) > 0.0
    difference, variance = difference[seen], variance[np.ix_(seen, seen)]
    # The mean level of each joint equals that of its rows by construction, unless the rows are averages.
    free = len(difference) - (0 if model.bands.averaged else model.bands.n)
    return chi_squared_survival(free, float(difference @ np.linalg.lstsq(variance, difference, rcond=None)[0]))


def variance_test(parts: Array, weights: Array, averaged: bool) -> float:
    """p-value of the hypothesis that all weighted joints and all parts of the time have equal variances.

    Args:
        parts: Sum of squared residuals and number of rows in each of the P parts of the time, shape (P, 2, n).
        weights: Weight of each joint's rows, shape (n,).
        averaged: True if rows are averages of several samples.
    """
    squares, rows = parts[:, 0] * weights**2, parts[:, 1]
    known = rows > 0.0
    level = squares.sum() / max(rows.sum(), 1.0)
    if level == 0.0:
        return 1.0
    difference = np.where(known, (squares - rows * level) ** 2 / (2.0 * level**2 * np.where(known, rows, 1.0)), 0.0)
    # Unequal weights were computed from the joints' residuals, so that their levels are equal by construction.
    equalised = int(known.any(axis=0).sum()) if np.ptp(weights) > 0.0 and not averaged else 1
    free = int(known.sum()) - equalised
    return chi_squared_survival(free, float(difference.sum())) if free > 0 else 1.0


def _combined(model: NoiseModel) -> Array:
    """Matrix (k, levels) that selects the levels of joints and sums the levels of each pair over all frequencies."""
    B, P = len(model.basis), len(model.pairs[0])
    is_diagonal = model.pairs[0] == model.pairs[1]
    alone = np.eye(B * P)[np.tile(is_diagonal, B)]
    common = np.tile(np.eye(P)[~is_diagonal], (1, B))
    return np.concatenate([alone, common])

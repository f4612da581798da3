"""The block bootstrap: a slow witness of covariances that assumes nothing of the noise but that blocks are alike."""

from __future__ import annotations

import numpy as np

from armid.estimation.fit import Fit
from armid.estimation.uncertainty.jackknife import block_products, group_blocks
from armid.information.information import Information
from armid.values import Array

__all__ = ["bootstrap"]


def bootstrap(fit: Fit, information: Information, *, draws: int = 1000, seed: int = 0, together: int = 1) -> Array:
    """Estimates from blocks drawn with replacement, as many as there are, with the weights of the fit.

    Args:
        fit: As the estimator gave it.
        information: What it was made from, blocks apart.
        draws: Number of estimates.
        seed: Of the drawing.
        together: Neighbouring blocks that are drawn as one.

    Returns:
        Estimates, shape (draws, b). Their covariance is that of the estimate, their quantiles are its intervals.
    """
    groups = group_blocks(information, together)
    scale = np.ones(len(fit.values))
    normal, gradient = block_products(information, groups, fit.values, fit.weights, scale)
    prior = np.zeros_like(normal[0]) if fit.prior_precision is None else fit.prior_precision
    pull = -gradient.sum(axis=0)  # of the prior, which balances the data at the estimate
    rng = np.random.default_rng(seed)
    count = len(normal)
    found = np.empty((draws, len(fit.values)))
    for k in range(draws):
        times = rng.multinomial(count, np.full(count, 1.0 / count)).astype(np.float64)
        H = np.tensordot(times, normal, 1) + prior
        length = np.sqrt(np.diag(H))
        length = np.where(length > 0.0, length, 1.0)
        # Blocks that leave a direction unseen do not move the estimate along it.
        change = np.linalg.lstsq(H / np.outer(length, length), (times @ gradient + pull) / length, rcond=None)[0]
        found[k] = fit.values + change / length
    return found

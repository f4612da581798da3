"""Block bootstrap: a slow check of covariances that assumes only that the blocks are exchangeable."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.jackknife import block_products, group_blocks
from armid.information.information import Information


def bootstrap(fit: Fit, information: Information, *, draws: int = 1000, seed: int = 0, per_group: int = 1) -> Array:
    """Computes estimates from blocks drawn with replacement, with the weights of the fit.

    Args:
        fit: Fit of an estimator.
        information: Information of the fit, with separate blocks.
        draws: Number of estimates.
        seed: Seed of the random numbers.
        per_group: Number of neighbouring blocks that are drawn together.

    Returns:
        Estimates, shape (draws, b). Their covariance is the covariance of the estimate; their quantiles give
        intervals.
    """
    groups = group_blocks(information, per_group)
    scale = np.ones(len(fit.values))
    normal, gradient = block_products(information, groups, fit.values, fit.weights, scale)
    prior = np.zeros_like(normal[0]) if fit.prior_precision is None else fit.prior_precision
    prior_gradient = -gradient.sum(axis=0)  # of the prior, which balances the data at the estimate
    rng = np.random.default_rng(seed)
    count = len(normal)
    estimates = np.empty((draws, len(fit.values)))
    for k in range(draws):
        times = rng.multinomial(count, np.full(count, 1.0 / count)).astype(np.float64)
        H = np.tensordot(times, normal, 1) + prior
        length = np.sqrt(np.diag(H))
        length = np.where(length > 0.0, length, 1.0)
        # Blocks that do not determine a direction leave the estimate unchanged along it.
        change = np.linalg.lstsq(
            H / np.outer(length, length), (times @ gradient + prior_gradient) / length, rcond=None
        )[0]
        estimates[k] = fit.values + change / length
    return estimates

"""Scales of the covariance of a prior, estimated from the difference between the data and the mean of the prior.

The weight of a prior is chosen by its error on held-out motion, or given. This one number describes how close all
links are to the description. A strong prior may predict well although single links differ more from the description
than the prior says, so intervals must not rely on it. The least-squares parameters π̂ of whitened rows R, with noise
of variance c in each row, differ from the mean π₀ of the prior by

    R (π̂ - π₀) ~ N(0, c I + R (Σ_l s_l B_l + F) Rᵀ),

with the covariances B_l of mass, centre of mass and inertia of each link, and F of all other parameters. The scales
s_l are estimated by maximum likelihood [Harville1977] with a weak prior, and they are never below one: a prior may be
wider than it says, not narrower.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.estimation.problem import StandardParameters
from armid.maths.linalg import half_of

PASSES = 40
"""Number of steps of the fixed-point iteration. Each step reduces the error of the logarithm of a scale to at most a
half."""

PARTS = (slice(0, 1), slice(1, 4), slice(4, 10))
"""Positions of mass, first moments and second moments among the ten parameters of a link."""

FREEDOM = 1.0
"""Weight of the prior of each scale, as an equivalent number of parameters: if the data determine one parameter of
the scale, data and prior have equal weight."""

LARGEST = 1e6
"""Largest scale of a covariance: a link may differ from the description by a thousand standard deviations."""


def link_covariances(precision: Array, standard: StandardParameters) -> Array:
    """Covariances of the p standard parameters that follow from the prior, in three parts for each link.

    The parts belong to the columns of a triangular factor of the link's covariance: variation of the mass, with the
    other parameters that vary with it; of the first moments at a given mass; and of the inertia at given mass and
    first moments. The shape is (3 · links, p, p).

    Args:
        precision: Precision of the prior, without correlations between links, shape (p, p).
        standard: Standard parameters.
    """
    result = np.zeros((len(standard.inertial), len(PARTS), *precision.shape))
    for own, parts in zip(standard.inertial, result, strict=True):
        half = half_of(precision[np.ix_(own, own)])
        upper: Any = np.linalg.qr(half.T, mode="r")
        root = upper.T  # lower triangular, with the same covariance root rootᵀ
        for part, covariance in zip(PARTS, parts, strict=True):
            covariance[np.ix_(own, own)] = root[:, part] @ root[:, part].T
    return result.reshape(-1, *precision.shape)


def prior_scales(
    rows: Array, difference: Array, links: Array, others: Array, correlation: float, *, expected: float = 1.0
) -> Array:
    """Factors on parts of the prior's covariance with which it agrees with the data, at least 1, shape (parts,).

    Args:
        rows: Whitened rows, shape (k, b).
        difference: Least-squares parameters minus mean of the prior, shape (b,).
        links: Parts of the covariance of the base parameters by the prior of the links, shape (parts, b, b).
        others: Covariance of the base parameters by the prior of all other parameters, shape (b, b).
        correlation: Variance of the noise of a whitened row: number of rows that count as one independent sample.
        expected: Scale that the prior of the scales prefers.
    """
    misfit = rows @ difference
    spreads = rows @ links @ rows.T
    each = spreads.reshape(len(links), -1)
    noise = correlation * np.eye(len(rows)) + rows @ others @ rows.T
    scales = np.full(len(links), max(expected, 1.0))
    for _ in range(PASSES):
        inverse = np.linalg.inv(noise + (scales @ each).reshape(noise.shape))
        pulled = inverse @ misfit
        found = spreads @ pulled @ pulled
        by_chance = each @ inverse.ravel()
        scales = scales * np.sqrt((found + FREEDOM * expected / scales**2) / (by_chance + FREEDOM / scales))
        scales = np.clip(scales, 1.0, LARGEST)
    return scales

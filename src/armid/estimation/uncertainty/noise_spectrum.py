"""The noise of a recording as a spectrum, and the covariance of an estimate that it makes.

The residual is no picture of the noise: the estimate has taken its part out of it, most where the motion is, which is
where it matters. With weighted rows X̃, r̃ and M = 1 - X̃ H⁻¹ X̃ᵀ, noise with covariance Γ = Σ_c θ_c E_c leaves

    E[r̃ᵀ E_a r̃] = Σ_c tr(E_a M E_c M) θ_c,        cov = H⁻¹ X̃ᵀ Γ X̃ H⁻¹.

E_c is the part of the noise that one pair of joints shares around one frequency. The left side is what was measured
and the traces are known, so the levels θ follow from linear equations without bias [Rao1971], whatever the colour of
the noise; how well they are known gives each parameter's interval its own degrees of freedom [Satterthwaite1946].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.estimation.uncertainty.frequency_bands import BandProducts
from armid.maths.linalg import root_of
from armid.values import Array

__all__ = ["LARGEST", "LevelScatter", "NoiseModel", "leverages"]

FIRST = 10.0
"""Real numbers of the spectrum below the second knot, as few as give the lowest level any certainty."""

TOWARDS_POOLED = 10.0
"""Degrees of freedom with which correlations between joints at one frequency are drawn to those at all."""

SMALLEST_LEVEL = 1e-3
"""Smallest level at a frequency over the joint's mean level: below it the estimate of the level is noise."""

FAINT = 2e-2
"""Level at a frequency over the joint's mean level below which it says nothing about correlations."""

SMALLEST_CORRELATION = 1e-2
"""Smallest eigenvalue of correlations between joints."""

SLIGHT = 1e-3
"""Observations of white noise that the equations are given beside the data, so that they can be solved where a joint
has no rows."""

FEWEST_FREE = 2.0
"""Fewest degrees of freedom of a level; intervals are then more than twice as wide as those of many."""

LARGEST = 30_000_000
"""Numbers that the matrices of all levels may have: a quarter of a gigabyte."""


@dataclass(frozen=True, eq=False, slots=True)
class LevelScatter:
    """Effect of noise on an estimate.

    Attributes:
        covariance: Shape (b, b).
        freedom: Degrees of freedom of each variance, shape (b,).
        noise: Standard deviation of each joint's noise, shape (n,) [N·m or N].
    """

    covariance: Array
    freedom: Array
    noise: Array


class NoiseModel:
    """Equations for the levels of the noise, for one set of rows and weights.

    Attributes:
        basis: Share of each level in each band, shape (B, E); every band's shares sum to one.
        pairs: First and second joint of each pair, shapes (pairs,).
        left: tr(E_a M E_c M), shape (levels, levels), levels in the order frequency, pair of joints.
        spent: tr(H⁻¹ X̃_jᵀ P X̃_k) for the coefficients P of each band, shape (E, n, n).
        free: Real numbers that each level of one joint is seen in, less those that the estimate spent, shape (B, n).
    """

    def __init__(
        self,
        bands: BandProducts,
        weights: Array,
        inverse: Array,
        through: Sequence[Array] | None = None,
    ) -> None:
        """Set the equations up.

        Args:
            bands: Products of the rows.
            weights: Weight of each joint's rows, shape (n,).
            inverse: H⁻¹, prior included, shape (b, b).
            through: How the parameters of each joint's columns follow from b unknowns, shapes (c, b); the unknowns
                are the parameters where not given.
        """
        self.bands, self.weights = bands, weights
        self.basis = leverages(bands)
        self.pairs = np.triu_indices(bands.n)
        self.twice = np.where(self.pairs[0] == self.pairs[1], 1.0, 2.0)
        try:
            self.root = np.linalg.cholesky(inverse)
        except np.linalg.LinAlgError:  # directions that are known to all digits beside others that hardly are
            self.root = root_of(inverse)
        roots = [self.root] * bands.n if through is None else [each @ self.root for each in through]
        self.roots = [root[k] * w for root, k, w in zip(roots, bands.parameters, weights, strict=True)]
        self.spent = self._spent()
        self.free = self._free()
        self.packed, self.own = self._matrices()
        self.left = self.packed @ self.packed.T + self._diagonal() - self._leverage()

    @staticmethod
    def size(bands: BandProducts, count: int) -> int:
        """Numbers that the matrices of all levels have, for so many parameters."""
        return len(leverages(bands)) * bands.n * (bands.n + 1) // 2 * count * (count + 1) // 2

    def levels(self, moments: Array) -> Array:
        """Covariance of the noise at each frequency, in weighted units, shape (B, n, n).

        Args:
            moments: Products of residuals in each band, shape (E, n, n).
        """
        measured = self.measured(moments)
        slight = SLIGHT * np.tile(self.twice, len(self.basis))
        white = np.tile(self.pairs[0] == self.pairs[1], len(self.basis))
        theta = np.linalg.solve(self.left + np.diag(slight), measured + slight * white)
        return self._possible(self._square(np.asarray(theta, dtype=np.float64)))

    def scatter(self, moments: Array, squares: Array, rows: Array) -> LevelScatter:
        """Return what the noise behind these residuals does to the estimate.

        Args:
            moments: Products of residuals in each band, shape (E, n, n).
            squares: Sum of squared residuals, shape (n,).
            rows: Rows that counted, shape (n,).
        """
        levels = self.levels(moments)
        theta = levels[:, *self.pairs].ravel()
        b = len(self.root)
        inner = np.zeros((b, b))
        inner[np.triu_indices(b)] = (theta @ self.packed) / _packing(b)
        inner = inner + np.triu(inner, 1).T
        covariance = self.root @ inner @ self.root.T
        power = np.einsum("ae,ajj,ejj->j", self.basis, levels, self.bands.count)
        seen = np.einsum("ejj->j", moments) * self.weights**2
        taken = np.maximum(power - seen, 0.0) / self.weights**2
        return LevelScatter(covariance, self._freedom(levels), np.sqrt((squares + taken) / np.maximum(rows, 1.0)))

    def measured(self, moments: Array) -> Array:
        """r̃ᵀ E_a r̃ for each level, shape (levels,)."""
        weighted = moments * np.outer(self.weights, self.weights)
        found = np.tensordot(self.basis, weighted, (1, 0))[:, *self.pairs] * self.twice
        return np.asarray(found.ravel(), dtype=np.float64)

    def _matrices(self) -> tuple[Array, Array]:
        """Lᵀ X̃ᵀ E_c X̃ L in packed form (levels, b (b + 1) / 2), and the diagonals of H⁻¹ X̃ᵀ E_c X̃ H⁻¹."""
        bands, b = self.bands, len(self.root)
        own = self.roots
        upper, scale = np.triu_indices(b), _packing(b)
        packed = np.empty((len(self.basis), len(self.twice), len(scale)))
        variances = np.empty((len(self.basis), len(self.twice), b))
        offset = bands.offset
        for a, share in enumerate(self.basis):
            X = np.tensordot(share, bands.products, 1)
            right = [X[:, offset[k] : offset[k + 1]] @ own[k] for k in range(bands.n)]
            for c, (j, k) in enumerate(zip(*self.pairs, strict=True)):
                D = own[j].T @ right[k][offset[j] : offset[j + 1]]
                D = D if j == k else D + D.T
                packed[a, c] = D[upper] * scale
                variances[a, c] = np.einsum("ij,ij->i", self.root @ D, self.root)
        return packed.reshape(-1, len(scale)), variances

    def _diagonal(self) -> Array:
        """tr(E_a E_c), which only levels of the same pair have."""
        B, P = len(self.basis), len(self.twice)
        count = self.bands.count[:, *self.pairs] * self.twice
        result = np.zeros((B, P, B, P))
        for c in range(P):
            result[:, c, :, c] = (self.basis * count[:, c]) @ self.basis.T
        return result.reshape(B * P, B * P)

    def _leverage(self) -> Array:
        """tr(E_a E_c Q) + tr(E_c E_a Q) with Q = X̃ H⁻¹ X̃ᵀ."""
        B, P, n = len(self.basis), len(self.twice), self.bands.n
        taken = np.einsum("ae,ce,ejk->acjk", self.basis, self.basis, self.spent, optimize=True)
        one = np.zeros((P, n, n))
        one[np.arange(P), *self.pairs] = 1.0
        one[np.arange(P), self.pairs[1], self.pairs[0]] = 1.0
        product = np.einsum("cij,djk->cdik", one, one, optimize=True)
        half = np.einsum("abik,cdik->acbd", taken, product, optimize=True).reshape(B * P, B * P)
        return half + half.T

    def _spent(self) -> Array:
        """tr(H⁻¹ X̃_jᵀ P X̃_k) for the coefficients P of each band, shape (E, n, n)."""
        bands = self.bands
        rows = np.concatenate(self.roots)
        inverse, starts = rows @ rows.T, bands.offset[:-1]
        return np.stack(
            [np.add.reduceat(np.add.reduceat(X * inverse, starts, axis=0), starts, axis=1) for X in bands.products]
        )

    def _square(self, theta: Array) -> Array:
        """Levels (levels,) as symmetric matrices (B, n, n)."""
        levels = np.zeros((len(self.basis), self.bands.n, self.bands.n))
        levels[:, *self.pairs] = theta.reshape(len(self.basis), -1)
        levels[:, self.pairs[1], self.pairs[0]] = levels[:, *self.pairs]
        return levels

    def _possible(self, levels: Array) -> Array:
        """Positive levels, with correlations drawn to those of all frequencies, as few numbers determine each."""
        variance = np.einsum("ajj->aj", levels)
        mean = np.maximum(variance.mean(axis=0), SMALLEST_LEVEL)
        size = np.sqrt(np.maximum(variance, SMALLEST_LEVEL * mean))
        # Where there is hardly any noise, what joints seem to have in common says nothing.
        loud = variance > FAINT * mean
        free = self.free.mean(axis=1)[:, None, None] * (loud[:, :, None] & loud[:, None, :])
        correlation = np.clip(levels / size[:, :, None] / size[:, None, :], -1.0, 1.0)
        pooled = (free * correlation).sum(axis=0) / np.maximum(free.sum(axis=0), FEWEST_FREE)
        np.fill_diagonal(pooled, 1.0)
        correlation = (free * correlation + TOWARDS_POOLED * pooled) / (free + TOWARDS_POOLED)
        values, vectors = np.linalg.eigh(correlation)
        correlation = (vectors * np.maximum(values, SMALLEST_CORRELATION)[:, None, :]) @ vectors.transpose(0, 2, 1)
        unit = np.sqrt(np.einsum("ajj->aj", correlation))
        size = size / unit
        return correlation * size[:, :, None] * size[:, None, :]

    def _free(self) -> Array:
        """Real numbers that each level of one joint is seen in, less those that the estimate spent, shape (B, n)."""
        count = np.einsum("ae,ejj->aj", self.basis, self.bands.count)
        spent = np.einsum("ae,ejj->aj", self.basis, self.spent)
        return np.maximum(count - spent, FEWEST_FREE)

    def _freedom(self, levels: Array) -> Array:
        """Degrees of freedom of each parameter's variance, shape (b,)."""
        half = self.own / self.twice[None, :, None]
        share = np.zeros((*levels.shape, self.own.shape[2]))
        share[:, *self.pairs] = half
        share[:, self.pairs[1], self.pairs[0]] = half
        mixed = np.einsum("ajkp,akl->ajlp", share, levels, optimize=True)
        variance = np.einsum("ajjp->p", mixed)
        uncertain = self.free**-0.25
        scale = np.einsum("aj,ak->ajk", uncertain, uncertain)
        mixed = np.einsum("ajkp,akl->ajlp", share * scale[..., None], levels, optimize=True)
        spread = np.einsum("ajlp,aljp->p", mixed, mixed, optimize=True)
        return np.maximum(variance**2 / np.maximum(spread, np.finfo(float).tiny), 1.0)


def leverages(bands: BandProducts) -> Array:
    """Share of each level in each band, shape (B, E): levels stand an octave apart, with straight lines between."""
    count = np.einsum("ejj->e", bands.count) / bands.n
    reached = np.cumsum(count)
    first = float(bands.frequency[min(int(np.searchsorted(reached, FIRST)), len(reached) - 1)])
    knots: list[float] = [0.0, max(first, float(bands.frequency[min(1, len(reached) - 1)]))]
    while knots[-1] * 2.0 < bands.frequency[-1]:
        knots.append(knots[-1] * 2.0)
    at: NDArray[np.float64] = np.array(knots)
    shares = np.array([np.interp(bands.frequency, at, row) for row in np.eye(len(at))])
    return shares[shares.sum(axis=1) > 0.0]


def _packing(b: int) -> Array:
    """Factors of the upper triangle with which packed matrices have the inner product of whole ones."""
    rows, columns = np.triu_indices(b)
    return np.where(rows == columns, 1.0, np.sqrt(2.0))

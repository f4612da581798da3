"""Noise spectrum of a recording, and the covariance of an estimate under this noise.

Residuals are smaller than the noise, because the fit removes part of the noise, mostly at the frequencies that the
motion excites. Let X̃ be the weighted rows, r̃ the weighted residuals, H the normal matrix and M = 1 - X̃ H⁻¹ X̃ᵀ.
Noise with the covariance Γ = Σ_c θ_c E_c gives

    E[r̃ᵀ E_a r̃] = Σ_c tr(E_a M E_c M) θ_c,        cov = H⁻¹ X̃ᵀ Γ X̃ H⁻¹.

E_c is the covariance of unit noise of one pair of joints around one frequency, and θ_c the level of this noise. The
left side of the first equation is measured and the traces are known, so linear equations give unbiased levels θ
[Rao1971] for any spectrum of the noise. The uncertainty of the levels determines the degrees of freedom of each
parameter's interval [Satterthwaite1946].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.uncertainty.cross_products_by_frequency import BandProducts
from armid.maths.linalg import root_of

LOWEST_KNOT_SIZE = 10.0
"""Number of real numbers of the spectrum between the first two frequencies at which noise levels are estimated. It is
just enough to estimate the level at the first frequency, zero."""

POOLED_DOF = 10.0
"""Degrees of freedom of the prior with which the correlations between joints at one frequency are shrunk towards
the correlations over all frequencies."""

MIN_LEVEL = 1e-3
"""Lower limit of a noise level, divided by the joint's mean level: smaller estimates are not significant."""

MIN_FOR_CORRELATION = 2e-2
"""Smallest noise level, divided by the joint's mean level, with which a frequency is used to estimate correlations
between joints."""

MIN_CORRELATION_EIGENVALUE = 1e-2
"""Lower limit of an eigenvalue of the correlation matrix between joints."""

WHITE_PRIOR = 1e-3
"""Weight of a prior of white noise in the equations for the levels, as a number of observations. With this prior,
the equations can be solved even if a joint has no rows."""

FEWEST_FREE = 2.0
"""Lower limit of the degrees of freedom of a level. With this value intervals are more than twice as wide as with
many degrees of freedom."""

MAX_SIZE = 30_000_000
"""Largest number of elements in the matrices of all levels; these matrices take a quarter of a gigabyte."""


@dataclass(frozen=True, eq=False, slots=True)
class LevelScatter:
    """Effect of noise on an estimate.

    Attributes:
        covariance: Covariance of the estimate caused by the noise, shape (b, b).
        freedom: Degrees of freedom of each parameter's variance, shape (b,).
        noise: Standard deviation of each joint's noise, shape (n,) [N·m or N].
    """

    covariance: Array
    freedom: Array
    noise: Array


class NoiseModel:
    """Equations for the levels of the noise at several frequencies and for pairs of joints.

    In the formulas, X̃ are the weighted rows and X̃_j those of joint j, H is the normal matrix, E_c the covariance of
    noise with unit level c, and M = 1 - X̃ H⁻¹ X̃ᵀ.

    Attributes:
        basis: Weights with which the levels at B frequencies give the level in each of E bands, shape (B, E); the
            weights of a band add up to one.
        pairs: First and second joint of each pair, shapes (pairs,).
        equations: Coefficients tr(E_a M E_c M) of the levels, shape (levels, levels), ordered by frequency, then by
            pair.
        leverage: Traces tr(H⁻¹ X̃_jᵀ P X̃_k) for joints j and k, where P projects on the spectral coefficients of a
            band, shape (E, n, n).
        free: Degrees of freedom of each level of a joint: number of real numbers in its spectrum minus their
            leverage, shape (B, n).
    """

    def __init__(
        self,
        bands: BandProducts,
        weights: Array,
        inverse: Array,
        column_maps: Sequence[Array] | None = None,
    ) -> None:
        """Sets up the equations for the levels of the noise.

        Args:
            bands: Products of columns and of residuals in frequency bands.
            weights: Weight of each joint's rows, shape (n,).
            inverse: Inverse H⁻¹ of the weighted normal matrix, prior included, shape (b, b).
            column_maps: Matrices from b unknowns to the c parameters of each joint's columns, shapes (c, b); if not
                given, identity matrices.
        """
        self.bands, self.weights = bands, weights
        self.basis, self.pairs = level_basis(bands), np.triu_indices(bands.n)
        try:
            self.root = np.linalg.cholesky(inverse)
        except np.linalg.LinAlgError:  # the inverse is ill-conditioned
            self.root = root_of(inverse)
        roots = [self.root] * bands.n if column_maps is None else [each @ self.root for each in column_maps]
        roots = [root[k] * w for root, k, w in zip(roots, bands.parameters, weights, strict=True)]
        self.leverage = _band_leverage(bands, roots)
        self.free = self._free()
        self.packed, self.variances = self._matrices(roots)
        self.equations = self.packed @ self.packed.T + self._diagonal() - self._cross_leverage()

    @property
    def multiplicity(self) -> Array:
        """Number of elements of a covariance matrix for each pair of joints, shape (pairs,).

        It is 1 for a joint paired with itself, and 2 for two different joints.
        """
        return np.where(np.equal(*self.pairs), 1.0, 2.0)

    @staticmethod
    def size(bands: BandProducts, count: int) -> int:
        """Number of elements in the matrices of all noise levels, for `count` parameters."""
        return len(level_basis(bands)) * bands.n * (bands.n + 1) // 2 * count * (count + 1) // 2

    def levels(self, moments: Array) -> Array:
        """Covariance of the noise of the weighted rows at each of the B frequencies of `basis`, shape (B, n, n).

        The noise in the E bands of the data follows by interpolation between these frequencies.

        Args:
            moments: Products of the unweighted residuals of two joints in each band, shape (E, n, n) [N²·m² or N²].
        """
        measured = self.measured(moments)
        ridge = WHITE_PRIOR * np.tile(self.multiplicity, len(self.basis))
        white = np.tile(self.pairs[0] == self.pairs[1], len(self.basis))
        theta = np.linalg.solve(self.equations + np.diag(ridge), measured + ridge * white)
        return self._regularise(self._square(np.asarray(theta, dtype=np.float64)))

    def scatter(self, moments: Array, squares: Array, rows: Array) -> LevelScatter:
        """Computes the effect of the noise on the estimate from residuals.

        Args:
            moments: Products of the unweighted residuals of two joints in each of E bands, shape (E, n, n).
            squares: Sum of squared residuals, shape (n,).
            rows: Number of rows in use, shape (n,).
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
        absorbed = np.maximum(power - seen, 0.0) / self.weights**2
        return LevelScatter(covariance, self._freedom(levels), np.sqrt((squares + absorbed) / np.maximum(rows, 1.0)))

    def measured(self, moments: Array) -> Array:
        """Left sides r̃ᵀ E_a r̃ of the equations, with the weighted residuals r̃; symbols as in `NoiseModel`."""
        weighted = moments * np.outer(self.weights, self.weights)
        found = np.tensordot(self.basis, weighted, (1, 0))[:, *self.pairs] * self.multiplicity
        return np.asarray(found.ravel(), dtype=np.float64)

    def _matrices(self, roots: list[Array]) -> tuple[Array, Array]:
        """Matrices Lᵀ X̃ᵀ E_c X̃ L and diagonals of H⁻¹ X̃ᵀ E_c X̃ H⁻¹ for each level c; symbols as in `NoiseModel`.

        The factor L is that of H⁻¹ = L Lᵀ. The matrices are symmetric and stored by their upper triangles, shape
        (levels, b (b + 1) / 2).
        """
        bands, b = self.bands, len(self.root)
        upper, scale = np.triu_indices(b), _packing(b)
        packed = np.empty((len(self.basis), len(self.pairs[0]), len(scale)))
        variances = np.empty((len(self.basis), len(self.pairs[0]), b))
        offset = bands.offset
        for a, share in enumerate(self.basis):
            X = np.tensordot(share, bands.products, 1)
            right = [X[:, offset[k] : offset[k + 1]] @ roots[k] for k in range(bands.n)]
            for c, (j, k) in enumerate(zip(*self.pairs, strict=True)):
                D = roots[j].T @ right[k][offset[j] : offset[j + 1]]
                D = D if j == k else D + D.T
                packed[a, c] = D[upper] * scale
                variances[a, c] = np.einsum("ij,ij->i", self.root @ D, self.root)
        return packed.reshape(-1, len(scale)), variances

    def _diagonal(self) -> Array:
        """Traces tr(E_a E_c) for all pairs of levels; E_a is the covariance of noise with unit level a."""
        count = self.bands.count[:, *self.pairs] * self.multiplicity
        B, P = len(self.basis), count.shape[1]
        result = np.zeros((B, P, B, P))
        for c in range(P):
            result[:, c, :, c] = (self.basis * count[:, c]) @ self.basis.T
        return result.reshape(B * P, B * P)

    def _cross_leverage(self) -> Array:
        """Traces tr(E_a E_c Q) + tr(E_c E_a Q), shape (levels, levels), with Q = X̃ H⁻¹ X̃ᵀ.

        They are the part of the coefficients tr(E_a M E_c M) that is linear in Q = 1 - M, with opposite sign; the
        symbols are those of `NoiseModel`.
        """
        B, P, n = len(self.basis), len(self.pairs[0]), self.bands.n
        weighted = np.einsum("ae,ce,ejk->acjk", self.basis, self.basis, self.leverage, optimize=True)
        unit = np.zeros((P, n, n))
        unit[np.arange(P), *self.pairs] = 1.0
        unit[np.arange(P), self.pairs[1], self.pairs[0]] = 1.0
        product = np.einsum("cij,djk->cdik", unit, unit, optimize=True)
        half = np.einsum("abik,cdik->acbd", weighted, product, optimize=True).reshape(B * P, B * P)
        return half + half.T

    def _square(self, theta: Array) -> Array:
        """Symmetric matrices (B, n, n), one for each of B frequencies, whose elements are the levels `theta`."""
        levels = np.zeros((len(self.basis), self.bands.n, self.bands.n))
        levels[:, *self.pairs] = theta.reshape(len(self.basis), -1)
        levels[:, self.pairs[1], self.pairs[0]] = levels[:, *self.pairs]
        return levels

    def _regularise(self, levels: Array) -> Array:
        """Makes the noise covariances of the joints at B frequencies positive definite; shape (B, n, n).

        Correlations between joints are shrunk towards the correlations over all frequencies.
        """
        variance = np.einsum("ajj->aj", levels)
        mean = np.maximum(variance.mean(axis=0), MIN_LEVEL)
        size = np.sqrt(np.maximum(variance, MIN_LEVEL * mean))
        # At frequencies with very little noise the correlations between joints are not reliable.
        significant = variance > MIN_FOR_CORRELATION * mean
        free = self.free.mean(axis=1)[:, None, None] * (significant[:, :, None] & significant[:, None, :])
        correlation = np.clip(levels / size[:, :, None] / size[:, None, :], -1.0, 1.0)
        pooled = (free * correlation).sum(axis=0) / np.maximum(free.sum(axis=0), FEWEST_FREE)
        np.fill_diagonal(pooled, 1.0)
        correlation = (free * correlation + POOLED_DOF * pooled) / (free + POOLED_DOF)
        values, vectors = np.linalg.eigh(correlation)
        correlation = (vectors * np.maximum(values, MIN_CORRELATION_EIGENVALUE)[:, None, :]) @ vectors.transpose(
            0, 2, 1
        )
        unit = np.sqrt(np.einsum("ajj->aj", correlation))
        size = size / unit
        return correlation * size[:, :, None] * size[:, None, :]

    def _free(self) -> Array:
        """Degrees of freedom of each joint's noise level at each frequency, shape (B, n).

        They are the number of real numbers in the spectrum minus their leverage.
        """
        count = np.einsum("ae,ejj->aj", self.basis, self.bands.count)
        leverage = np.einsum("ae,ejj->aj", self.basis, self.leverage)
        return np.maximum(count - leverage, FEWEST_FREE)

    def _freedom(self, levels: Array) -> Array:
        """Degrees of freedom of each parameter's variance, shape (b,), for noise levels (B, n, n)."""
        half = self.variances / self.multiplicity[None, :, None]
        share = np.zeros((*levels.shape, self.variances.shape[2]))
        share[:, *self.pairs] = half
        share[:, self.pairs[1], self.pairs[0]] = half
        mixed = np.einsum("ajkp,akl->ajlp", share, levels, optimize=True)
        variance = np.einsum("ajjp->p", mixed)
        uncertain = self.free**-0.25
        scale = np.einsum("aj,ak->ajk", uncertain, uncertain)
        mixed = np.einsum("ajkp,akl->ajlp", share * scale[..., None], levels, optimize=True)
        spread = np.einsum("ajlp,aljp->p", mixed, mixed, optimize=True)
        return np.maximum(variance**2 / np.maximum(spread, np.finfo(float).tiny), 1.0)


def _band_leverage(bands: BandProducts, roots: list[Array]) -> Array:
    """Traces tr(H⁻¹ X̃_jᵀ P X̃_k), shape (E, n, n), where P projects on the coefficients of a band.

    The other symbols are those of `NoiseModel`.
    """
    rows = np.concatenate(roots)
    inverse, starts = rows @ rows.T, bands.offset[:-1]
    return np.stack(
        [np.add.reduceat(np.add.reduceat(X * inverse, starts, axis=0), starts, axis=1) for X in bands.products]
    )


def level_basis(bands: BandProducts) -> Array:
    """Weights of the levels at B frequencies in each of E bands, shape (B, E), for linear interpolation."""
    count = np.einsum("ejj->e", bands.count) / bands.n
    cumulative = np.cumsum(count)
    first = float(bands.frequency[min(int(np.searchsorted(cumulative, LOWEST_KNOT_SIZE)), len(cumulative) - 1)])
    knots: list[float] = [0.0, max(first, float(bands.frequency[min(1, len(cumulative) - 1)]))]
    while knots[-1] * 2.0 < bands.frequency[-1]:
        knots.append(knots[-1] * 2.0)
    knot_frequencies: NDArray[np.float64] = np.array(knots)
    shares = np.array([np.interp(bands.frequency, knot_frequencies, row) for row in np.eye(len(knot_frequencies))])
    return shares[shares.sum(axis=1) > 0.0]


def _packing(b: int) -> Array:
    """Factors for the elements of the upper triangle of a symmetric matrix (b, b), shape (b (b + 1) / 2,).

    With these factors, the inner product of two triangles equals that of the full matrices.
    """
    rows, columns = np.triu_indices(b)
    return np.where(rows == columns, 1.0, np.sqrt(2.0))

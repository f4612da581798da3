"""From standard parameters to a fit: what the data say of each, what it cost, and what should be said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding
from armid.estimation.consistency.analytic_centre import find_centre
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.consistency.constraints import Requirements, at_mass_limit
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.fit import Fit
from armid.estimation.prior import Prior, project_covariance
from armid.estimation.problem import StandardParameters
from armid.estimation.standard_fit import (
    IDENTIFIED,
    PriorUse,
    Proof,
    StandardFit,
    map_to_standard,
    shares,
    stated,
    status_of,
)
from armid.estimation.uncertainty.covariance import scale_covariance
from armid.estimation.whitening import WhitenedSystem
from armid.information.information import stack
from armid.maths.linalg import condition, inverse_of, scaled_condition
from armid.values import Array

__all__ = ["PhysicalFit"]

PRICE = 0.05
"""Residual cost of consistency from which on something is said: noise alone makes it far less than a hundredth."""

PUSHED = 2.0
"""Deviations by which data must push a parameter across its bound to be named."""

AT_BOUND = 1e-3
"""Deviations from its bound at which a parameter stands at it."""

NAMED = 0.01
"""Part in an unseen direction, columns of unit length, from which on a parameter is named."""

REMEDY = 'use method = "physical" for simulation or export.'

PHYSICAL = -1e-9
"""Smallest eigenvalue of a pseudo-inertia that rounding leaves [kg and kg·m²]."""


class PhysicalFit:
    """An estimate of standard parameters, however it was found.

    Args:
        standard: The standard parameters.
        weighted: The data.
        belief: The prior for weight 1; what is known of any arm where there was none.
        prior: What was used of it.
        values: The estimate, shape (p,).
        gap: Duality gap of the method; NaN where it knows none.
        basis: Parameters (p,) that each unknown moves, shape (p, x); the identity where not given.
        asked: What the study requires of the parameters, where it may.
    """

    def __init__(
        self,
        standard: StandardParameters,
        weighted: WhitenedSystem,
        belief: Prior,
        prior: PriorUse,
        values: Array,
        gap: float,
        basis: Array | None = None,
        asked: Requirements | None = None,
    ) -> None:
        self.asked = asked
        self.standard, self.weighted, self.belief, self.prior = standard, weighted, belief, prior
        self.values, self.gap = values, gap
        self.base: Array = standard.regrouping @ values
        self.told = prior.kind in ("log-det", "euclidean")
        self.basis: Array = np.eye(len(values)) if basis is None else basis
        curvature = belief.curvature(standard, values, prior.weight if self.told else 1.0)
        self.precision: Array = weighted.correlation * (self.basis.T @ curvature @ self.basis)
        seen = weighted.rows @ standard.regrouping @ self.basis
        self.information: Array = seen.T @ seen
        self.least: Array = smallest_eigenvalues(standard, values)
        lowest = min(float(self.least.min(initial=0.0)), float(values[standard.nonnegative].min(initial=0.0)))
        # An estimate that the cone did not hold says nothing of the cone.
        held = lowest >= PHYSICAL
        centre = find_centre(standard, weighted, belief, prior, values, self.basis) if held else None
        self.inside = centre is not None
        self.narrow: Array = self.precision if centre is None else self.basis.T @ centre.precision @ self.basis
        self.shift: Array = np.zeros(len(values)) if centre is None else centre.values - values

    def fit(self, further: Sequence[Finding] = ()) -> Fit:
        """The estimate, with further findings of the method."""
        whole, weights = self.weighted.whole, self.weighted.weights
        precision = self._prior_precision()
        white = self.weighted.inverse
        if precision is not None:
            white = inverse_of(self.weighted.rows.T @ self.weighted.rows + precision)
        unweighted = stack(whole)[0]
        rows = whole.rows[0]
        squares = held_out_squares(whole, self.base)
        freedom = self.weighted.freedom
        known = scale_covariance(whole, weights, white)
        standard, findings = self._standard(squares)
        standard = stated(standard, self.weighted.correlation * white, known, np.full(whole.count, freedom))
        return Fit(
            whole.names,
            self.base,
            np.sqrt(np.diag(white)),
            white + known,
            "white",
            freedom,
            np.sqrt(squares / np.maximum(rows, 1)),
            rows,
            condition(unweighted),
            scaled_condition(unweighted),
            weights,
            prior_precision=precision,
            prior_correlation=self.weighted.correlation,
            findings=(*further, *findings),
            standard=standard,
        )

    def _prior_precision(self) -> Array | None:
        """Precision (b, b) of prior and cone in base parameters; `None` where data alone determine them."""
        whole = self.basis.shape[0] == self.basis.shape[1]
        if not (self.inside or self.told or len(self.weighted.unseen)) and whole:
            return None
        covariance = project_covariance(self.narrow, self.standard.regrouping @ self.basis)
        if whole:
            return inverse_of(covariance)
        # What is given has no variance; a millionth of the others' stands for that.
        length = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        length = np.where(length > 0.0, length, np.median(length) if length.any() else 1.0)
        return inverse_of(covariance + 1e-6 * np.diag(length**2))

    def _standard(self, squares: Array) -> tuple[StandardFit, tuple[Finding, ...]]:
        """Standard parameters with what the data say of each, and what is to be said of the whole."""
        standard, values = self.standard, self.values
        covariance, share = shares(self.information, self.precision)
        follow = self.basis != 0.0
        spread = self.basis @ covariance @ self.basis.T
        white = np.sqrt(np.maximum(np.diag(spread), 0.0))
        deviation = np.sqrt(self.weighted.correlation) * white
        given = ~follow.any(axis=1)
        resolution = follow @ share
        # The pull of the data on a parameter at its bound, over what white noise makes of it.
        pull = standard.regrouping.T @ (
            self.weighted.rows.T @ (self.weighted.rows @ (self.base - self.weighted.values))
        )
        at_bound = standard.nonnegative & (values <= AT_BOUND * np.maximum(deviation, np.finfo(np.float64).tiny))
        held = at_bound & (pull * white > PUSHED) & ~given
        limited = self._limited(deviation) & ~given
        moved = self._moved(np.abs(pull) * white) & (resolution >= IDENTIFIED) & ~given & ~limited
        price = float(self.weighted.weights**2 @ (squares - self.weighted.squares)) / self.weighted.freedom
        lowest = float(values[standard.nonnegative].min(initial=np.inf))
        proof = Proof(price, float(self.least.min(initial=np.inf)), lowest, self.gap)
        fit = StandardFit(
            standard.names,
            standard.units,
            values,
            self.weighted.correlation * spread,
            np.stack([values, values], axis=1),
            resolution,
            status_of(resolution, self.told, given, held | limited | moved),
            self.prior,
            proof,
            map_to_standard(
                self.narrow,
                standard.regrouping,
                self.basis,
                self.weighted.correlation,
                self.shift,
                self._bounded(),
            ),
        )
        return fit, (*self.belief.findings, *self._findings(price, held, limited, moved))

    def _bounded(self) -> Array:
        """Mask of the nonnegative parameters, shape (p,)."""
        bounded = self.standard.nonnegative.copy()
        for own in self.standard.inertial:
            bounded[own[[0, 4, 6, 9]]] = True  # mass and the moments of inertia about the axes
        return bounded.astype(np.float64)

    def _moved(self, pulled: Array) -> NDArray[np.bool_]:
        """Tell which bodies' parameters (p,) prior and constraints hold far from where the data would have them.

        Args:
            pulled: Pull of the data on each parameter, over what white noise makes of it, shape (p,).
        """
        result = np.zeros(len(pulled), dtype=np.bool_)
        own = self.standard.inertial
        result[own] = pulled[own] > PUSHED * np.sqrt(self.weighted.correlation)
        return result

    def _limited(self, deviation: Array) -> Array:
        """Tell which parameters (p,) a limit of the study holds; what is one with such a mass is held with it."""
        if self.asked is None:
            return np.zeros(len(self.values), dtype=bool)
        near = AT_BOUND * np.maximum(deviation, np.abs(self.values))
        at = at_mass_limit(self.standard, self.asked, self.values, near)
        return np.asarray((self.basis != 0.0) @ (self.basis[at] != 0.0).any(axis=0), dtype=bool)

    def _findings(self, price: float, held: Array, limited: Array, moved: Array) -> list[Finding]:
        """Return what the reader of the result should know."""
        found: list[Finding] = []
        for own, smallest in zip(self.standard.inertial, self.least, strict=True):
            if smallest < PHYSICAL:
                said = f"No body has the link's values: smallest eigenvalue of its pseudo-inertia {smallest:.2g}."
                found.append(Finding("not-physical", "warning", self.standard.names[own[0]], said, REMEDY))
        if self.told:
            samples = "sample" if self.prior.weight == 1.0 else "samples"
            said = f"The {self.prior.kind} prior weighs {self.prior.weight:.3g} independent {samples} a joint"
            found.append(Finding("prior-weight", "info", "", f"{said}, {self.prior.how}."))
        if len(self.weighted.unseen):
            length = np.linalg.norm(stack(self.weighted.whole)[0], axis=0)
            part = np.abs(self.weighted.unseen * np.where(length > 0.0, length, 1.0)).max(axis=0)
            named = [name for name, p in zip(self.weighted.whole.names, part, strict=True) if p > NAMED]
            said = f"The data leave {len(self.weighted.unseen)} directions of the base parameters open, in "
            remedy = "record a motion that shows them; until then the prior says what they are."
            found.append(Finding("prior-dominated", "warning", "", f"{said}{', '.join(named)}.", remedy))
        if price > PRICE:
            said = f"Consistency and prior cost {100.0 * price:.3g} % of the squared residual."
            remedy = (
                "add the torque terms that the residuals show, or trust the description less. A wrong sign or "
                "gravity would be a finding of its own."
            )
            found.append(Finding("price-of-consistency", "warning", "", said, remedy))
        if held.any():
            names = ", ".join(name for name, is_held in zip(self.standard.names, held, strict=True) if is_held)
            found.append(Finding("held-at-zero", "info", "", f"The data would have these negative: {names}."))
        if limited.any():
            names = ", ".join(name for name, at in zip(self.standard.names, limited, strict=True) if at)
            said = f"Limits of the study hold these where they are: {names}."
            found.append(Finding("held-at-limit", "info", "", said))
        if moved.any():
            names = ", ".join(name for name, is_moved in zip(self.standard.names, moved, strict=True) if is_moved)
            far = f"more than {PUSHED:g} deviations from where the data would have them"
            said = f"Bodies that can exist, the prior and the study's limits hold these {far}: {names}."
            found.append(Finding("held-inside", "info", "", said))
        return found

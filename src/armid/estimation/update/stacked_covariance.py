"""Covariance of an estimate that is computed from an earlier estimate and the samples of new recordings.

For the earlier recordings, the covariance C of the earlier estimate is used. Let A be the whitened earlier rows, with
one column for each earlier parameter, and J the same rows with one column for each unknown. The contribution of these
rows to the right-hand side of the normal equations has the covariance JᵀA C AᵀJ. The covariance of the new recordings
is computed from their samples, as in an identification; all other information is treated as a prior. Velocity
reversals shift the earlier and the new estimate by the same cause. These shifts are therefore added with their signs,
not as variances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import Uncertainty
from armid.estimation.uncertainty.jackknife import blend_with_textbook
from armid.estimation.uncertainty.reversal_sensitivity import shift_of_unknowns
from armid.estimation.update.stacked_problem import EarlierErrors
from armid.information.information import Information, stack
from armid.maths.linalg import root_of, unit_columns
from armid.maths.median import median

ROUNDING = 1e-9
"""Largest share of the earlier rows that may lie outside the span of the columns of the earlier parameters, as a
rounding error."""


UNCANCELLED = 0.25
"""Share of each shift by reversals that is added to the covariance even if the shifts of earlier and new motion
cancel, as they do for a payload. The ratio of error to shift differs between motions, so the errors do not cancel
completely. On recordings of a SCARA arm the ratio was 0.7 to 0.8."""


@dataclass(frozen=True, eq=False, slots=True)
class PriorInformation:
    """Information about u unknowns from everything except the new recordings: from the prior and earlier recordings.

    Attributes:
        precision: Normal matrix of prior and earlier recordings, shape (u, u).
        certain: Covariance of the estimate caused by rows of the prior, whose variance is known, shape (u, u).
        scatter: Covariance of the estimate caused by the noise of earlier recordings, shape (u, u).
        freedom: Degrees of freedom of `scatter`, shape (u,).
        moved: Shift of the estimate by rows near reversals in earlier recordings, shape (u,).
        reach: Share of `moved` that counts as one standard deviation in the earlier estimate.
        inverse: Inverse of the whole normal matrix, new recordings included, shape (u, u).
    """

    precision: Array
    certain: Array
    scatter: Array
    freedom: Array
    moved: Array
    reach: float
    inverse: Array


def prior_information(
    prior_rows: Array, rows: Array, in_earlier: Array, earlier: EarlierErrors | None, inverse: Array
) -> PriorInformation:
    """Computes the information that the prior and the earlier recordings contain about the u unknowns.

    Args:
        prior_rows: Whitened rows of the k conditions of the prior, shape (k, u).
        rows: The m whitened rows of the earlier recordings, one column for each unknown, shape (m, u).
        in_earlier: The same rows, one column for each of the b' parameters of the earlier estimate, shape (m, b').
        earlier: Errors of the earlier estimate; `None` if there are no earlier rows.
        inverse: Inverse of the normal matrix of prior, earlier and new recordings, shape (u, u).
    """
    u = len(inverse)
    certain = inverse @ (prior_rows.T @ prior_rows) @ inverse
    precision = prior_rows.T @ prior_rows + rows.T @ rows
    if earlier is None:
        return PriorInformation(precision, certain, np.zeros((u, u)), np.full(u, np.inf), np.zeros(u), 0.0, inverse)
    half = root_of(earlier.covariance)
    gain = inverse @ (rows.T @ in_earlier)
    noise = in_earlier @ half
    # With torque scales as unknowns, the rows have a part outside the span of the earlier parameters. There they get
    # the mean variance of the earlier rows.
    basis = np.linalg.qr(unit_columns(in_earlier)[0])[0]
    outside = rows - basis @ (basis.T @ rows)
    extra = inverse @ outside.T if np.linalg.norm(outside) > ROUNDING * np.linalg.norm(rows) else np.zeros((u, 1))
    spread = gain @ half
    scatter = spread @ spread.T + float(np.sum(noise**2)) / len(half) * (extra @ extra.T)
    part = gain**2 * np.diag(earlier.covariance)
    whole = part.sum(axis=1)
    share = np.where(whole > 0.0, whole, 1.0)
    freedom = np.where(whole > 0.0, part @ earlier.freedom / share, float(median(earlier.freedom)))
    return PriorInformation(precision, certain, scatter, freedom, gain @ earlier.moved, earlier.reach, inverse)


def _as_wide(covariance: Array, variance: Array) -> Array:
    """Covariance (u, u) with given variances (u,) and the correlations of another covariance."""
    size = np.sqrt(np.divide(variance, np.diag(covariance), out=np.zeros_like(variance), where=variance > 0.0))
    return covariance * np.outer(size, size)


class JointCovariance(Uncertainty):
    """Covariance of an estimate of u unknowns from an earlier estimate and new recordings.

    Args:
        fit: The estimate.
        problem: The new recordings with their samples, in b parameters.
        information: Factors of the new recordings in the unknowns.
        remaining: Information from everything except the new recordings.
        column_maps: Matrices from the unknowns to the parameters of each joint's columns, shapes (b, u).
        joint_values: Parameters of each joint's columns, shape (n, b).
    """

    def __init__(
        self,
        fit: Fit,
        problem: EstimationProblem,
        information: Information,
        remaining: PriorInformation,
        column_maps: Sequence[Array],
        joint_values: Array,
    ) -> None:
        super().__init__(replace(fit, prior_precision=remaining.precision), problem, information)
        self.remaining, self._column_maps, self._joint_values = remaining, tuple(column_maps), joint_values
        self.inverse = remaining.inverse  # from rows and not from their squares, which lose weak directions
        self.known_covariance = remaining.certain + remaining.scatter
        self.moved = remaining.reach * remaining.moved
        self.observed = np.any([np.any(each, axis=0) for each in column_maps], axis=0)

    def with_covariance(self, *, systematic_errors: bool = True) -> Fit:
        """Fit with its covariance, of the kind that samples and motion allow, with systematic errors or without."""
        fit = super().with_covariance(systematic_errors=systematic_errors)
        why = f"{fit.report.why}; the earlier recordings are included with the covariance of their run"
        report = replace(fit.report, why=why)
        if not len(report.moved):  # only the kind `spectral` computes the shifts of both
            report = replace(report, moved=self.remaining.moved, reach=self.remaining.reach)
        return replace(fit, report=report)

    def reversal_effect(self, covariance: Array) -> tuple[Array, float, float]:
        """Shift of the estimate by rows near reversals in all recordings, compared with standard deviations by noise.

        A share of this shift is added to the covariance.
        """
        result = super().reversal_effect(covariance)
        for part in (self.remaining.moved, result[0] - self.remaining.moved):
            share = UNCANCELLED * self.reach(part, covariance)[0]
            self.known_covariance = self.known_covariance + share**2 * np.outer(part, part)
        return result

    def noise_covariance(self, scatter: Array) -> Array:
        """Covariance of the estimate that the noise of new and earlier recordings causes, shape (u, u).

        `scatter` is the covariance that the noise of the new recordings causes, shape (u, u).
        """
        return scatter + self.remaining.scatter

    def reversal_shift(self) -> Array:
        """Shift of the estimate if rows near reversals in new and earlier recordings are left out, shape (u,)."""
        A, y = stack(self.whole, self.fit.weights)
        remaining = self.remaining.precision, -A.T @ (y - A @ self.fit.values)
        root = root_of(self.inverse)
        found = shift_of_unknowns(
            self.problem, self._joint_values, self.fit.weights, self._column_maps, remaining, root
        )
        return found + self.remaining.moved

    def white(self) -> Fit:
        """Fit with the covariance under the assumption that the noise of the new recordings is white."""
        return self.with_scatter(
            replace(self.fit, covariance_kind="white"), self._textbook(), self.known_covariance, self.fit.freedom
        )

    def _textbook(self) -> Array:
        """Covariance of the estimate by white noise of the new recordings, shape (u, u)."""
        A = stack(self.whole, self.fit.weights)[0] @ self.inverse
        return A.T @ A

    def with_scatter(self, fit: Fit, scatter: Array, known_covariance: Array, freedom: Array | float) -> Fit:
        """Fit with covariance and degrees of freedom, combined from earlier and new noise [Satterthwaite1946].

        Args:
            fit: The fit.
            scatter: Covariance that the noise of the new recordings causes, shape (u, u).
            known_covariance: Covariance from all other sources, which is added, shape (u, u).
            freedom: Degrees of freedom of `scatter`, shape (u,) or a number.
        """
        if fit.covariance_kind in ("period", "block"):
            scatter = _as_wide(
                blend_with_textbook(scatter, self._textbook(), float(np.min(freedom))), np.diag(scatter)
            )
        found = super().with_scatter(fit, scatter, known_covariance, freedom)
        new, old = np.diag(scatter), np.diag(self.remaining.scatter)
        spread = new**2 / np.broadcast_to(freedom, new.shape) + old**2 / self.remaining.freedom
        whole = np.diag(found.covariance) ** 2
        return replace(found, freedom=np.divide(whole, spread, out=np.full_like(whole, np.inf), where=spread > 0.0))

    def joint_values(self) -> Array:
        """Parameters of each joint's columns, shape (n, b)."""
        return self._joint_values

    def column_maps(self) -> tuple[Array, ...]:
        """Matrices from the unknowns to the parameters of each joint's columns, shapes (b, u)."""
        return self._column_maps

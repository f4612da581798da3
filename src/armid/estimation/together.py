"""The covariance of what an earlier estimate and the samples of new recordings determine together.

The earlier recordings err as their own estimate said: with A their whitened rows in its parameters, J the same rows
in the unknowns and C its covariance, they pull with the covariance JᵀA C AᵀJ. The new recordings are looked at as an
identification looks at its own, and the rest stands beside them as a prior does. What reversals do to both has one
cause and is added with its sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.estimation.fit import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import Uncertainty
from armid.estimation.uncertainty.jackknife import filled
from armid.estimation.uncertainty.reversals import moved_among_unknowns
from armid.estimation.update.stacked_problem import Earlier
from armid.information.information import Information, stack
from armid.maths.linalg import root_of, unit_columns
from armid.values import Array

__all__ = ["Rest", "Together", "rest_of"]


ROUNDING = 1e-9
"""Part of the earlier rows, relative, below which they show nothing but the earlier estimate's parameters."""


UNLIKE = 0.25
"""Share of a move by reversals that is left where those of two motions cancel, as in a load: errors are in no fixed
proportion to moves. On logs of a SCARA arm they were 0.7 to 0.8 times these."""


@dataclass(frozen=True, eq=False, slots=True)
class Rest:
    """All that stands beside the new recordings, in u unknowns.

    Attributes:
        precision: Its normal equations, shape (u, u).
        certain: Covariance of the estimate that rows of known variance make, shape (u, u).
        scatter: That which the noise of earlier recordings makes, shape (u, u).
        freedom: Degrees of freedom of the scatter, shape (u,).
        moved: What reversals in earlier recordings move the estimate by, shape (u,).
        reach: Share of that move that counted as a deviation of the earlier estimate.
        inverse: Inverse of all normal equations, the new recordings' in them, shape (u, u).
    """

    precision: Array
    certain: Array
    scatter: Array
    freedom: Array
    moved: Array
    reach: float
    inverse: Array


def rest_of(ties: Array, rows: Array, own: Array, earlier: Earlier | None, inverse: Array) -> Rest:
    """Return what stands beside the new recordings.

    Args:
        ties: Rows of variance one, shape (k, u).
        rows: Whitened rows of the earlier recordings in the unknowns, shape (m, u).
        own: The same rows in the earlier estimate's parameters, shape (m, b').
        earlier: How the earlier estimate errs; `None` where there are no such rows.
        inverse: Inverse of all normal equations, shape (u, u).
    """
    u = len(inverse)
    certain = inverse @ (ties.T @ ties) @ inverse
    precision = ties.T @ ties + rows.T @ rows
    if earlier is None:
        return Rest(precision, certain, np.zeros((u, u)), np.full(u, np.inf), np.zeros(u), 0.0, inverse)
    half = root_of(earlier.covariance)
    gain = inverse @ (rows.T @ own)
    noise = own @ half
    # Where scales of torque are unknowns, rows also show what the earlier estimate took as given: its rows err there
    # as they do on the whole.
    inside = np.linalg.qr(unit_columns(own)[0])[0]
    left = rows - inside @ (inside.T @ rows)
    further = inverse @ left.T if np.linalg.norm(left) > ROUNDING * np.linalg.norm(rows) else np.zeros((u, 1))
    spread = gain @ half
    scatter = spread @ spread.T + float(np.sum(noise**2)) / len(half) * (further @ further.T)
    part = gain**2 * np.diag(earlier.covariance)
    whole = part.sum(axis=1)
    share = np.where(whole > 0.0, whole, 1.0)
    freedom = np.where(whole > 0.0, part @ earlier.freedom / share, float(np.median(earlier.freedom)))
    return Rest(precision, certain, scatter, freedom, gain @ earlier.moved, earlier.reach, inverse)


def _as_wide(covariance: Array, variance: Array) -> Array:
    """The covariance with other variances (u,), correlations as they are."""
    size = np.sqrt(np.divide(variance, np.diag(covariance), out=np.zeros_like(variance), where=variance > 0.0))
    return covariance * np.outer(size, size)


class Together(Uncertainty):
    """The covariance of an estimate of u unknowns.

    Args:
        fit: The estimate, with the precision of the rest as its prior.
        problem: The new recordings with their samples, about b parameters.
        information: Their factors in the unknowns.
        rest: What stands beside them.
        through: How the parameters of each joint's columns follow from the unknowns, shapes (b, u).
        shown: Parameters of each joint's columns, shape (n, b).
    """

    def __init__(
        self,
        fit: Fit,
        problem: EstimationProblem,
        information: Information,
        rest: Rest,
        through: Sequence[Array],
        shown: Array,
    ) -> None:
        super().__init__(replace(fit, prior_precision=rest.precision), problem, information)
        self.rest, self._through, self._shown = rest, tuple(through), shown
        self.inverse = rest.inverse  # from rows and not from their squares, which lose weak directions
        self.known = rest.certain + rest.scatter
        self.moved = rest.reach * rest.moved
        self.felt = np.any([np.any(each, axis=0) for each in through], axis=0)

    def covered(self) -> Fit:
        """The fit with the covariance that fits the case."""
        fit = super().covered()
        why = f"{fit.report.why}; the earlier recordings enter with the covariance of their run"
        report = replace(fit.report, why=why)
        if not len(report.moved):  # of another kind than `spectral`, which looks for both recordings' moves
            report = replace(report, moved=self.rest.moved, reach=self.rest.reach)
        return replace(fit, report=report)

    def move(self, covariance: Array) -> tuple[Array, float, float]:
        """Return what reversals in all recordings move the estimate by, and a part of each by itself."""
        result = super().move(covariance)
        for part in (self.rest.moved, result[0] - self.rest.moved):
            share = UNLIKE * self.reach(part, covariance)[0]
            self.known = self.known + share**2 * np.outer(part, part)
        return result

    def by_noise(self, scatter: Array) -> Array:
        """Covariance that the noise of new and earlier recordings makes, shape (u, u)."""
        return scatter + self.rest.scatter

    def without_reversals(self) -> Array:
        """Move of the estimate without rows next to reversals in new and earlier recordings, shape (u,)."""
        A, y = stack(self.whole, self.fit.weights)
        rest = self.rest.precision, -A.T @ (y - A @ self.fit.values)
        root = root_of(self.inverse)
        found = moved_among_unknowns(self.problem, self._shown, self.fit.weights, self._through, rest, root)
        return found + self.rest.moved

    def white(self) -> Fit:
        """The fit with white noise of the new recordings."""
        return self.settled(
            replace(self.fit, covariance_kind="white"), self._textbook(), self.known, self.fit.freedom
        )

    def _textbook(self) -> Array:
        """Covariance that white noise of the new recordings makes, shape (u, u)."""
        A = stack(self.whole, self.fit.weights)[0] @ self.inverse
        return A.T @ A

    def settled(self, fit: Fit, scatter: Array, known: Array, freedom: Array | float) -> Fit:
        """The fit with its covariance, to whose degrees of freedom both scatters add [Satterthwaite1946]."""
        if fit.covariance_kind in ("period", "block"):
            scatter = _as_wide(filled(scatter, self._textbook(), float(np.min(freedom))), np.diag(scatter))
        found = super().settled(fit, scatter, known, freedom)
        new, old = np.diag(scatter), np.diag(self.rest.scatter)
        spread = new**2 / np.broadcast_to(freedom, new.shape) + old**2 / self.rest.freedom
        whole = np.diag(found.covariance) ** 2
        return replace(found, freedom=np.divide(whole, spread, out=np.full_like(whole, np.inf), where=spread > 0.0))

    def shown(self) -> Array:
        """Parameters of each joint's columns, shape (n, b)."""
        return self._shown

    def through(self) -> tuple[Array, ...]:
        """Tell how the parameters of each joint's columns follow from the unknowns, shapes (b, u)."""
        return self._through

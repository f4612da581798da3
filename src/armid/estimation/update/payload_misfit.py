"""Test of a payload: the residuals with the payload are compared with those of a fit of the new recordings alone.

In the fit of the new recordings alone, every base parameter is estimated, so this fit can represent any load on any
link. For each joint, the sum S of squared residuals with the payload and the sum S₀ of this fit are compared by an F
test,

    F = [(S - S₀) / (c p)] / [S₀ / (m - p)],

with p and (m - p) / c degrees of freedom, where m is the number of rows of the joint, p the sum of the leverages of
these rows and c the number of rows that count as one independent sample. The residual of the earlier recordings is
not used as reference, because the error of the friction model depends on the motion: on recordings of simulated arms
with a correct load, the ratio of the residuals of new and earlier recordings was 0.7 to 24. The two fits that are
compared here have the same motion and the same model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.update.stacked_problem import StackedProblem
from armid.estimation.update.stacked_solution import solve_values
from armid.estimation.whitened_system import WhitenedSystem
from armid.information.information import Information

FALSE_ALARMS = 1e-3
"""Probability of a false alarm, for all joints together: the F test reports a recording although the load is on
the given link."""

LARGER = 1.5
"""Smallest ratio of the residual with the load to the residual of a fit of the recordings alone at which the
payload is reported. On 79 correct recordings of four simulated arms the ratio was at most 1.05. On a recording of
a real arm it was 1.00, and on a recording of the same arm without a load on another day 1.3. With a load on a link
next to the assumed one it was 1.6 to 15. Of 120 correct recordings that were cut to 4 to 8 s, none was reported."""

CORRELATED = 4.0
"""Lower limit of the number of rows that count as one independent sample. The scatter between blocks gives numbers
of 1 to 2; but for correct loads, the spectrum of the residuals gives variances of the load that are 2 to 5 times
as large. With a limit of 1, three of 15 correct recordings of 4 s were reported."""

EXACT = 1e-4
"""Relative standard deviation that is used for an exact torque scale when the scales of other joints are
uncertain."""

ROUNDING = 1e-12
"""Ratio of residual to torque below which the residual is a rounding error, which has no scatter to compare."""


@dataclass(frozen=True, eq=False, slots=True)
class PayloadMisfit:
    """Residuals of the new recordings with a payload, compared with those of a fit of these recordings alone.

    Attributes:
        residual: RMS residual with the earlier estimate and the payload, shape (n,) [N·m or N].
        alone: RMS residual of the fit of the recordings alone, corrected for the degrees of freedom, shape (n,) [N·m
            or N].
        cost: Weighted sum of squared residuals with the payload, to compare links that could carry the payload.
        significant: Mask of the joints whose torque the payload does not explain, shape (n,).
    """

    residual: Array
    alone: Array
    cost: float
    significant: NDArray[np.bool_]


def payload_misfit(new: Information, alone: WhitenedSystem, values: Array, scale: Array) -> PayloadMisfit:
    """Compares residuals of the arm with a payload with the residuals of a fit of the new recordings alone.

    Args:
        new: Factors of the new recordings.
        alone: Fit of the new recordings alone, by `whiten`.
        values: Base parameters of the arm with the payload, shape (b,).
        scale: Ratio of measured torque to the torque of the model, shape (n,).
    """
    from scipy.special import fdtrc  # a third of a second to import

    rows, together = new.rows.sum(axis=0), max(alone.correlation, CORRELATED)
    squares = np.array([held_out_squares(new, s * values)[j] for j, s in enumerate(scale)])
    spent = np.maximum(alone.effective_dof, np.finfo(float).tiny)
    left = rows - alone.effective_dof
    torque = held_out_squares(new, np.zeros_like(values))
    tested = (left > together) & (alone.squares > ROUNDING**2 * torque)
    noise = np.divide(alone.squares, left, out=np.zeros(new.n), where=tested)
    excess = np.maximum(squares - alone.squares, 0.0) / spent / together
    ratio = np.divide(excess, noise, out=np.zeros(new.n), where=tested)
    chance = fdtrc(spent, np.where(tested, left, together) / together, ratio)
    residual = np.sqrt(squares / np.maximum(rows, 1))
    significant = tested & (chance < FALSE_ALARMS / new.n) & (residual > LARGER * np.sqrt(noise))
    return PayloadMisfit(residual, np.sqrt(noise), float(alone.weights**2 @ squares), significant)


def misfit_of(
    stacked: StackedProblem, new: Information, alone: WhitenedSystem, deviation: Array, known: Array | None
) -> PayloadMisfit:
    """Solves a stacked problem and compares the residuals with those of a fit of the new recordings alone.

    Uncertain torque scales are estimated, too, so that a wrong gain is not mistaken for a load on another link.

    Args:
        stacked: Stacked problem with the payload.
        new: Factors of the new recordings.
        alone: Fit of the new recordings alone.
        deviation: Relative standard deviations of the torque scales, shape (n,); zero for exact scales.
        known: Known parameters of the payload, NaN for unknown ones, shape (10,); `None` if all are unknown.
    """
    if known is not None:
        wide = np.where(deviation > 0.0, deviation, np.inf)
    else:
        wide = np.maximum(deviation, EXACT) if deviation.any() else None
    values, scale = solve_values(stacked, scale_deviation=wide, fixed=known)
    return payload_misfit(new, alone, stacked.to_new @ values, scale)

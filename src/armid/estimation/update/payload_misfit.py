"""Test of the fit of a payload: does a load on its link explain the torque of the new recordings?

The new recordings are fitted alone as well, with every base parameter free. This contains any load on any link, so
joint by joint the two sums of squared residuals S and S₀ are compared by an F test,

    F = (S - S₀) / p over S₀ / (m - p)

with m rows of the joint and the p degrees of freedom that they spent, both divided by the number of rows that count
as one independent sample. The residual of the earlier recordings is no reference: what the friction model lacks
depends on the motion, and on logs of simulated arms with sound loads the residual changed by factors of 0.7 to 24.
Both fits here have the same motion and the same model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.update.joint_solution import solve_values
from armid.estimation.update.stacked_problem import StackedProblem
from armid.estimation.whitened_system import WhitenedSystem
from armid.information.information import Information

FALSE_ALARMS = 1e-3
"""Probability of the F test to report a recording whose load is on the named link, all joints together."""

LARGER = 1.5
"""Least ratio of the residuals with the load and of the recordings alone. On 79 sound logs of four simulated arms it
was at most 1.05, on a measured one 1.00, and 1.3 for that arm without a load on another day. With a load on a
neighbour of the tip's link it was 1.6 to 15. Of 120 sound logs cut to 4 to 8 s none raised an alarm."""

CORRELATED = 4.0
"""Least number of rows that count as one independent sample. The scatter between blocks shows 1 to 2, but with sound
loads the spectrum of the residuals made variances of the load 2 to 5 times as large; with 1, three of 15 sound logs
of 4 s raised an alarm."""

EXACT = 1e-4
"""Relative deviation of a torque scale that is taken as exact, beside uncertain ones."""


@dataclass(frozen=True, eq=False, slots=True)
class PayloadMisfit:
    """Residuals of the new recordings with a payload, beside those of a fit to these recordings alone.

    Attributes:
        residual: RMS with the earlier estimate and the payload, shape (n,) [N·m or N].
        alone: RMS of the fit of the recordings alone, corrected for its degrees of freedom, shape (n,) [N·m or N].
        cost: Weighted sum of squared residuals with the payload, for the comparison of links.
        significant: Joints whose torque the payload does not explain, shape (n,).
    """

    residual: Array
    alone: Array
    cost: float
    significant: NDArray[np.bool_]


def payload_misfit(new: Information, alone: WhitenedSystem, values: Array, scale: Array) -> PayloadMisfit:
    """Compares the residuals with a payload with those of the new recordings alone.

    Args:
        new: Factors of the new recordings.
        alone: Fit of the new recordings alone, which `whiten` makes.
        values: Base parameters of the arm with the payload, shape (b,).
        scale: Ratio of measured torque to the model's, shape (n,).
    """
    from scipy.special import fdtrc  # a third of a second to import

    rows, together = new.rows.sum(axis=0), max(alone.correlation, CORRELATED)
    squares = np.array([held_out_squares(new, s * values)[j] for j, s in enumerate(scale)])
    spent = np.maximum(alone.spent, np.finfo(float).tiny)
    left = rows - alone.spent
    tested = (left > together) & (alone.squares > 0.0)
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
    """Solves a stacked problem and compares its residuals with those of the new recordings alone.

    Uncertain torque scales are unknowns here, since a wrong gain is no load on another link.

    Args:
        stacked: Stacked problem with the payload.
        new: Factors of the new recordings.
        alone: Fit of the new recordings alone.
        deviation: Relative standard deviations of the torque scales, shape (n,); zero where exact.
        known: Known parameters of the payload, NaN for unknown ones, shape (10,); `None` if all are unknown.
    """
    if known is not None:
        wide = np.where(deviation > 0.0, deviation, np.inf)
    else:
        wide = np.maximum(deviation, EXACT) if deviation.any() else None
    values, scale = solve_values(stacked, scale_deviation=wide, fixed=known)
    return payload_misfit(new, alone, stacked.to_new @ values, scale)

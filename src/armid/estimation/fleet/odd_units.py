"""Units of a fleet that differ from the others: in an own parameter, in a torque scale, or in the bodies.

Each own unknown of each unit is compared with the distribution of this unknown in all other units. The difference,
divided by its standard deviation, follows Student's t distribution if the unit is like the others, because the other
units alone determine mean and standard deviation [Cook1982]. Holm's method limits the probability that any unit of
a fleet is named falsely [Holm1979].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.distributions import chi_squared_survival
from armid.maths.median import median

FALSE_ALARM = 0.02
"""Probability that a fleet without odd units has a unit that is named falsely."""

FEWEST = 4
"""Smallest number of units with which a unit is judged: mean and standard deviation of the others need three."""

TOLD = 0.1
"""Share of the variance of an own unknown that the data of a unit must remove, so that this unknown is judged."""


@dataclass(frozen=True, slots=True)
class OddUnknown:
    """Own unknown of one unit that differs from the other units.

    Attributes:
        unit: Name of the unit.
        joint: Number of the joint, from 0.
        parameter: Name of the unknown, for instance `FV_2` or `scale_2`.
        value: Value of the unit.
        expected: Mean of the other units.
        deviation: Standard deviation of this unknown between the other units.
        score: Difference divided by its standard deviation.
        probability: Probability of a difference of this size in a unit like the others, corrected for the number of
            comparisons.
    """

    unit: str
    joint: int
    parameter: str
    value: float
    expected: float
    deviation: float
    score: float
    probability: float


@dataclass(frozen=True, slots=True)
class OddBodies:
    """Unit whose bodies differ from those of the other units.

    Attributes:
        unit: Name of the unit.
        joint: Number of the joint with the largest relative effect, from 0.
        effect: Largest change of the RMS torque of a joint, relative to its RMS torque.
        ratio: Squared difference of the bodies over its expected value.
        probability: Probability of a difference of this size in a unit like the others, corrected for the number of
            units.
    """

    unit: str
    joint: int
    effect: float
    ratio: float
    probability: float


def student_two_sided(score: Array, freedom: Array) -> Array:
    """Probability of a larger absolute value of Student's t; 1 where the score is NaN."""
    from scipy.special import stdtr  # slow to import

    nu = np.maximum(np.where(np.isfinite(freedom), freedom, 1.0), 1.0)
    return np.where(np.isfinite(score), 2.0 * stdtr(nu, -np.abs(np.nan_to_num(score))), 1.0)


def holm(probability: Array) -> Array:
    """Probabilities (k,) corrected for their number by Holm's method; NaN is not counted."""
    order = np.argsort(probability, kind="stable")
    factor = len(probability) - np.arange(len(probability))
    corrected = np.minimum(np.maximum.accumulate(probability[order] * factor), 1.0)
    result = np.empty_like(corrected)
    result[order] = corrected
    return result


def robust_start(own: Array, variance: Array, limit: float = 6.0) -> NDArray[np.bool_]:
    """Mask of the own unknowns that the first estimate of the scatter uses, shape (U, m).

    Unknowns are left out if they are far from the median of their units, so that several odd units do not hide each
    other.

    Args:
        own: Deviations of the own unknowns of each unit, shape (U, m).
        variance: Variances of these deviations, shape (U, m).
        limit: Distance from the median from which an unknown is left out, in robust standard deviations.
    """
    middle = np.array([median(column) for column in own.T])
    spread = np.array([1.4826 * median(np.abs(column - at)) for column, at in zip(own.T, middle, strict=True)])
    kept = np.abs(own - middle) <= limit * np.sqrt(spread**2 + variance)
    enough = kept.sum(axis=0) > len(own) // 2
    return kept | ~enough


def bodies_probability(squares: Array, freedom: int) -> tuple[Array, Array]:
    """Ratios of squared differences of the bodies to their expected value, and probabilities corrected for the units.

    Differences that all units have, because the model is not exact or the noise is larger than estimated, are taken
    as their normal size: the expected value is at least the median of all units.

    Args:
        squares: Squared difference of each unit, in units of its covariance, shape (U,).
        freedom: Number of shared parameters.
    """
    usual = max(float(median(squares)) / freedom, 1.0)
    probability = np.array([chi_squared_survival(freedom, float(each) / usual) for each in squares])
    return squares / (freedom * usual), holm(probability)

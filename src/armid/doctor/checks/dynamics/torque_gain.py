"""Check for a torque of one joint whose scale differs from the scale of the torques of the other joints.

A link is carried by several joints, so its parameters affect the torques of all of them. One model can therefore fit
all joints only if their torques have a common scale. This common scale cannot be determined without a description.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import cost_of, products
from armid.doctor.remedy_trial import HELPS
from armid.doctor.residuals import gain_by_amount
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

CODE = "torque-gain"

FACTORS = np.exp(np.linspace(-1.2, 1.2, 13))
"""Factors on the torque of a joint that are tried; a minimum at the first or the last factor is not accepted."""

NEAREST = (FACTORS[4], FACTORS[8])
"""Two factors of which at least one must reduce the cost; only then the others are tried."""

DECADES = 10.0 ** np.array([-4, -3, -2, -1, 1, 2, 3, 4])
"""Factors of other units of torque, such as mN·m or N·cm. The cost may have maxima between these factors and 1.
Therefore they are tried separately, and then the multiples of the best one by `FACTORS`, if the conflict between the
joints is larger than `BADLY`."""

BADLY = 0.2
"""Increase of the mean logarithm of the RMS residuals from separate fits of the joints to one model, from which
`DECADES` are tried."""

WRONG_UNIT = 5.0
"""Factor, or its inverse, from which the finding is an error: no drive gain is so uncertain, so the unit is wrong."""

LEAST = 1.35
"""Smallest factor, or its inverse, that is reported. On recorded arms the torque of a loaded joint fits those of the
others to 25 %; drive gains that are taken from a data sheet are as uncertain."""

GAIN = 0.08
"""Decrease of the mean logarithm of the RMS residuals from which the scale of a joint is reported. Without fault it
was at most 0.04 within the factors, on 16 recordings of eight arms and on 36 simulated logs. A factor of 1.6 or 0.5
gives 0.1 to 1 on joints that carry others."""

OUTER_GAIN = 0.2
"""The limit that is used instead of `GAIN` for another unit of the torques of all joints from one outwards. Without
fault it was at most 0.16, on an arm with light wrists; a factor of 1000 of three wrists gives 0.07 there, and 0.27 to
0.8 on other arms."""

SHARP = 0.02
"""Increase of the mean logarithm of the RMS residuals from the best factor to a factor 1.5 times (for another unit
2.2 times) as large or as small, from which the factor counts as determined."""

ALSO = 0.03
"""Difference of the mean logarithm of the RMS residuals up to which the other joint of a pair may have the inverse
factor."""

DEVIATION = 0.2
"""Relative standard deviation of a factor: on recorded arms its error was up to 20 %."""

NOTE = "from the torque of the other joints; use the maker's value"


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a joint whose torque has another scale than the torques of the other joints."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a wrong scale of one joint's torque; `None` if the scales agree.

    The scale may depend on the amount of the torque, and several outer joints may have another unit.
    """
    tried = (_by_factor(state), _by_unit_of_outer_joints(state), gain_by_amount.explain(CODE, state))
    found = [each for each in tried if each is not None]
    return max(found, key=lambda each: each.gain, default=None)


def _by_factor(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a factor on one joint's torque; `None` if there is none."""
    n = state.rows.n
    if n < 2 or state.conflict < GAIN:
        return None
    pairs = products(state.rows)
    begin = cost_of(state.rows, pairs)
    wide = state.conflict > BADLY
    found = [_best_factor(lambda f, j=j: _cost(state, pairs, j, f), begin, wide=wide) for j in range(n)]
    gains = np.array([begin - cost for _, cost in found])
    best = int(np.argmax(gains))
    factor = found[best][0]
    if gains[best] < GAIN or max(factor, 1.0 / factor) < LEAST:
        return None
    correction = np.ones(n)
    correction[best] = factor
    after = state.with_torque(correction)
    names = state.model.robot.joint_names
    others = [
        f"{names[j]} {1.0 / found[j][0]:.2g}"
        for j in np.flatnonzero(gains > gains[best] - ALSO)
        if j != best and max(found[j][0], 1.0 / found[j][0]) >= LEAST
    ]
    doubt = (
        " The model would fit about as well if, instead, the torque of another joint were wrong by a factor: "
        f"{' or '.join(others)}."
        if others
        else ""
    )
    return Explanation(
        CODE,
        float(gains[best]),
        "error" if max(factor, 1.0 / factor) > WRONG_UNIT else "warning",
        names[best],
        f"The torque of {names[best]} is about {1.0 / factor:.2g} times the value that the torques of the other "
        "joints imply; with its scale corrected, the residual of one model for all joints is "
        f"{1 - np.exp(-gains[best]):.0%} smaller.{doubt}",
        lambda evidence: _gain(evidence, correction),
        after,
        worse=HELPS,
    )


def _by_unit_of_outer_joints(state: LogState) -> Explanation | None:
    """Explains the misfit by another unit of the torques of all joints from one outwards; `None` if there is none.

    The drives of wrists are often of another make. The torques of single joints then contradict those of both sides.
    """
    n = state.rows.n
    if n <= 2 or state.conflict < BADLY:
        return None
    pairs = products(state.rows)
    begin, (gain, first, factor) = cost_of(state.rows, pairs), (0.0, 0, 1.0)
    for tail in range(1, n - 1):
        for decade in map(float, DECADES):
            factors = np.where(np.arange(n) < tail, 1.0, decade)
            less = begin - cost_of(state.rows, pairs, factors) + float(np.mean(np.log(factors)))
            gain, first, factor = max((gain, first, factor), (less, tail, decade))
    if gain < OUTER_GAIN:
        return None
    names, correction = state.model.robot.joint_names[first:], np.where(np.arange(n) < first, 1.0, factor)
    return Explanation(
        CODE,
        gain,
        "error",
        ", ".join(names),
        f"The torques of {', '.join(names)} are about {1.0 / factor:g} times the values that the torques of the "
        f"other joints imply: they have another unit. With it corrected, the residual of one model for all joints is "
        f"{1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: _gain(evidence, correction),
        state.with_torque(correction),
        worse=HELPS,
    )


def _cost(state: LogState, pairs: Sequence[Array], j: int, factor: float) -> float:
    """Mean logarithm of the RMS residuals if the torque of joint j is multiplied by a factor.

    The factor does not change the unit of the residual of joint j, so that factors can be compared.
    """
    factors = np.ones(state.rows.n)
    factors[j] = factor
    return cost_of(state.rows, pairs, factors) - float(np.log(factor)) / state.rows.n


def _best_factor(cost_with: Callable[[float], float], begin: float, *, wide: bool) -> tuple[float, float]:
    """Factor on the torque of a joint with the smallest cost, and this cost (infinite if no factor is determined).

    Args:
        cost_with: Function that returns the cost (mean logarithm of the RMS residuals) for a factor.
        begin: Mean logarithm of the RMS residuals with the factor 1.
        wide: True if the factors between units of torque are tried, too.
    """
    candidates = [_lowest_about(cost_with, 1.0, 2)] if min(map(cost_with, NEAREST)) < begin else []
    if wide:
        unit = float(min(DECADES, key=cost_with))
        candidates.append(_lowest_about(cost_with, unit, 4))
    return min(candidates, key=lambda found: found[1], default=(1.0, np.inf))


def _lowest_about(cost_with: Callable[[float], float], middle_factor: float, apart: int) -> tuple[float, float]:
    """Product of a factor and one of `FACTORS` with the smallest cost, interpolated; and this cost.

    Args:
        cost_with: Function that returns the cost (mean logarithm of the RMS residuals) for a factor.
        middle_factor: Factor that is multiplied by each of `FACTORS`.
        apart: Number of steps in `FACTORS` from the best product, in either direction, after which the cost must be
            larger by `SHARP`; otherwise the cost is infinite.
    """
    tried = middle_factor * FACTORS
    cost = np.array([cost_with(float(factor)) for factor in tried])
    k = int(np.argmin(cost))
    around = cost[max(k - apart, 0)], cost[min(k + apart, len(cost) - 1)]
    if not 0 < k < len(cost) - 1 or min(around) < cost[k] + SHARP:
        return 1.0, np.inf
    low, middle, high = cost[k - 1 : k + 2]
    step = 0.5 * (low - high) / (low - 2.0 * middle + high)  # vertex of the parabola through the three
    return float(tried[k] * np.exp(step * np.log(FACTORS[1] / FACTORS[0]))), float(cost[k])


def _gain(evidence: LogEvidence, correction: Array) -> str:
    """Lines of a study with drive gains, of which one is corrected, and their relative standard deviations."""
    reading = evidence.reading
    given = np.ones(len(correction)) if reading.drive_gain is None else np.asarray(reading.drive_gain)
    deviation = np.zeros(len(correction))
    if reading.drive_gain_deviation is not None:
        deviation = deviation + np.asarray(reading.drive_gain_deviation)
    deviation = np.where(correction != 1.0, np.maximum(deviation, DEVIATION), deviation)
    gains = [float(f"{each:.3g}") for each in given * correction]
    return lines(NOTE, drive_gain=gains, drive_gain_deviation=deviation)


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        CODE: "Inertial parameters that affect this joint and other joints are a compromise between two scales; the "
        "friction of this joint has the wrong scale.",
    },
    explain=explain,
    follows=("motor-side", "current-without-gain", "torque-unit"),
)

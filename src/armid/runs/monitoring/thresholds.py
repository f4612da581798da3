"""Thresholds of the external torque for a promised rate of false alarms, from residuals of unseen motion.

The residual of joint j is compared with c s_j(t) + F_j w_j(t). The scale s follows the motion,

    s² = a₀ + a₁ (change of the model's torque)² + a₂ q̇²,

or is constant, whichever gives the lower mean threshold at the same rate. F_j is the bound of the dry friction of the
joint. The weight w is 1 at rest, where dry friction may have any value up to its bound, and decays afterwards. The
factor c follows from the peaks of the square of the scaled residual (`armid.maths.peaks_over_threshold`), which has
an exponential tail if the residual is Gaussian. Each joint gets an equal share of the rate of false alarms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.maths.peaks_over_threshold import Tail, fit_tail
from armid.runs.monitoring.observer import Observed

GAP = 0.25
"""Shortest time without an exceedance that separates two alarms [s]; the disturbance by a reversal lasts about as
long."""

PROMISED = 1.5
"""Factor within which a promised rate is met in two of three cases: a rate is promised if the logarithm of the true
rate has a smaller standard deviation than the logarithm of this factor."""

REST_SPEED = 0.01
"""Speed below which a joint counts as resting, if it stays below for `REST_TIME` [rad/s or m/s]."""

REST_TIME = 0.1
"""Time that the speed must be below `REST_SPEED` for a joint to count as resting [s]; a reversal is shorter."""

AFTER_REST = 20.0
"""Rate at which the allowance for dry friction decays after a rest [1/s]."""

STICTION = 1.2
"""Bound of the friction at rest, divided by the Coulomb friction. Usual ratios are 1.1 to 1.5; the friction that
remains when a controller has stopped a joint is rarely at the bound."""

SMALLEST_SHARE = 0.05
"""Smallest ratio of the constant part a₀ of the squared scale to the mean square residual, because motion cannot
explain the whole residual."""

PASSES = 60
"""Number of multiplicative updates by which the coefficients of the scale are estimated."""

SCALE_ROWS = 20000
"""Largest number of rows from which the scale is estimated."""


@dataclass(frozen=True, eq=False, slots=True)
class Thresholds:
    """Thresholds of all joints.

    Attributes:
        scale: Coefficients a₀, a₁, a₂ of the squared scale s² of each joint, shape (n, 3).
        factor: Factor c of each joint, shape (n,).
        follows: Mask of the joints whose threshold depends on the motion, shape (n,).
        friction: Allowance F for dry friction at rest, shape (n,) [N·m or N].
        covariance: Covariance of the residuals of the joints, shape (n, n).
        rate: False alarms per hour for which the thresholds were made.
        smallest: Smallest rate per hour that can be promised with these residuals; infinite if none can.
        seconds: Duration of the unseen motion [s].
        mean: Mean threshold of each joint on the unseen motion, without the allowance F, shape (n,) [N·m or N].
        constant: Threshold of each joint for the same rate if it does not depend on the motion, shape (n,) [N·m or
            N].
    """

    scale: Array
    factor: Array
    follows: NDArray[np.bool_]
    friction: Array
    covariance: Array
    rate: float
    smallest: float
    seconds: float
    mean: Array
    constant: Array

    def __post_init__(self) -> None:
        n = len(self.factor)
        for name, shape in (("scale", (n, 3)), ("factor", (n,)), ("friction", (n,)), ("covariance", (n, n))):
            object.__setattr__(self, name, array(getattr(self, name), shape, name))

    @property
    def promised(self) -> bool:
        """True if the rate of false alarms can be promised: it is at least `smallest`."""
        return self.rate >= self.smallest

    def along(self, observed: Observed) -> Array:
        """Threshold of each sample and joint, shape (N, n) [N·m or N]."""
        a = self.scale
        scale = np.sqrt(a[:, 0] + a[:, 1] * observed.change**2 + a[:, 2] * observed.dq**2)
        return self.factor * scale + self.friction * rest_weight(observed)


def alarm_rows(over: NDArray[np.bool_], rate: float) -> list[NDArray[np.intp]]:
    """Rows of each alarm along a contiguous part; exceedances within `GAP` are one alarm.

    Args:
        over: True where a joint exceeds its threshold, shape (N, n).
        rate: Sample rate [Hz].
    """
    at = np.flatnonzero(over.any(axis=1))
    gap = max(1, round(GAP * rate))
    return np.split(at, np.flatnonzero(np.diff(at) >= gap) + 1) if len(at) else []


def usable_seconds(parts: Sequence[Observed]) -> float:
    """Total time in which alarms were possible on at least one joint, over all parts [s]."""
    return sum(float(np.count_nonzero(each.usable.any(axis=1))) / each.rate for each in parts)


def rest_weight(observed: Observed) -> Array:
    """Weight w of the allowance for dry friction at each sample, shape (N, n): 1 at rest, decaying afterwards."""
    slow = np.abs(observed.dq) < REST_SPEED
    needed = int(np.ceil(REST_TIME * observed.rate))
    index = np.arange(len(slow))[:, None]
    last_moving = np.maximum.accumulate(np.where(slow, -needed, index), axis=0)
    resting = slow & (index - last_moving >= needed)
    last_resting = np.maximum.accumulate(np.where(resting, index, -(10**9)), axis=0)
    return np.exp(-AFTER_REST / observed.rate * np.minimum(index - last_resting, 10**6))


def find_thresholds(
    unseen: Sequence[Observed], friction: Array, per_hour: float
) -> tuple[Thresholds, tuple[Tail | None, ...]]:
    """Computes the thresholds for a rate of false alarms.

    Args:
        unseen: Residuals of unseen motion without contact.
        friction: Dry friction of each joint, shape (n,) [N·m or N].
        per_hour: False alarms per hour, of the whole arm.

    Returns:
        The thresholds, and the tail of the distribution of each joint's residual. If the motion is too short for a
        tail, it is `None`, and the threshold is the largest residual.
    """
    n = unseen[0].external.shape[1]
    allowance = STICTION * friction
    share = per_hour / 3600.0 / n
    scale, factor, follows = np.zeros((n, 3)), np.zeros(n), np.zeros(n, dtype=np.bool_)
    mean, constant = np.zeros(n), np.zeros(n)
    tails: list[Tail | None] = []
    for j in range(n):
        parts = [_of_joint(each, j, allowance[j]) for each in unseen]
        flat, own = _constant_scale(parts), _fitted_scale(parts)
        (plain, low), (moving, high) = (_factor(parts, a, share) for a in (flat, own))
        rows = np.concatenate([p.squares[~np.isnan(p.residual)] for p in parts])
        constant[j], moved = (c * float(np.mean(np.sqrt(rows @ a))) for c, a in ((plain, flat), (moving, own)))
        follows[j] = moved < constant[j]
        scale[j], factor[j], mean[j] = (own, moving, moved) if follows[j] else (flat, plain, constant[j])
        tails.append(high if follows[j] else low)
    found = Thresholds(
        scale, factor, follows, allowance, residual_covariance(unseen), per_hour, smallest_rate(tails),
        usable_seconds(unseen), mean, constant,
    )  # fmt: skip
    return found, tuple(tails)


def smallest_rate(tails: Sequence[Tail | None]) -> float:
    """Smallest rate of false alarms of the whole arm that can be promised within the factor `PROMISED` [1/h].

    The result is infinite if no rate can be promised. The errors of the rates of n joints count as independent, so
    the relative error of their sum is smaller by the factor √n.

    Args:
        tails: Tail of the distribution of each joint's residual; `None` if the motion is too short.
    """
    known = [tail for tail in tails if tail is not None]
    if len(known) < len(tails) or not known:
        return np.inf
    n = len(known)
    allowed = np.log(PROMISED)
    low, high = np.log(1e-9), np.log(min(tail.clusters / tail.seconds for tail in known))

    def deviation(log_rate: float) -> float:
        return float(np.sqrt(sum(tail.log_deviation(np.exp(log_rate)) ** 2 for tail in known))) / n

    if deviation(high) > allowed:
        return np.inf
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if deviation(middle) <= allowed else (middle, high)
    return float(np.exp(high)) * 3600.0 * n


def residual_covariance(unseen: Sequence[Observed]) -> Array:
    """Mean products of the residuals of two joints on unseen motion, shape (n, n) [(N·m)² or N²]."""
    rows = np.concatenate([each.external[each.usable.all(axis=1)] for each in unseen])
    return rows.T @ rows / max(len(rows), 1)


@dataclass(frozen=True, eq=False, slots=True)
class _Part:
    """Residual of one joint along a contiguous part of N samples.

    Attributes:
        residual: Absolute residual minus the allowance for friction at rest, at least 0; NaN for samples that are not
            usable, shape (N,) [N·m or N].
        squares: One, squared change of the model's torque, and squared velocity, shape (N, 3).
        rate: Sample rate [Hz].
    """

    residual: Array
    squares: Array
    rate: float


def _of_joint(observed: Observed, j: int, allowance: float) -> _Part:
    weight = rest_weight(observed)[:, j]
    residual = np.maximum(np.abs(observed.external[:, j]) - allowance * weight, 0.0)
    squares = np.column_stack([np.ones(len(residual)), observed.change[:, j] ** 2, observed.dq[:, j] ** 2])
    return _Part(np.where(observed.usable[:, j], residual, np.nan), squares, observed.rate)


def _constant_scale(parts: Sequence[_Part]) -> Array:
    square = np.nanmean(np.concatenate([part.residual for part in parts]) ** 2)
    return np.array([max(float(square), 1e-12), 0.0, 0.0])


def _fitted_scale(parts: Sequence[_Part]) -> Array:
    """Nonnegative coefficients a of the squared scale with the highest Gaussian likelihood, shape (3,).

    They are computed by multiplicative updates [Fevotte2009].
    """
    every = max(1, sum(len(part.residual) for part in parts) // SCALE_ROWS)
    residual = np.concatenate([part.residual[::every] for part in parts])
    squares = np.concatenate([part.squares[::every] for part in parts])[~np.isnan(residual)]
    power = residual[~np.isnan(residual)] ** 2
    mean = max(float(power.mean()), 1e-12)
    sizes = squares.mean(axis=0)
    moving = sizes > 1e-12  # a joint that stands has no velocity to follow
    a = np.where(moving, mean / np.where(moving, sizes, 1.0) / 3.0, 0.0)
    for _ in range(PASSES):
        variance = squares @ a
        ratio = (squares.T @ (power / variance**2))[moving] / (squares.T @ (1.0 / variance))[moving]
        a[moving] *= np.sqrt(ratio)
        a[0] = max(a[0], SMALLEST_SHARE * mean)
    return a


def _factor(parts: Sequence[_Part], a: Array, rate: float) -> tuple[float, Tail | None]:
    """Factor c of a joint for a rate of false alarms, and the tail of its scaled residual.

    If the motion is too short for a tail, the factor is the largest scaled residual, and the tail is `None`.

    Args:
        parts: Residual of the joint along each part.
        a: Coefficients of the squared scale, shape (3,).
        rate: Rate of false alarms of the joint [1/s].
    """
    scaled = [(part.residual**2 / (part.squares @ a), part.rate) for part in parts]
    tail = fit_tail(scaled, GAP)
    if tail is None:
        return float(np.sqrt(np.nanmax(np.concatenate([x for x, _ in scaled])))), None
    return float(np.sqrt(tail.exceeded_with(rate))), tail

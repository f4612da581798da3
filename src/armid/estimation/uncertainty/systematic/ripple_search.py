"""Search for torque ripple: parts of the residuals of an estimate that are periodic in a joint's angle.

Gears, motors and torque sensors cause such ripple. Where a joint is slow, the ripple passes the filter, and it has
the same sign at the same angle, so it shifts parameters by more than noise of the same size does. For each joint and
number of waves k, the residual r of part p of the time gives

    z_p = Σ g r exp(-i k q),        n_p = Σ g²,

with the gain g of the filter at the momentary frequency k |q̇| / 2π. Noise makes the z_p of different parts
independent, with variances in proportion to n_p. A ripple makes them a n_p with the same complex amplitude a. So
the explained sum |Σ z_p|² / Σ n_p and the rest Σ |z_p - a n_p|² / n_p have the ratio of an F test with 2 and
2 (P - 1) degrees of freedom, whatever the colour of the noise within a part. The waves that pass the test become
columns of `armid.estimation.uncertainty.systematic.systematic_errors`, which has the exact filter and the columns of
the model.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.cross_products_by_frequency import column_numbers, find_periods
from armid.estimation.uncertainty.systematic.systematic_errors import ErrorKind, part_seconds, parts_of_rows
from armid.information.kept_rows import kept_rows
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun

LOWEST, HIGHEST = 2.0, 250.0
"""Smallest and largest number of waves in a turn that are tried. One wave is gravity. More than 250 waves pass the
filter only next to reversals, whose effect is estimated separately. In the residuals of recorded arms, ripple had 4,
8 and 221 waves."""

LARGEST_RANGE, HALF_WAVE = 6.0 * np.pi, 0.5
"""Largest range of positions [rad] for which the tried numbers of waves are as close as the range can resolve, and
distance between the tried numbers for larger ranges. The computing time grows with their number: a joint with a range
of a hundred turns would need minutes."""

TURNS = 1.5
"""Smallest number of waves within the range of the joint; fewer waves do not show that the torque repeats."""

STEP = 1.5
"""Step between numbers of waves that are tried, times the range of the joint [rad]. For a number of waves halfway
between two tried numbers, the phase is then wrong by at most 0.4 rad at the ends of the range."""

FINER = 8
"""Number of finer steps into which a step is divided near the best number of waves."""

LEVEL = 1e-3
"""Significance level: probability that noise alone gives a ripple on a joint, over all numbers of waves that are
tried."""

MOST_WAVES = 3
"""Largest number of ripples of a joint with different numbers of waves: usual gears have two significant orders."""

FEWEST_PARTS = 8
"""Smallest number of parts of the time that must contain information about a ripple."""

SHARE = 0.1
"""Smallest mean squared gain of the filter for a number of waves. A ripple that passes the filter only next to
reversals resembles friction at reversals, whose effect is estimated separately."""

APART = 2.0
"""Smallest distance between the numbers of waves of two ripples of a joint, in units of the step between tried
numbers. The data do not distinguish ripples that are closer."""

SEEN = 0.01
"""Smallest information of a part of the time about a ripple, relative to that of the part with the most information,
with which the part is used."""


@dataclass(frozen=True, eq=False, slots=True)
class _Residual:
    """Residual of one joint in the M rows that are used.

    Attributes:
        q, dq: Positions [rad] and velocities [rad/s], shape (M,).
        torque: Residuals, shape (M,) [N·m].
        part: Index of the first row of each of the P parts of the time, shape (P,).
        band: Low-pass filter of the rows.
    """

    q: Array
    dq: Array
    torque: Array
    part: NDArray[np.int64]
    band: Band

    def gain(self, waves: float) -> Array:
        """Gain of the filter at the momentary frequency of a ripple with `waves` waves in a turn, shape (M,)."""
        if self.band.is_open:
            return np.ones(len(self.q))
        squared = (waves / (2.0 * np.pi * self.band.cutoff) * self.dq) ** 2
        power = squared.copy()
        for _ in range(self.band.order - 1):  # far faster than a general power
            power *= squared
        return np.asarray(1.0 / (1.0 + power), dtype=np.float64)

    def test(self, waves: Array) -> tuple[Array, Array]:
        """Tests the residual for ripples with given ascending numbers of waves, which must be equally spaced.

        The more waves, the less passes the filter, so the numbers behind the first one that is below `SHARE` are too.

        Returns:
            For each number of waves, the logarithm of the probability that noise alone gives so large an amplitude,
            shape (waves,), and the complex amplitude [N·m], shape (waves,).
        """
        z = np.zeros((len(waves), len(self.part)), dtype=np.complex128)
        n = np.zeros(z.shape)
        turned = self.torque * np.exp(-1j * waves[0] * self.q)
        turn = np.exp(-1j * (waves[1] - waves[0]) * self.q) if len(waves) > 1 else turned
        for k, each in enumerate(waves.tolist()):
            gain = self.gain(each)
            n[k] = np.add.reduceat(gain * gain, self.part)
            if n[k].sum() < SHARE * len(self.q):
                break
            z[k] = np.add.reduceat(gain * turned, self.part)
            turned *= turn
        whole = np.maximum(n.sum(axis=1), np.finfo(float).tiny)
        a = z.sum(axis=1) / whole
        seen = n > SEEN * n.max(axis=1, keepdims=True)
        explained = np.abs(a) ** 2 * whole
        left = np.sum(np.where(seen, np.abs(z - a[:, None] * n) ** 2 / np.where(seen, n, 1.0), 0.0), axis=1)
        count = np.where(n.sum(axis=1) >= SHARE * len(self.q), seen.sum(axis=1), 0)
        log_p = -(count - 1) * np.log1p(explained / np.maximum(left, np.finfo(float).tiny))
        return np.where(count >= FEWEST_PARTS, log_p, 0.0), 2.0 * a

    def without(self, waves: float, amplitude: complex) -> _Residual:
        """Residual from which the ripple with a given number of waves and complex amplitude [N·m] is subtracted."""
        wave = np.real(amplitude * np.exp(1j * waves * self.q)) * self.gain(waves)
        return _Residual(self.q, self.dq, self.torque - wave, self.part, self.band)


def ripple_kinds(problem: EstimationProblem, values: Array, weights: Array, largest: float) -> tuple[ErrorKind, ...]:
    """Ripple of each joint that is significant in the residuals: two errors (sine and cosine) per number of waves.

    Args:
        problem: Problem with its samples, in c parameters.
        values: Parameters of each joint's torque, shape (n, c).
        weights: Weight of each joint's rows, shape (n,).
        largest: Largest weighted residual of a row that is used; infinite for all rows.
    """
    model, _, _ = problem.require_samples("cover")
    kinds: list[ErrorKind] = []
    for j, residual in enumerate(_residuals(problem, values, weights, largest)):
        if model.robot.joints[j].is_prismatic or len(residual.part) < FEWEST_PARTS:
            continue
        for waves, amplitude in _waves(residual):
            kinds += [ErrorKind("ripple", j, amplitude, waves, phase) for phase in (0.0, np.pi / 2.0)]
    return tuple(kinds)


def _waves(residual: _Residual) -> list[tuple[float, float]]:
    """Numbers of waves in a turn and amplitudes [N·m] of the ripples of one joint, the most significant first."""
    extent = float(np.ptp(residual.q))
    lowest = max(LOWEST, 2.0 * np.pi * TURNS / max(extent, np.finfo(float).tiny))
    if lowest >= HIGHEST:
        return []
    step = STEP / extent
    apart = step if extent <= LARGEST_RANGE else HALF_WAVE
    tried = np.arange(np.ceil(lowest / apart) * apart, HIGHEST, apart)
    found: list[tuple[float, float]] = []
    for _ in range(MOST_WAVES):
        if not len(tried):
            break
        log_p = np.concatenate([residual.test(each)[0] for each in _equally_spaced(tried, apart)])
        near = tried[int(np.argmin(log_p))] + step * np.linspace(-1.0, 1.0, 2 * FINER + 1)
        near = near[(near >= lowest) & (near <= HIGHEST)]
        log_p, amplitude = residual.test(near)
        best = int(np.argmin(log_p))
        if log_p[best] > np.log(LEVEL / len(tried)):
            break
        found.append((float(near[best]), float(np.abs(amplitude[best]))))
        tried = tried[np.abs(tried - near[best]) > APART * step]
        residual = residual.without(float(near[best]), complex(amplitude[best]))
    return found


def _equally_spaced(waves: Array, step: float) -> list[Array]:
    """Splits numbers of waves at gaps larger than `step` into arrays with equal spacing."""
    return np.split(waves, np.flatnonzero(np.diff(waves) > 1.5 * step) + 1)


def _part_of_motion(run: ObservedRun, seconds: float) -> NDArray[np.int64]:
    """Index of the part of the time to which each row belongs, shape (M,).

    If the motion repeats, a part contains the rows at the same place in all periods, because errors of the model
    repeat with the motion, so that periods are not independent.
    """
    part, periods = parts_of_rows(run, seconds), find_periods(run)
    if periods is None:
        return part
    row = np.arange(len(part))
    period = np.maximum(np.searchsorted(periods[:-1], row, side="right") - 1, 0)
    return part[np.minimum(np.maximum(row - periods[:-1][period], 0), len(part) - 1)]


def _residuals(problem: EstimationProblem, values: Array, weights: Array, largest: float) -> list[_Residual]:
    """Residuals of each joint in the rows of all runs, one element per joint.

    Args:
        problem: Problem with its samples, in c parameters.
        values: Parameters of each joint's torque, shape (n, c).
        weights: Weight of each joint's rows, shape (n,).
        largest: Largest weighted residual of a row that is used; infinite for all rows.
    """
    model, base, observations = problem.require_samples("cover")
    every, band = kept_rows(model, base, observations), observations.band
    source = every.source
    seconds = part_seconds(observations.runs)
    parts: list[list[tuple[Array, Array, Array, NDArray[np.int64]]]] = [[] for _ in range(model.n)]
    first = 0
    for index, run in enumerate(every.observations.runs):
        parameters = column_numbers(source, problem.information.names, run)
        part = first + _part_of_motion(run, seconds)
        first = int(part.max()) + 1
        for batch in every.of_run(index):
            x, begin, end = batch.x, batch.begin, batch.begin + batch.x.shape[1]
            chosen = run.rows[begin:end]
            for j, (a, b) in enumerate(itertools.pairwise(source.layout.offset)):
                residual = x[b - 1] - values[j, parameters[j]] @ x[a : b - 1]
                used = run.mask[begin:end, j] & (np.abs(weights[j] * residual) <= largest)
                q, dq = run.motion.q[chosen, j][used], run.motion.dq[chosen, j][used]
                parts[j].append((q, dq, residual[used], part[begin:end][used]))
    result: list[_Residual] = []
    for own in parts:
        q, dq, torque, part = (np.concatenate(each) for each in zip(*own, strict=True))
        order = np.argsort(part, kind="stable")
        first_rows = np.flatnonzero(np.diff(part[order], prepend=-1))
        result.append(_Residual(q[order], dq[order], torque[order], first_rows, band))
    return result

"""Systematic errors of measurement and friction that every recording has, and their effect on an estimate.

Some kinds of error are small, and no residual shows them clearly: the torque is late by a part of a sample or passes
a low-order lag, the zeros of the encoders are wrong by a milliradian, friction rises near rest, and gears cause
ripple. To first order, each of them adds a column to the torque of the model:

- a delay or a first-order lag of joint j by T seconds adds -T dτ_j/dt to the torque of this joint;
- a zero error of the positions of joint k adds ∂τ/∂q_k to the torques of all joints;
- friction that rises near rest adds sign(q̇_j) exp(-(q̇_j / v)²) to the torque of joint j;
- ripple with k waves in a turn adds sin(k q_j) and cos(k q_j) to the torque of joint j.

With the weighted columns V of m such errors, the weighted rows X and the normal matrix H, an error e changes the
estimate by S e with S = H⁻¹XᵀV. The residuals contain the information VᵀV - VᵀX H⁻¹XᵀV about e; the second term is
lost, because the parameters explain a part of any error. All products are computed in one pass over the samples.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.cross_products_by_frequency import column_numbers
from armid.information.base_regressor_layout import ColumnSource
from armid.information.filtering import in_band
from armid.information.kept_rows import kept_rows
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.model.motion import Motion

STEP = 1e-4
"""Step of the difference quotient of the torque by a position [rad or m]: the errors by rounding and by curvature are
both below 1e-7 of the torque."""

CHUNK = 8192
"""Number of samples whose columns are in memory at a time."""

SAMPLES_OF_DELAY = 0.5
"""Prior standard deviation of the delay of a joint's torque [samples]. The assignment of torques to samples of the
motion is known to one sample at best; filters of drives add a delay of the same size."""

RISE_DEVIATION = 0.1
"""Prior standard deviation of the rise of friction near rest, divided by the Coulomb friction."""

RISE_SHARE = 0.15
"""Speed v of the law sign(q̇) exp(-(q̇ / v)²) by which friction rises near rest, divided by the RMS speed of the
joint."""

OUTLIER = 3.0
"""Largest residual, in standard deviations, of the rows from which systematic errors are estimated if the estimator
is robust."""

MOST_PARTS = 60
"""Largest number of parts of the time, in addition to one part for each run. In long recordings the parts are longer,
so that the needed memory does not grow."""

PART_SECONDS = 1.0
"""Smallest length of the parts into which the time of a run is divided [s]; blocks of rows have the same length. The
noise in different parts counts as independent."""


@dataclass(frozen=True, slots=True)
class ErrorKind:
    """Kind of systematic error.

    Attributes:
        name: `delay`, `zero`, `rise` or `ripple`.
        joint: Index of the joint.
        deviation: Prior standard deviation of the error [s, rad or m, N·m or N].
        waves: Number of waves in a turn, for ripple.
        phase: Phase of the wave at position zero, for ripple [rad].
    """

    name: str
    joint: int
    deviation: float
    waves: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class ErrorProducts:
    """Products of the columns of m systematic errors with the rows of an estimate of b unknowns, in P parts of time.

    X are the weighted rows, and V the weighted columns of the errors.

    Attributes:
        kinds: The m errors.
        rows: Products XᵀX, shape (P, b, b).
        pulls: Products XᵀV, shape (P, b, m).
        normals: Products VᵀV, shape (P, m, m).
        row_scores: Products Xᵀr with the weighted residuals r, shape (P, b).
        scores: Products Vᵀr, shape (P, m).
    """

    kinds: tuple[ErrorKind, ...]
    rows: Array
    pulls: Array
    normals: Array
    row_scores: Array
    scores: Array


def error_kinds(problem: EstimationProblem, values: Array) -> tuple[ErrorKind, ...]:
    """Systematic errors that are possible in the recordings of a problem.

    Args:
        problem: Problem with its samples.
        values: Parameters of each joint's torque, shape (n, c).
    """
    model, _, observations = problem.require_samples("cover")
    sample = max((1.0 / run.rate for run in observations.runs if run.consecutive), default=0.0)
    rise = np.zeros(model.n)
    for k, name in enumerate(problem.information.names):
        if name.symbol == "FS" and name.number is not None:
            joint = name.number - 1
            rise[joint] = max(rise[joint], RISE_DEVIATION * abs(float(values[joint, k])))
    zero = problem.zero_deviation
    listed = [
        *(ErrorKind("delay", j, SAMPLES_OF_DELAY * sample) for j in range(model.n)),
        *(ErrorKind("zero", j, float(zero[j])) for j in range(model.n)),
        *(ErrorKind("rise", j, float(rise[j])) for j in range(model.n)),
    ]
    return tuple(each for each in listed if each.deviation > 0.0)


def error_products(
    problem: EstimationProblem,
    kinds: Sequence[ErrorKind],
    values: Array,
    weights: Array,
    column_maps: Sequence[Array] | None,
    largest: float,
) -> ErrorProducts:
    """Computes the products of systematic errors with rows and residuals.

    Args:
        problem: Problem with its samples, in c parameters.
        kinds: The m errors.
        values: Parameters of each joint's torque, shape (n, c).
        weights: Weight of each joint's rows, shape (n,).
        column_maps: Matrices from b unknowns to the parameters of each joint's columns, shapes (c, b); if not given,
            the unknowns are the parameters.
        largest: Largest weighted residual of a row that is used; infinite for all rows.
    """
    model, base, observations = problem.require_samples("cover")
    every = kept_rows(model, base, observations)
    source = every.source
    seconds = part_seconds(observations.runs)
    found: list[Array] = []
    for index, run in enumerate(every.observations.runs):
        parameters = column_numbers(source, problem.information.names, run)
        errors = _error_columns(source, run, observations.band, kinds, parameters, values)
        part = parts_of_rows(run, seconds)
        u = values.shape[1] if column_maps is None else column_maps[0].shape[1]
        sums = np.zeros((int(part[-1]) + 1, u + len(kinds), u + len(kinds) + 1))
        columns = _Columns(source, run, parameters, values, weights, errors, column_maps, largest)
        for batch in every.of_run(index):
            _add_products(sums, part, batch.begin, batch.x, columns)
        found.append(sums)
    whole = np.concatenate(found)
    m = len(kinds)
    return ErrorProducts(
        tuple(kinds), whole[:, :-m, : -m - 1], whole[:, :-m, -m - 1 : -1], whole[:, -m:, -m - 1 : -1],
        whole[:, :-m, -1], whole[:, -m:, -1],
    )  # fmt: skip


def part_seconds(runs: Sequence[ObservedRun]) -> float:
    """Length of the parts into which the time of runs is divided [s]."""
    return max(PART_SECONDS, sum(run.motion.samples / run.rate for run in runs) / MOST_PARTS)


def parts_of_rows(run: ObservedRun, seconds: float) -> NDArray[np.int64]:
    """Index of the part of the time to which each of the M rows of a run belongs, shape (M,).

    Args:
        run: The run.
        seconds: Length of a part [s].
    """
    return np.asarray(np.arange(len(run.rows)) * run.step // max(round(seconds * run.rate), 1), dtype=np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class _Columns:
    """Regressor columns of a run, with the columns of the systematic errors appended.

    Attributes:
        source: Layout of the columns.
        run: The run.
        parameters: Indices of the parameters of each joint's columns.
        values: Parameters of each joint's torque, shape (n, c).
        weights: Weight of each joint's rows, shape (n,).
        errors: Change of each joint's torque by one unit of each error, shape (M, n, m).
        column_maps: Matrices from b unknowns to the parameters of each joint's columns, shapes (c, b); `None` if the
            unknowns are the parameters.
        largest: Largest weighted residual of a row that is used.
    """

    source: ColumnSource
    run: ObservedRun
    parameters: Sequence[NDArray[np.int64]]
    values: Array
    weights: Array
    errors: Array
    column_maps: Sequence[Array] | None
    largest: float

    def weighted(self, j: int, x: Array, own: slice) -> tuple[NDArray[np.int64], Array, Array]:
        """Weighted columns and residuals of joint j in the rows of a part of the run that are used.

        Args:
            j: Index of the joint.
            x: Columns of all joints with their torques in these rows.
            own: Rows of the run.

        Returns:
            Indices of the unknowns and errors, shape (k,), their columns, shape (k, M), and residuals, shape (M,).
        """
        first, last = self.source.layout.offset[j : j + 2]
        used, at = self.run.mask[own, j], self.parameters[j]
        block = self.weights[j] * x[first:last][:, used]
        residual, columns = block[-1] - self.values[j, at] @ block[:-1], block[:-1]
        u = self.values.shape[1]
        if self.column_maps is not None:
            columns, u = self.column_maps[j][at].T @ columns, self.column_maps[j].shape[1]
            at = np.arange(u)
        columns = np.concatenate([columns, self.weights[j] * self.errors[own, j][used].T])
        at = np.append(at, u + np.arange(self.errors.shape[2]))
        kept = np.abs(residual) <= self.largest
        return at, columns[:, kept], residual[kept]


def _add_products(sums: Array, part: NDArray[np.int64], begin: int, x: Array, columns: _Columns) -> None:
    """Adds the products of a batch of rows to the sums of the parts of the time to which the rows belong.

    Args:
        sums: Sums of products for each part of the time, which are changed in place.
        part: Index of the part to which each row of the run belongs, shape (M,).
        begin: Index of the first row of the batch.
        x: Columns of all joints with their torques in the batch.
        columns: Columns of the run and of the errors.
    """
    end = begin + x.shape[1]
    for p in np.unique(part[begin:end]):
        first, last = np.searchsorted(part, [p, p + 1])
        own = slice(max(int(first), begin), min(int(last), end))
        for j in range(columns.run.mask.shape[1]):
            at, block, residual = columns.weighted(j, x[:, own.start - begin : own.stop - begin], own)
            sums[p, at[:, None], at] += block @ block.T
            sums[p, at, -1] += block @ residual


def _error_columns(
    source: ColumnSource,
    run: ObservedRun,
    band: Band,
    kinds: Sequence[ErrorKind],
    parameters: Sequence[NDArray[np.int64]],
    values: Array,
) -> Array:
    """Change of each joint's torque by one unit of each of m errors, on the output grid, shape (M, n, m).

    Args:
        source: Layout of the columns.
        run: The run.
        band: Low-pass filter of the columns.
        kinds: The m errors.
        parameters: Indices of the parameters of each joint's columns.
        values: Parameters of each joint's torque, shape (n, c).
    """
    M, n = run.mask.shape
    result = np.zeros((M, n, len(kinds)))
    names = {kind.name for kind in kinds}
    slope = _filtered(_slope(source, run, parameters, values), run, band) if "delay" in names else None
    rise = _filtered(_rise(run.motion), run, band) if "rise" in names else None
    on_grid = run.motion[slice(run.offset, None, run.step)]
    for k, kind in enumerate(kinds):
        if kind.name == "zero":
            result[:, :, k] = _by_position(source, on_grid, kind.joint, parameters, values)
        elif kind.name == "ripple":
            wave = np.sin(kind.waves * run.motion.q[:, kind.joint] + kind.phase)
            result[:, kind.joint, k] = _filtered(wave[:, None], run, band)[:, 0]
        else:
            column = slope if kind.name == "delay" else rise
            result[:, kind.joint, k] = 0.0 if column is None else column[:, kind.joint]
    return result


def _filtered(x: Array, run: ObservedRun, band: Band) -> Array:
    """Filters signals (N, n) of a run like the columns, and takes the samples on the output grid, shape (M, n)."""
    filtered = in_band(x, run.rate, band) if run.consecutive and band.columns else x
    return np.asarray(filtered[run.rows], dtype=np.float64)


def _slope(source: ColumnSource, run: ObservedRun, parameters: Sequence[NDArray[np.int64]], values: Array) -> Array:
    """Negative time derivative of the torque of the model at full rate, shape (N, n) [N·m/s or N/s]."""
    if not run.consecutive:
        return np.zeros_like(run.motion.q)
    parts = [_torque(source, part, parameters, values) for part in _chunks(run.motion)]
    return np.asarray(-np.gradient(np.concatenate(parts), axis=0) * run.rate, dtype=np.float64)


def _rise(motion: Motion) -> Array:
    """Friction law sign(q̇) exp(-(q̇ / v)²) of each joint along a motion, with size one near rest, shape (N, n)."""
    usual = np.sqrt(np.mean(motion.dq**2, axis=0))
    fade = RISE_SHARE * np.where(usual > 0.0, usual, 1.0)
    return np.sign(motion.dq) * np.exp(-((motion.dq / fade) ** 2))


def _by_position(
    source: ColumnSource, motion: Motion, joint: int, parameters: Sequence[NDArray[np.int64]], values: Array
) -> Array:
    """Error of all joints' torques per unit of the zero error of a joint, shape (M, n).

    It is measured minus predicted torque, divided by the zero error e: if logged positions are too large by e, the
    model predicts the torque at q + e, and the measured torque belongs to q.
    """
    result: list[Array] = []
    for part in _chunks(motion):
        moved = [_torque(source, _moved(part, joint, step), parameters, values) for step in (-STEP, STEP)]
        result.append((moved[0] - moved[1]) / (2.0 * STEP))
    return np.concatenate(result)


def _moved(motion: Motion, joint: int, step: float) -> Motion:
    """Motion in which `step` is added to the positions of one joint; the hysteresis states stay the same."""
    q = np.array(motion.q)
    q[:, joint] += step
    return replace(motion, q=q)


def _chunks(motion: Motion) -> Iterator[Motion]:
    """Yields a motion in parts of at most `CHUNK` samples."""
    for begin in range(0, motion.samples, CHUNK):
        yield motion[slice(begin, begin + CHUNK)]


def _torque(source: ColumnSource, motion: Motion, parameters: Sequence[NDArray[np.int64]], values: Array) -> Array:
    """Torque of the model along a motion, with separate parameters for each joint, shape (N, n) [N·m or N]."""
    zero = np.zeros_like(motion.q)
    terms = source.term_rows(motion)
    q, dq, ddq = (np.ascontiguousarray(each) for each in (motion.q, motion.dq, motion.ddq))
    x = kernel.columns(source.tree, source.layout, q, dq, ddq, zero, terms)
    borders = enumerate(itertools.pairwise(source.layout.offset))
    return np.stack([values[j, parameters[j]] @ x[a : b - 1] for j, (a, b) in borders], axis=1)

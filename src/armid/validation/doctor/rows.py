"""A recording reduced to some hundred rows, and fits to them that take milliseconds.

The doctor asks many times how well a model explains a log: as it stands, with its channels in another order, with
another gravity. Torque and columns pass one band, as for an estimate; each joint keeps a triangular factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.information.band import Band
from armid.information.filtering import in_band
from armid.information.observations import ObservedRun
from armid.information.rows import all_rows
from armid.information.setup import ColumnSource
from armid.maths.sampling import automatic_cutoff
from armid.maths.signals import decimate, decimation_filter
from armid.measurement.clock import Stretch, evened, stretches
from armid.measurement.movement import movement
from armid.measurement.processing import Processing
from armid.measurement.recording import Recording
from armid.measurement.rows import moving, run_of, separate_rows
from armid.measurement.standstill import position_noise, standing
from armid.model.motion import Motion
from armid.values import Array

__all__ = ["Fit", "Rows", "Thin", "cost_of", "make_rows", "products", "solve", "thin"]

CUTOFFS = (2.0, 6.0)
"""Limits of the band that is looked at [Hz]: faults of a log show where the motion is, not above it."""

THIN_RATE = 20.0
"""Samples a second that are kept, in units of the cut-off: reversals of friction are sharper than the band, and
with fewer their columns alias."""

ROWS_RATE = 4.0
"""Rows a second in units of the cut-off: twice what the band holds."""

SEPARATE = 1000
"""Rows that are kept, or up to twice as many, where they do not follow each other: what the band keeps of half a
minute. What a model lacks makes neighbours alike, and where their order is lost nobody sees by how much."""

LONGEST = 60.0
"""Seconds of a log that are looked at, half of them from its beginning and half from its end."""

PASSES = 4
"""Rounds of weighting each joint by its residual; two are enough but for joints that the first round misjudges."""

SETTLED = 1e-3
"""Relative change of all residuals in a round from which the next one would change nothing that is asked."""

FLOOR = 1e-9
"""Residual over torque below which a joint's weight grows no further: logs without noise have none."""

RIDGE = 1e-9
"""Added to products of unit columns, so that parameters that do not show have a value: their squares are 1e-4
where they show at all."""

COARSE_FLOOR = 1e-6
"""The same as `FLOOR` where only products are known, whose rounding is the root of ε."""

MEMORY_SECONDS = 1.0
"""Lags up to here count when correlated residuals are told from white ones [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class Thin:
    """A recording at a moderate rate.

    Attributes:
        runs: Contiguous runs, motion filtered, torque not.
        band: For torque and columns.
        cutoff: Its cut-off [Hz]; that of the motion where the band is open.
        rate: Samples a second of the recording itself [Hz].
    """

    runs: tuple[ObservedRun, ...]
    band: Band
    cutoff: float
    rate: float

    def reordered(self, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> Thin:
        """The same log with its channels in another order; rows count where both channels of a joint do."""

        def changed(run: ObservedRun) -> ObservedRun:
            m, mask = run.motion, run.mask[:, motion] & run.mask[:, torque]
            moved = Motion(m.time, m.q[:, motion], m.dq[:, motion], m.ddq[:, motion])
            return replace(run, motion=moved, torque=run.torque[:, torque], mask=mask)

        return replace(self, runs=tuple(changed(run) for run in self.runs))

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Which rows count, shape (M, n)."""
        return np.concatenate([run.mask for run in self.runs])

    def coarse(self) -> Thin:
        """The rows alone, their torque filtered and their columns not: quick, to compare geometries."""

        def changed(run: ObservedRun) -> ObservedRun:
            raw = self.band.is_open or not run.consecutive
            tau = run.torque if raw else in_band(run.torque, run.rate, self.band)
            rows, m = run.rows, run.motion
            few = Motion(m.time[rows], m.q[rows], m.dq[rows], m.ddq[rows])
            return replace(run, motion=few, torque=tau[rows], rate=run.rate / run.step, step=1, offset=0)

        return replace(self, runs=tuple(changed(run) for run in self.runs), band=Band())

    def moved(self, offset: Array) -> Thin:
        """The same log with positions offset (n,) [rad or m]."""

        def changed(run: ObservedRun) -> ObservedRun:
            m = run.motion
            return replace(run, motion=Motion(m.time, m.q + offset, m.dq, m.ddq))

        return replace(self, runs=tuple(changed(run) for run in self.runs))

    def scaled(self, motion: Array) -> Thin:
        """The same log with the motion of each joint multiplied (n,)."""

        def changed(run: ObservedRun) -> ObservedRun:
            m = run.motion
            return replace(run, motion=Motion(m.time, m.q * motion, m.dq * motion, m.ddq * motion))

        return replace(self, runs=tuple(changed(run) for run in self.runs))


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """Columns and torque in the band, M rows.

    Attributes:
        columns: For each joint the columns of its own parameters, (k, M).
        parameters: For each joint which parameters these are, (k,).
        count: Number of parameters b.
        motion: Motion at the rows.
        torque: Shape (M, n) [N·m or N].
        slope: Its derivative, shape (M, n) [N·m/s].
        mask: Which rows count, shape (M, n).
        run: Contiguous run of each row, shape (M,).
        rate: Rows a second [Hz].
    """

    columns: tuple[Array, ...]
    parameters: tuple[NDArray[np.int32], ...]
    count: int
    motion: Motion
    torque: Array
    slope: Array
    mask: NDArray[np.bool_]
    run: NDArray[np.int64]
    rate: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.columns)


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """Weighted least squares on rows.

    Attributes:
        values: Parameters, those of the extra columns last, shape (b + e,).
        covariance: Shape (b + e, b + e); correlated residuals count as fewer.
        sigma: Residual of each joint, shape (n,) [N·m or N].
        residual: Shape (M, n), zero where a row does not count.
        memory: How many rows stand for one that is independent, shape (n,).
    """

    values: Array
    covariance: Array
    sigma: Array
    residual: Array
    memory: Array

    @property
    def cost(self) -> float:
        """Mean over the joints of the logarithm of their residuals: a fall by 0.1 is ten percent less in all."""
        return float(np.mean(np.log(self.sigma)))

    @property
    def deviation(self) -> Array:
        """Standard deviations (b + e,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def thin(recording: Recording) -> Thin:
    """Reduce a recording in the robot's terms to a moderate rate.

    Raises:
        RecordingError: It cannot be differentiated or is too short.
    """
    if recording.consecutive is False:
        few = slice(None, None, max(1, recording.samples // SEPARATE))
        values = {name: getattr(recording, name) for name in ("q", "dq", "ddq", "effort", "valid")}
        kept = {name: None if x is None else x[few] for name, x in values.items()}
        whole = replace(recording, time=None, rate=1.0, **kept)
        piece = stretches(whole, None)[0][0]
        processing = Processing(family="none", derivatives="given")
        run = separate_rows(piece, movement(piece, processing, given=True), processing)
        return Thin((run,), Band(), 1.0, 1.0)
    pieces, _ = stretches(recording, CUTOFFS[0])
    noise = np.max([position_noise(piece.q, piece.time) for piece in pieces], axis=0)
    longest = max(pieces, key=lambda piece: piece.samples)
    rate = longest.rate
    even = [evened(piece, None, 0.0, each=False) for piece in pieces]
    cutoff = min(max(automatic_cutoff(evened(longest, None, 0.0, each=False).q, rate), CUTOFFS[0]), CUTOFFS[1])
    cutoff = min(cutoff, 0.1 * rate)
    processing = Processing(cutoff=cutoff, decimate=ROWS_RATE * cutoff, derivatives="central", trim=0.25)
    runs: list[ObservedRun] = []
    still: list[NDArray[np.bool_]] = []
    for piece in _ends(even):
        step = max(1, int(piece.rate / (THIN_RATE * cutoff)))
        few = _decimated(piece, step)
        if few.samples < 10 * int(few.rate / cutoff):
            continue
        run = run_of(few, movement(few, processing, given=False), processing)
        if run is not None:
            runs.append(run)
            still.append(_any_near(standing(piece.q, piece.rate, noise), step))
    runs, _ = moving(runs, still, processing)
    return Thin(tuple(runs), processing.band, cutoff, rate)


def _ends(pieces: Sequence[Stretch]) -> list[Stretch]:
    """What lies in the first and the last half minute of a long log."""
    begin, end = float(pieces[0].time[0]), float(pieces[-1].time[-1])
    if end - begin <= 1.25 * LONGEST:
        return list(pieces)
    result: list[Stretch] = []
    for low, high in ((begin, begin + LONGEST / 2), (end - LONGEST / 2, end)):
        for piece in pieces:
            first, stop = np.searchsorted(piece.time, (low, high))
            if stop - first > 1:
                result.append(piece.cut(int(first), int(stop)))
    return result


def _decimated(piece: Stretch, step: int) -> Stretch:
    if step == 1:
        return piece
    taps = decimation_filter(step, attenuation=60.0)
    rows = piece.time[::step]
    return piece.changed(lambda x: decimate(x, taps, step), rows, piece.rate / step, lambda bad: _any_near(bad, step))


def _any_near(flags: NDArray[np.bool_], step: int) -> NDArray[np.bool_]:
    """Flags of every so many samples: whether any less than a step away is flagged."""
    if step == 1:
        return flags
    rows = np.arange(0, len(flags), step)
    counts = np.concatenate([np.zeros((1, flags.shape[1]), dtype=np.int64), flags.cumsum(axis=0)])
    low, high = np.maximum(rows - step, 0), np.minimum(rows + step, len(flags))
    return counts[high] > counts[low]


def make_rows(source: ColumnSource, log: Thin) -> Rows:
    """Columns and torque of a thin log in its band."""
    parts = [all_rows(source, run, log.band) for run in log.runs]
    x = np.concatenate(parts, axis=1)
    offset, n = source.layout.offset, source.tree.n
    torque = np.column_stack([x[offset[j + 1] - 1] for j in range(n)])
    slope = np.concatenate([_slope(run, log.band) for run in log.runs])
    pick = [(run, run.rows) for run in log.runs]
    motion = Motion(
        np.concatenate([run.motion.time[rows] for run, rows in pick]),
        np.concatenate([run.motion.q[rows] for run, rows in pick]),
        np.concatenate([run.motion.dq[rows] for run, rows in pick]),
        np.concatenate([run.motion.ddq[rows] for run, rows in pick]),
    )
    return Rows(
        tuple(x[offset[j] : offset[j + 1] - 1] for j in range(n)),
        source.layout.parameters,
        len(source.names),
        motion,
        torque,
        slope,
        log.mask,
        np.concatenate([np.full(len(run.rows), k) for k, run in enumerate(log.runs)]),
        log.runs[0].rate / log.runs[0].step,
    )


def _slope(run: ObservedRun, band: Band) -> Array:
    """Derivative of the torque in the band at the rows."""
    if band.is_open or not run.consecutive:
        return np.zeros((len(run.rows), run.motion.n))
    return np.gradient(in_band(run.torque, run.rate, band), 1.0 / run.rate, axis=0)[run.rows]


def solve(rows: Rows, extra: Array | None = None) -> Fit:
    """Weighted least squares, each joint by its own residual.

    Args:
        rows: Columns and torque.
        extra: More columns, shape (e, M, n): what a unit of each adds to the torque of each joint.
    """
    more = 0 if extra is None else len(extra)
    total = rows.count + more
    blocks: list[Array] = []
    sides: list[Array] = []
    joints: list[NDArray[np.intp]] = []
    tables: list[Array] = []
    counted = np.maximum(rows.mask.sum(axis=0), 1)
    for j in range(rows.n):
        A = rows.columns[j] if extra is None else np.concatenate([rows.columns[j], extra[:, :, j]])
        table = np.concatenate([A, rows.torque[:, j][None]]) * rows.mask[:, j]
        tables.append(table)
        R: Array = np.asarray(np.linalg.qr(table.T, mode="r"))
        wide = np.zeros((len(R), total))
        wide[:, np.concatenate([rows.parameters[j], np.arange(rows.count, total)])] = R[:, :-1]
        blocks.append(wide)
        sides.append(R[:, -1])
        joints.append(np.full(len(R), j))
    A, y, joint = np.concatenate(blocks), np.concatenate(sides), np.concatenate(joints)
    size = np.array([np.linalg.norm(side) for side in sides]) / np.sqrt(counted)
    size = np.where(size > 0.0, size, 1.0)
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    sigma = size
    x = np.zeros(total)
    for _ in range(PASSES):
        weight = 1.0 / sigma[joint]
        x = np.linalg.lstsq(A / scale * weight[:, None], y * weight, rcond=1e-9)[0] / scale
        remaining = np.bincount(joint, (y - A @ x) ** 2, minlength=rows.n)
        before, sigma = sigma, np.maximum(np.sqrt(remaining / counted), FLOOR * size)
        if rows.n == 1 or (np.abs(sigma - before) < SETTLED * sigma).all():
            break
    residual = np.column_stack([_left(tables[j], rows.parameters[j], x, rows.count) for j in range(rows.n)])
    memory = np.array([_memory(residual[:, j], rows.rate) for j in range(rows.n)])
    weight = 1.0 / (sigma * np.sqrt(memory))[joint]
    inverse = np.linalg.pinv(A / scale * weight[:, None], rcond=1e-9)
    return Fit(x, (inverse @ inverse.T) / np.outer(scale, scale), sigma, residual, memory)


def products(rows: Rows, extra: Array | None = None) -> tuple[Array, ...]:
    """For each joint products of its columns, extra ones (e, M, n) and torque, square of k + e + 1 rows."""
    more = np.zeros((0, *rows.torque.shape)) if extra is None else extra
    tables = (
        np.vstack([own, more[:, :, j], rows.torque[:, j]]) * rows.mask[:, j] for j, own in enumerate(rows.columns)
    )
    return tuple(table @ table.T for table in tables)


def cost_of(rows: Rows, pairs: Sequence[Array], sign: Array | None = None) -> float:
    """What `solve(rows).cost` is, from products alone, in a tenth of the time.

    Args:
        rows: The rows, of which only the parameters are looked at.
        pairs: Their `products`.
        sign: Factor of each joint's torque, shape (n,).
    """
    n, b = rows.n, rows.count
    sign = np.ones(n) if sign is None else sign
    counted = np.maximum(rows.mask.sum(axis=0), 1)
    size = np.sqrt(np.array([P[-1, -1] for P in pairs]) / counted)
    size = np.where(size > 0.0, size, 1.0)
    sigma = size
    for _ in range(PASSES):
        G, side = np.zeros((b, b)), np.zeros(b)
        for j, P in enumerate(pairs):
            own = rows.parameters[j]
            G[np.ix_(own, own)] += P[:-1, :-1] / sigma[j] ** 2
            side[own] += sign[j] * P[:-1, -1] / sigma[j] ** 2
        scale = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
        G = G / np.outer(scale, scale)
        x = np.linalg.solve(G + RIDGE * np.eye(b), side / scale) / scale
        left = np.array([_remaining(P, np.append(-x[rows.parameters[j]], sign[j])) for j, P in enumerate(pairs)])
        before, sigma = sigma, np.maximum(np.sqrt(np.maximum(left, 0.0) / counted), COARSE_FLOOR * size)
        if (np.abs(sigma - before) < SETTLED * sigma).all():
            break
    return float(np.mean(np.log(sigma)))


def _remaining(P: Array, x: Array) -> float:
    return float(x @ P @ x)


def _left(table: Array, own: NDArray[np.int32], x: Array, count: int) -> Array:
    """Torque less prediction of one joint."""
    return table[-1] - np.concatenate([x[own], x[count:]]) @ table[:-1]


def _memory(residual: Array, rate: float) -> float:
    """How many rows stand for one that is independent: 1 + 2 Σ correlations, by Bartlett's window."""
    lags = min(int(MEMORY_SECONDS * rate), len(residual) // 4)
    power = float(residual @ residual)
    if lags < 1 or power <= 0.0:
        return 1.0
    taper = 1.0 - np.arange(1, lags + 1) / (lags + 1)
    correlation = np.array([float(residual[k:] @ residual[:-k]) for k in range(1, lags + 1)]) / power
    return max(1.0, 1.0 + 2.0 * float(taper @ correlation))

"""Reduction of a recording to a moderate sample rate, at which the doctor fits models quickly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.information.filtering import in_band
from armid.maths.signals.decimation import decimate, decimation_filter
from armid.maths.signals.motion_cutoff import automatic_cutoff
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.differentiation import differentiate
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.row_mask import moving, run_of, separate_rows
from armid.measurement.processing.standstill import standing
from armid.measurement.processing.uniform_runs import Segment, cut_at_gaps, resample_uniform
from armid.measurement.recording import Recording
from armid.model.motion import Motion

CUTOFFS = (2.0, 6.0)
"""Smallest and largest cut-off of the band [Hz]; faults of a log show at the frequencies of the motion, not above."""

THIN_RATE = 20.0
"""Sample rate divided by the cut-off. Friction at reversals has frequencies above the band; at a lower rate they
would cause aliasing."""

ROWS_RATE = 4.0
"""Row rate divided by the cut-off: twice the Nyquist rate of the band."""

SEPARATE = 1000
"""Number of rows that are used (up to twice as many) if rows are not consecutive. A filtered log of half a minute
has about the same number of rows. Unmodelled effects correlate the residuals of neighbouring rows; without the order
of the rows, this correlation cannot be estimated."""

COARSE = 400
"""Number of rows (up to twice as many) for quick comparisons of geometries: several times the parameters of a
joint."""

LONGEST = 60.0
"""Length of the part of a log that is examined [s]: one half is its beginning, the other half its end."""


@dataclass(frozen=True, eq=False, slots=True)
class DownsampledLog:
    """Recording at a moderate sample rate.

    Attributes:
        runs: Segments of the log without a gap, with filtered motion and unfiltered torque.
        band: Low-pass that is applied later to torque and regressor columns.
        cutoff: Cut-off of the band [Hz]; 1 if the rows are not consecutive, so that nothing is filtered.
        rate: Sample rate of the original recording [Hz].
        noise: Standard deviation of the noise of each position in the original recording, shape (n,) [rad or m]; zero
            if the rows are not consecutive.
    """

    runs: tuple[ObservedRun, ...]
    band: Band
    cutoff: float
    rate: float
    noise: Array

    def reordered(self, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> DownsampledLog:
        """The same log with the channels in another order.

        A row is used for a joint if it is used for its position channel and for its torque channel.

        Args:
            motion: Channel of the motion of each joint, shape (n,).
            torque: Channel of the torque of each joint, shape (n,).
        """

        def changed(run: ObservedRun) -> ObservedRun:
            m, mask = run.motion, run.mask[:, motion] & run.mask[:, torque]
            signs = None if m.sign_deviation is None else m.sign_deviation[:, motion]
            moved = Motion(m.time, m.q[:, motion], m.dq[:, motion], m.ddq[:, motion], sign_deviation=signs)
            return replace(run, motion=moved, torque=run.torque[:, torque], mask=mask)

        return replace(self, runs=tuple(changed(run) for run in self.runs), noise=self.noise[motion])

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Mask of the rows that are used for each joint, shape (M, n)."""
        return np.concatenate([run.mask for run in self.runs])

    def coarse(self) -> DownsampledLog:
        """A copy with fewer rows and an unfiltered motion, with which orders of channels are compared quickly."""
        every = max(1, sum(len(run.rows) for run in self.runs) // COARSE)

        def changed(run: ObservedRun) -> ObservedRun:
            raw = self.band.is_open or not run.consecutive
            tau = run.torque if raw else in_band(run.torque, run.rate, self.band)
            rows, m = run.rows[::every], run.motion
            signs = None if m.sign_deviation is None else m.sign_deviation[rows]
            few = Motion(m.time[rows], m.q[rows], m.dq[rows], m.ddq[rows], sign_deviation=signs)
            rate, mask, block = run.rate / (run.step * every), run.mask[::every], run.block[::every]
            return replace(run, motion=few, torque=tau[rows], rate=rate, step=1, offset=0, mask=mask, block=block)

        return replace(self, runs=tuple(changed(run) for run in self.runs), band=Band())

    def moved(self, offset: Array) -> DownsampledLog:
        """The same log with an offset (n,) added to the positions [rad or m]."""

        def changed(run: ObservedRun) -> ObservedRun:
            m = run.motion
            return replace(run, motion=replace(m, q=m.q + offset))

        return replace(self, runs=tuple(changed(run) for run in self.runs))

    def scaled(self, motion: Array) -> DownsampledLog:
        """The same log with the motion of each joint multiplied by a factor (n,)."""

        def changed(run: ObservedRun) -> ObservedRun:
            m = run.motion
            signs = None if m.sign_deviation is None else m.sign_deviation * np.sign(motion)
            scaled = Motion(m.time, m.q * motion, m.dq * motion, m.ddq * motion, sign_deviation=signs)
            return replace(run, motion=scaled)

        return replace(self, runs=tuple(changed(run) for run in self.runs), noise=self.noise * np.abs(motion))


def downsample(recording: Recording, cutoff: float | None = None) -> DownsampledLog:
    """Reduces a recording to a moderate sample rate, and a long one to its first and last half minute.

    Args:
        recording: Recording in robot order, SI units, joint side.
        cutoff: Cut-off of the band [Hz]. It is lowered if the sample rate is too low. If it is not given, it is
            computed from the spectrum of the motion.

    Raises:
        RecordingError: The recording cannot be differentiated or is too short.
    """
    if recording.consecutive is False:
        few = slice(None, None, max(1, recording.samples // SEPARATE))
        values = {name: getattr(recording, name) for name in ("q", "dq", "ddq", "effort", "command", "valid")}
        thinned = {name: None if x is None else x[few] for name, x in values.items()}
        whole = replace(recording, time=None, rate=1.0, number=None, **thinned)
        segment = cut_at_gaps(whole, None)[0][0]
        processing = ProcessingOptions(family="none", derivatives="given")
        run = separate_rows(segment, differentiate(segment, processing, given=True), processing)
        return DownsampledLog((run,), Band(), 1.0, 1.0, np.zeros(recording.q.shape[1]))
    segments, _ = cut_at_gaps(recording, CUTOFFS[0])
    noise = np.max([position_noise(segment.q, segment.time) for segment in segments], axis=0)
    longest = max(range(len(segments)), key=lambda k: segments[k].samples)
    rate = segments[longest].rate
    even = [resample_uniform(segment, None, 0.0, each=False) for segment in segments]
    if cutoff is None:
        cutoff = min(max(automatic_cutoff(even[longest].q, rate), CUTOFFS[0]), CUTOFFS[1])
    cutoff = min(cutoff, 0.1 * rate)
    processing = ProcessingOptions(cutoff=cutoff, decimate=ROWS_RATE * cutoff, derivatives="central", trim=0.25)
    runs: list[ObservedRun] = []
    still: list[NDArray[np.bool_]] = []
    for segment in _ends(even):
        step = max(1, int(segment.rate / (THIN_RATE * cutoff)))
        if -(-segment.samples // step) < 10 * int(segment.rate / step / cutoff):
            continue
        few = _decimated(segment, step)
        run = run_of(few, differentiate(few, processing, given=False), processing)
        if run is not None:
            runs.append(run)
            still.append(_any_near(standing(segment.q, segment.rate, noise), step))
    runs, _ = moving(runs, still, processing)
    return DownsampledLog(tuple(runs), processing.band, cutoff, rate, noise)


def _ends(segments: Sequence[Segment]) -> list[Segment]:
    """Segments in the first and the last half minute of a log; all segments if the log is not longer."""
    begin, end = float(segments[0].time[0]), float(segments[-1].time[-1])
    if end - begin <= 1.25 * LONGEST:
        return list(segments)
    result: list[Segment] = []
    for low, high in ((begin, begin + LONGEST / 2), (end - LONGEST / 2, end)):
        for segment in segments:
            first, stop = np.searchsorted(segment.time, (low, high))
            if stop - first > 1:
                result.append(segment.cut(int(first), int(stop)))
    return result


def _decimated(segment: Segment, step: int) -> Segment:
    if step == 1:
        return segment
    taps = decimation_filter(step, attenuation=60.0)
    rows = segment.time[::step]
    return segment.changed(
        lambda x: decimate(x, taps, step), rows, segment.rate / step, lambda bad: _any_near(bad, step)
    )


def _any_near(flags: NDArray[np.bool_], step: int) -> NDArray[np.bool_]:
    """Flags of every `step`-th sample; true if any sample closer than `step` is flagged."""
    if step == 1:
        return flags
    rows = np.arange(0, len(flags), step)
    counts = np.concatenate([np.zeros((1, flags.shape[1]), dtype=np.int64), flags.cumsum(axis=0)])
    low, high = np.maximum(rows - step, 0), np.minimum(rows + step, len(flags))
    return counts[high] > counts[low]

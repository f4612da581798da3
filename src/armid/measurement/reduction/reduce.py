"""Reduction of a recording to a lower rate: spikes, whole turns, low-pass filter and decimation, piece by piece.

All channels, the clock included, pass the same linear-phase filter, so their times agree afterwards and the low-pass
of the estimation finds the same motion and torque as before. What a filter would smear is treated before it: isolated
samples and jumps of an angle by whole turns. Only one piece of the samples is in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, all_finite, frozen
from armid.errors import Finding, RecordingError
from armid.input_boundary import within
from armid.kernel.channels.passes import decimate
from armid.maths.median import median
from armid.maths.signals.decimation import DECIMATION_PASS_BAND, decimation_filter
from armid.maths.signals.unwrapping import whole_turn_jumps, without_turns
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.channels.isolated_samples import isolated_samples
from armid.measurement.processing.clock_checks import SHORTEST_STEP
from armid.measurement.processing.spikes import Channels, interpolate_spikes
from armid.measurement.processing.uniform_runs import GAP_STEPS
from armid.measurement.recording import Recording
from armid.measurement.reduction.reduced_rate import reduction_step
from armid.remedy import Remedy, setting

PIECE = 50_000
"""Number of samples that are reduced at a time: 6 MB of positions and torques of a seven-joint arm."""

CONTEXT = 64
"""Number of samples on each side of a piece that are searched for spikes with it, but reduced with its neighbour."""

CHANNELS = ("q", "dq", "ddq", "effort", "command")
"""Quantities of a recording with one channel for each joint."""

FASTEST_RATE = 1.0 / SHORTEST_STEP
"""Fastest plausible sample rate [Hz]; the clock of a faster recording counts another unit, and is refused later."""

WRAP_TOLERANCE = 0.08
"""Largest difference between a jump and a whole turn at which the jump counts as a wrap of the angle [turns]."""

FEW_GAPS, SINGLE_GAPS = 1e-3, 3
"""Largest share of the steps of a clock that may be gaps, and number of gaps that are always allowed. With more of
them, as in bursts of messages or where packets are lost, so much would be dropped beside them that the samples are
interpolated first, at the full rate."""


class UnsuitableRecordingError(Exception):
    """Recording whose samples must be treated before they are filtered, so that its rate is not reduced.

    Values are missing, rows repeat the row before, or the clock has many gaps.
    """


def reduce_recording(recording: Recording, log_format: LogFormat) -> Recording:
    """Reduces a recording to the highest rate of its log format; other recordings are returned as they are.

    Args:
        recording: Recording as logged, from a reader.
        log_format: Log format of the file.
    """
    if _step(recording, recording.samples, log_format) == 1:
        return recording
    pieces = (_cut(recording, a, a + PIECE) for a in range(0, recording.samples, PIECE))
    try:
        return reduce_pieces(pieces, recording.samples, log_format)
    except UnsuitableRecordingError:
        return recording


def reduce_pieces(pieces: Iterable[Recording], samples: int, log_format: LogFormat) -> Recording:
    """Reduces a recording that is read piece by piece; if its rate is not reduced, the pieces are joined.

    Args:
        pieces: Successive parts of the recording as logged.
        samples: Number of samples of all pieces together, or an estimate of it.
        log_format: Log format of the file.

    Raises:
        UnsuitableRecordingError: A piece must not be filtered.
        RecordingError: The recording is not reduced and has more samples than may be in memory, or has no samples.
    """
    source = iter(pieces)
    first = next(source, None)
    if first is None or not first.samples:
        raise RecordingError("the recording has no rows.", remedy="record again, because no data were written.")
    step = _step(first, samples, log_format)
    later: list[Finding] = []
    every = _chain(first, source, later)
    if step == 1 or first.time is None:
        within("samples", samples, first.source or "The recording", RecordingError)
        whole = joined(list(every))
        return replace(whole, findings=(*whole.findings, *later)) if later else whole
    rate = _rate(first)
    state = _Reduction(step, log_format, float(first.time[0]))
    made = [part for piece in every if (part := state.following(piece)) is not None]
    made += [part] if (part := state.following(None)) is not None else []
    if not made:
        raise UnsuitableRecordingError
    whole = joined(made)
    found = merged_findings([*later, *state.findings])
    findings = (*first.findings, *found, _finding(state.samples, whole.samples, rate, step))
    return replace(whole, findings=findings, logged_rate=rate)


def joined(parts: list[Recording]) -> Recording:
    """Recording that consists of successive parts."""
    if len(parts) == 1:
        return parts[0]
    stacked: dict[str, Any] = {}
    for name in ("time", *CHANNELS, "valid"):
        values = [getattr(part, name) for part in parts]
        if values[0] is not None:
            stacked[name] = frozen(np.concatenate(values))
    return replace(parts[0], **stacked)


def merged_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Findings of successive parts of a recording; those with the same code and channel become one finding."""
    found: dict[tuple[str, str], list[Finding]] = {}
    for each in findings:
        found.setdefault((each.code, each.channel), []).append(each)
    result: list[Finding] = []
    for same in found.values():
        worst = next((each for each in same if each.severity == "error"), same[0])
        more = f" There are more such samples in {len(same) - 1} other stretches of the log." if len(same) > 1 else ""
        result.append(replace(worst, evidence=worst.evidence + more))
    return result


class _Reduction:
    """Reduction of successive pieces, with the samples at the end of a piece that belong to the next one, too.

    Attributes:
        findings: Findings on the samples so far.
    """

    def __init__(self, step: int, log_format: LogFormat, origin: float) -> None:
        self.findings: list[Finding] = []
        self._step, self._format, self._origin = step, log_format, origin
        self._taps = decimation_filter(step)
        self._tail: Recording | None = None
        self._begin = 0  # index of the first sample of the tail in the recording
        self._next = 0  # number of the next reduced sample
        self._turned: dict[str, Array] = {}  # angles at the beginning of the tail, after whole turns were subtracted

    @property
    def samples(self) -> int:
        """Number of samples so far."""
        return self._begin + (0 if self._tail is None else self._tail.samples)

    def following(self, piece: Recording | None) -> Recording | None:
        """Reduced samples that a further piece completes, or the last ones if there is none; `None` without any."""
        last = piece is None
        whole = joined([each for each in (self._tail, piece) if each is not None])
        refuse_unsuitable(whole)
        half, step = len(self._taps) // 2, self._step
        low = self._begin + half + (CONTEXT if self._begin else 0)
        high = self._begin + whole.samples - half - (0 if last else CONTEXT)  # centres are below this
        first = max(self._next, -(-low // step))
        rows = max(0, -(-(high - first * step) // step))
        keep = max(0, (first + rows) * step - half - CONTEXT - self._begin)  # samples that are not needed further
        treated = self._treated(whole, keep, whole.samples if last else keep)
        self._tail, self._next = _cut(whole, keep, whole.samples), first + rows
        centre, self._begin = first * step - self._begin, self._begin + keep
        return self._filtered(treated, centre, rows) if rows else None

    def _treated(self, whole: Recording, keep: int, counted: int) -> Recording:
        """Samples without spikes and without jumps by whole turns.

        The next tail begins with sample `keep`. Findings are about the first `counted` samples; no tail repeats them.
        """
        assert whole.time is not None
        channels = _channels(whole, self._format)
        seconds = float(median(np.diff(whole.time))) if whole.samples > 1 else 0.0
        found = {
            name: isolated_samples(values, seconds)
            for name in ("q", "dq", "effort", "command")
            if (values := getattr(whole, name)) is not None
        }
        kept = self._format.spikes == "keep"
        new = any(flags[:counted].any() for flags in found.values())
        treated, spikes = interpolate_spikes(whole, found, whole.time, channels, kept=kept)
        where = f"From t = {whole.time[0]:.6g} to {whole.time[-1]:.6g} s: "
        self.findings += [replace(each, evidence=where + each.evidence) for each in spikes if new]
        changed: dict[str, Any] = {}
        for name in ("q", "command"):
            values = getattr(treated, name)
            if values is not None:
                labels = treated.channels if name == "q" else ()
                changed[name] = self._continuous(name, values, channels.turn, (keep, counted), labels)
        return replace(treated, **changed)

    def _continuous(
        self, name: str, values: Array, turn: Array, bounds: tuple[int, int], labels: tuple[str, ...]
    ) -> Array:
        """Angles (N, n) that continue those of the pieces before without jumps by whole turns.

        `bounds` are the first sample of the next tail, and the number of samples with whose jumps findings deal.
        """
        keep, counted = bounds
        before = self._turned.get(name)
        result = values.copy()
        for j in range(values.shape[1]):
            jump, whole = whole_turn_jumps(values[:, j], turn[j], WRAP_TOLERANCE * turn[j])
            if jump.any():
                result[:, j] = without_turns(values[:, j], jump, whole, turn[j])
                if labels and jump[:counted].any():
                    self.findings.append(_wrapped(labels[j], int(jump[:counted].sum())))
            if before is not None:
                result[:, j] += turn[j] * np.round((before[j] - result[0, j]) / turn[j])
        self._turned[name] = result[min(keep, len(result) - 1)]
        return frozen(result)

    def _filtered(self, treated: Recording, centre: int, rows: int) -> Recording | None:
        """Filtered and decimated samples, without those whose filter reaches a gap of the clock."""
        assert treated.time is not None
        half, step = len(self._taps) // 2, self._step
        centres = centre + step * np.arange(rows)
        relative = (treated.time - self._origin)[:, None]
        changed: dict[str, Any] = {
            "time": self._origin + decimate(relative, self._taps, step, centre - half, rows)[:, 0]
        }
        wide = _gaps(treated.time)
        inside = ~_any_within(wide[:, None], centres, half, half)[:, 0]
        for name in CHANNELS:
            values = getattr(treated, name)
            if values is not None:
                changed[name] = decimate(values, self._taps, step, centre - half, rows)
        changed["valid"] = ~_any_within(~treated.valid, centres, step, step)
        if not inside.any():
            return None
        chosen = {name: frozen(np.ascontiguousarray(x[inside])) for name, x in changed.items()}
        return replace(treated, findings=(), **chosen)


def refuse_unsuitable(recording: Recording) -> None:
    """Raises an error if the rows of a recording must be treated before they can be filtered.

    Raises:
        UnsuitableRecordingError: A value is not finite, a row repeats the row before, or the clock has many gaps.
    """
    values = [each for name in CHANNELS if (each := getattr(recording, name)) is not None]
    if recording.time is None or not all(all_finite(each) for each in (recording.time, *values)):
        raise UnsuitableRecordingError
    if _gaps(recording.time).sum() > max(SINGLE_GAPS, FEW_GAPS * recording.samples):
        raise UnsuitableRecordingError
    repeated = np.ones(recording.samples - 1, dtype=np.bool_)
    for each in values:
        for j in range(each.shape[1]):
            repeated &= each[1:, j] == each[:-1, j]
            if not repeated.any():
                return
    if len(repeated):
        raise UnsuitableRecordingError


def _gaps(time: Array) -> NDArray[np.bool_]:
    """Mask of the steps of a clock that are gaps, shape (N - 1,)."""
    steps = np.diff(time)
    return steps > GAP_STEPS * median(steps) if len(steps) else np.zeros(0, dtype=np.bool_)


def _any_within(flags: NDArray[np.bool_], centres: NDArray[np.int64], before: int, behind: int) -> NDArray[np.bool_]:
    """Checks whether any of the flags (N, c) from `before` samples before a centre to `behind` after it is true."""
    if not flags.any():
        return np.zeros((len(centres), flags.shape[1]), dtype=np.bool_)
    counts = np.concatenate([np.zeros((1, flags.shape[1]), dtype=np.int64), flags.cumsum(axis=0)])
    low = np.clip(centres - before, 0, len(flags))
    high = np.clip(centres + behind, low, len(flags))
    return counts[high] > counts[low]


def _step(first: Recording, samples: int, log_format: LogFormat) -> int:
    """Number of samples that become one; 1 if clock or rows do not allow a reduction, or if there was one already."""
    units = first.guessed.get("units", log_format.units)
    mixed = not (units is None or isinstance(units, str)) and len(set(units)) > 1
    consecutive = first.consecutive if log_format.consecutive is None else log_format.consecutive
    # Excluded intervals may hold anything, and belong to single samples.
    kept = first.logged_rate is not None or first.number is not None or bool(log_format.exclude)
    rate = _rate(first)
    if mixed or kept or consecutive is False or not rate <= FASTEST_RATE:
        return 1
    return reduction_step(samples, rate, log_format.highest_rate)


def _rate(first: Recording) -> float:
    """Sample rate of a log [Hz]; not finite without a clock, or if the clock does not increase or has many gaps."""
    steps = np.zeros(0) if first.time is None else np.diff(first.time)
    if first.time is None or not len(steps) or not (steps >= 0.0).all() or median(steps) <= 0.0:
        return np.nan
    gaps = _gaps(first.time)
    many = gaps.sum() > max(SINGLE_GAPS, FEW_GAPS * len(gaps))
    return np.nan if many else float(1.0 / np.mean(steps[~gaps]))


def _channels(recording: Recording, log_format: LogFormat) -> Channels:
    """Units and full turns of the channels as logged; their speed limits are not known before they have joints."""
    units = recording.guessed.get("units", log_format.units)
    degrees = np.full(recording.n, units is not None and "deg" in units)  # all channels have one unit
    turn = np.where(degrees, 360.0, 2.0 * np.pi)
    names = tuple("deg" if each else "rad" for each in degrees)
    current = recording.effort_is_current or log_format.drive_gain is not None
    efforts = ("A" if current else "N·m",) * recording.n
    unknown = np.full(recording.n, np.inf)
    return Channels(unknown, unknown, turn, names, efforts)


def _wrapped(channel: str, jumps: int) -> Finding:
    evidence = f"The angle jumps by whole turns {jumps} times; it was made continuous."
    return Finding("position-wrapped", "info", channel, evidence)


def _finding(samples: int, reduced: int, rate: float, step: int) -> Finding:
    """Finding about a reduction."""
    kept = DECIMATION_PASS_BAND * rate / step / 2.0
    return Finding(
        "rate-reduced",
        "info",
        "",
        f"{samples} samples at {rate:.5g} Hz were reduced to {reduced} samples at {rate / step:.5g} Hz by a filter "
        f"that keeps frequencies up to {kept:.3g} Hz.",
        Remedy(
            "nothing has to be done; ", setting("highest_rate", 0), " keeps all samples, with more time and memory"
        ),
    )


def _cut(recording: Recording, first: int, stop: int) -> Recording:
    """Samples `first` to `stop - 1` of a recording; the arrays are not copied."""
    part = slice(first, stop)
    names = ("time", *CHANNELS, "valid")
    return replace(recording, **{name: x[part] for name in names if (x := getattr(recording, name)) is not None})


def _chain(first: Recording, rest: Iterator[Recording], later: list[Finding]) -> Iterator[Recording]:
    """Yields all pieces, and appends the findings of further pieces, which the first does not have, to `later`."""
    yield first
    for piece in rest:
        later += [each for each in piece.findings if each not in first.findings]
        yield piece

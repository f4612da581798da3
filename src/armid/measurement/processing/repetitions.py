"""Repetitions of a motion: their positions in a recording, their delays and their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.signals.delay import periodic_delay, periodic_shift
from armid.measurement.processing.uniform_runs import Segment
from armid.remedy import Remedy, setting

SHORT = 1.0
"""Number of samples by which the last repetition may be too short. A log of K periods of m samples often ends with
sample K m - 1."""

PASSES = 4
"""Number of iterations in the alignment of a repetition with the reference. If the delay of a repetition is large,
its samples contain a part of the next repetition; each iteration reduces the error that this causes."""

NEGLIGIBLE = 0.1
"""Displacement of the joints during a delay of a fraction of a sample, divided by the noise of the positions, up to
which the delay is not corrected."""

LATE = 0.05
"""Ratio of a delay to the period above which the period or its start must be wrong."""

JUMP = 2.0
"""Largest allowed step of a position from the end of a run to its beginning, divided by the largest step inside the
run."""


def windows(segment: Segment, period: float, start: float) -> list[int]:
    """Indices of the first samples of all whole repetitions in a segment.

    Args:
        segment: Segment at a uniform rate, with a whole number of samples per period.
        period: Period of the motion [s].
        start: Start of the first repetition on the recording's clock [s].
    """
    samples = round(period * segment.rate)
    room = segment.samples - samples
    if room < 0 or samples < 1:
        return []
    first = int(np.ceil((float(segment.time[0]) - start) / period - SHORT / samples))
    result: list[int] = []
    for k in range(max(first, 0), max(first, 0) + segment.samples // max(samples - 1, 1) + 2):
        begin = round((start + k * period - float(segment.time[0])) * segment.rate)
        if -SHORT <= begin <= room + SHORT:
            result.append(min(max(begin, 0), room))
    return result


def whole_periods(segment: Segment, begins: Sequence[int], samples: int) -> Segment:
    """Part of a segment from the first to the last whole repetition; its length is a multiple of `samples`."""
    count = min(len(begins), (segment.samples - begins[0]) // samples)
    return segment.cut(begins[0], begins[0] + count * samples)


def average(found: Sequence[tuple[Segment, int]], period: float, source: str) -> tuple[Segment, list[Finding]]:
    """Mean of the repetitions, each shifted to the time of the first one, and findings about their delays.

    The whole samples of a shift are applied by indices of the recording, the remaining fraction in the frequency
    domain.

    Args:
        found: For each repetition, the segment in which it lies, and the index of its first sample in this segment.
        period: Period of the motion [s].
        source: Path of the recording, for the findings.
    """
    samples = round(period * found[0][0].rate)
    reference = found[0][0].cut(found[0][1], found[0][1] + samples)
    sums = [np.array(x) for x in _signals(reference)]
    bad = np.array(reference.bad)
    delays = [0.0]
    for segment, begin in found[1:]:
        first, rest = _aligned(reference.q, segment, begin)
        segment = segment.cut(first, first + samples)
        noise = np.sqrt(np.mean((segment.q - reference.q) ** 2, axis=0) / 2)
        moves = abs(rest) * np.sqrt(np.mean(np.diff(segment.q, axis=0) ** 2, axis=0))
        shift = bool((moves > NEGLIGIBLE * noise).any())
        for total, x in zip(sums, _signals(segment), strict=True):
            total += periodic_shift(x, -rest) if shift else x
        bad |= segment.bad
        delays.append(first - begin + rest)
    q, *others = (total / len(found) for total in sums)
    dq = others.pop(0) if reference.dq is not None else None
    ddq = others.pop(0) if reference.ddq is not None else None
    mean = Segment(reference.time, reference.rate, q, dq, ddq, others.pop(), bad)
    return mean, _delay_findings(np.array(delays), samples, reference.rate, source)


def _aligned(reference: Array, segment: Segment, begin: int) -> tuple[int, float]:
    """Aligns a repetition with the reference: index of its first sample, and remaining delay in samples."""
    room = segment.samples - len(reference)
    first, rest = begin, 0.0
    for _ in range(PASSES):
        rest = periodic_delay(reference, segment.q[first : first + len(reference)])
        moved = min(max(first + round(rest), 0), room)
        if moved == first:
            break
        first, rest = moved, rest - (moved - first)
    return first, rest


def _signals(segment: Segment) -> list[Array]:
    return [x for x in (segment.q, segment.dq, segment.ddq, segment.effort) if x is not None]


def _delay_findings(delays: Array, samples: int, rate: float, source: str) -> list[Finding]:
    """Findings about a wrong or inaccurate period, from the delays of the repetitions [samples]."""
    worst = int(np.argmax(np.abs(delays)))
    late = float(delays[worst])
    if abs(late) < 0.5:
        return []
    wrong = abs(late) > LATE * samples
    return [
        Finding(
            "period-misaligned",
            "warning" if wrong else "info",
            source,
            f"Repetition {worst + 1} of {len(delays)} is shifted by {late / rate:+.4g} s ({late:+.1f} samples) from "
            "its expected time.",
            "Check the keys `period` and `start` of the recording."
            if wrong
            else "The repetitions were aligned before averaging.",
        )
    ]


def check_closed(segment: Segment, source: str) -> None:
    """Raises an error if a run is not periodic, because its last sample does not continue to its first one.

    Raises:
        RecordingError: A joint jumps from the last sample to the first.
    """
    jump = np.abs(segment.q[0] - segment.q[-1])
    largest = np.abs(np.diff(segment.q, axis=0)).max(axis=0)
    joint = int(np.argmax(jump - JUMP * largest))
    if jump[joint] > JUMP * largest[joint]:
        raise RecordingError(
            f'{source or "The recording"}: edges = "periodic", but joint {joint + 1} ends {jump[joint]:.3g} rad or m '
            f"from where it began, {jump[joint] / max(largest[joint], 1e-300):.3g} times its largest step.",
            possible="a run that is a whole number of periods, or its period and start given with the recording",
            remedy=Remedy(
                "give the keys `period` and `start` of the recording, or use ", setting("edges", "drop"), "."
            ),
        )

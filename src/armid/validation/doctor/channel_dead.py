"""Channels that stick for a while, and the arm standing still."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.values import Array

__all__ = ["check"]

STUCK_SECONDS, STUCK_SAMPLES = 0.2, 20
"""A channel sticks when it keeps one value for so long while the arm moves."""

USUAL = 6.0
"""Times the next longest stretch that this must be: coarse converters keep a value at every reversal."""

SWING = 0.1
"""Share of its own span that a stuck torque would have had to move by while it stuck, seen from its joint's
motion."""

JUMP = 5.0
"""Usual steps that a position jumps when it comes loose."""

STANDSTILL = 1.0
"""Seconds of the same positions on all joints that are worth a word."""


def check(evidence: Evidence) -> list[Finding]:
    """Stuck channels as errors, standstill as information."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    rate = evidence.rate
    findings: list[Finding] = []
    names = evidence.robot.joint_names
    still = _longest(np.all(recording.q[1:] == recording.q[:-1], axis=1))
    seconds = (still[1] - still[0]) / rate
    if seconds >= STANDSTILL:
        findings.append(
            Finding(
                "standstill",
                "info",
                "",
                f"No joint moves for {seconds:.1f} s, rows {still[0]} to {still[1]}.",
                f"exclude = [[{_time(evidence, still[0]):.3f}, {_time(evidence, still[1]):.3f}]]"
                "  # such rows tell gravity and friction at rest apart from nothing",
            )
        )
    for j, name in enumerate(names):
        for what, values in (("q", recording.q[:, j]), ("effort", recording.effort[:, j])):
            found = _stuck(values, rate)
            if found is None:
                continue
            a, b = found
            moved = np.ptp(recording.q[a:b], axis=0) / np.maximum(np.ptp(recording.q, axis=0), 1e-12)
            if what == "effort" and (moved.max() < SWING or _at_extreme(values, a)):
                continue
            if what == "q" and (moved.max() < SWING or not _breaks(values, a, b)):
                continue
            findings.append(
                Finding(
                    "channel-dead",
                    "error",
                    name,
                    f"{what} stays at {values[a]:.6g} for {(b - a) / rate:.2f} s, rows {a} to {b}, while the arm "
                    "moves.",
                    f"exclude = [[{_time(evidence, a):.3f}, {_time(evidence, b):.3f}]]  # or record it again",
                )
            )
    return findings


def _longest(same: Array) -> tuple[int, int]:
    """First and last row of the longest stretch in which every row repeats the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    if not len(edges):
        return 0, 0
    pairs = edges.reshape(-1, 2)
    a, b = pairs[int(np.argmax(pairs[:, 1] - pairs[:, 0]))]
    return int(a), int(b)


def _stuck(values: Array, rate: float) -> tuple[int, int] | None:
    """Rows of a stretch of one value that is far longer than any other, if there is one."""
    if np.ptp(values) == 0.0:
        return None
    same = values[1:] == values[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    if not len(edges):
        return None
    pairs = edges.reshape(-1, 2)
    lengths = np.sort(pairs[:, 1] - pairs[:, 0])
    longest, next_longest = int(lengths[-1]), int(lengths[-2]) if len(lengths) > 1 else 0
    if longest < max(STUCK_SAMPLES, STUCK_SECONDS * rate) or longest < USUAL * next_longest:
        return None
    a, b = pairs[int(np.argmax(pairs[:, 1] - pairs[:, 0]))]
    return int(a), int(b)


def _at_extreme(values: Array, row: int) -> bool:
    """Whether a torque stays at its largest value, which is saturation."""
    return values[row] in (values.max(), values.min())


def _breaks(q: Array, a: int, b: int) -> bool:
    """Whether the motion stops or goes on with a jump, as no joint does."""
    step = np.abs(np.diff(q))
    usual = float(np.quantile(step[step > 0.0], 0.5)) if (step > 0.0).any() else 0.0
    if b + 1 < len(q) and step[b] > JUMP * usual:
        return True
    near = max(3, (b - a) // 20)
    before, behind = step[max(0, a - near) : a], step[b + 1 : b + 1 + near]
    moving = [float(np.median(x)) for x in (before, behind) if len(x)]
    return bool(moving) and max(moving) > 0.3 * usual


def _time(evidence: Evidence, row: int) -> float:
    """Time of a row on the recording's clock [s]."""
    recording = evidence.recording
    assert recording is not None
    row = min(row, recording.samples - 1)
    return row / evidence.rate if recording.time is None else float(recording.time[row])

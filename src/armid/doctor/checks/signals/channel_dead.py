"""Check for channels that are stuck at one value for some time, and for standstill of the arm."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.remedy_builders import excluding, lines

STANDSTILL = 1.0
"""Shortest rest of all joints that is reported [s]; rows of shorter rests are never used."""


INTERRUPTED, TIMES, ABRUPT = 0.1, 8, 5.0
"""Share of rows at one value of a torque, number of times at which it takes this value, and ratio of its steps to and
from the value to nine tenths of its other steps, from which the torque is interrupted. In recordings of eight arms,
the share is at most 0.036 and the ratio at most 1.3; coarse torques take one value up to 455 times, so the number
only separates interruptions from a single stuck stretch."""


DWELL, DWELLS, ELSEWHERE = 4, 8, 0.2
"""Number of rows in succession from which a torque keeps a value, number of times at which it keeps the same value,
and largest share, relative to this value, of the rows in which it keeps other values, from which it is interrupted,
too. The steps of a noisy torque are as large as those to the value, but its values do not repeat. In recordings of
eight arms, no torque keeps its most frequent value for four rows more than once while the arm moves."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports stuck and interrupted channels as errors and standstill as information."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    rate = evidence.rate
    findings: list[Finding] = []
    names = evidence.robot.joint_names
    if (rests := _rests(evidence)) is not None:
        findings.append(rests)
    for j, quantity, a, b in evidence.stuck:
        value = getattr(recording, quantity)[a, j]
        findings.append(
            Finding(
                "channel-dead",
                "error",
                names[j],
                f"{quantity} stays at {value:.6g} for {(b - a) / rate:.2f} s, rows {a} to {b}, while the arm moves. "
                "Check the sensor, the cable and the logger of this channel first.",
                excluding(evidence.reading, [_times(evidence, a, b)], "or record the motion again"),
            )
        )
    return findings + [found for j in range(recording.n) if (found := _interrupted(evidence, j)) is not None]


def _interrupted(evidence: LogEvidence, j: int) -> Finding | None:
    """Finding about a torque that falls to one value again and again; `None` if it does not."""
    recording = evidence.recording
    assert recording is not None and recording.effort is not None
    torque = recording.effort[recording.valid[:, j], j]
    if not len(torque):
        return None
    values, counts = np.unique(torque, return_counts=True)
    value, count = float(values[np.argmax(counts)]), int(counts.max())
    if not INTERRUPTED * len(torque) < count < (1.0 - INTERRUPTED) * len(torque):
        return None
    there = torque == value
    steps = np.abs(np.diff(torque))
    entries, inside = there[1:] != there[:-1], ~there[1:] & ~there[:-1]
    others = steps[inside & (steps > 0.0)]  # a coarse torque often keeps its value
    if entries.sum() < 2 * TIMES or not len(others):
        return None
    abrupt = float(np.median(steps[entries])) > ABRUPT * float(np.quantile(others, 0.9))
    if not abrupt and not _dwells(torque, value, recording.q[recording.valid[:, j]]):
        return None
    joint = evidence.robot.joints[j]
    how = f", in steps at least {ABRUPT:g} times as large as others" if abrupt else ", and keeps no other value"
    return Finding(
        "channel-dead",
        "error",
        joint.name,
        f"The torque of {joint.name} falls to {value:.4g} {joint.effort_unit} and comes back "
        f"{int(entries.sum()) // 2} times{how}; {count} of "
        f"{len(torque)} rows have this value. Check the sensor, the cable and the logger of this channel first.",
        "record the motion again, or correct the log: leave out the rows with this value",
    )


def _dwells(torque: Array, value: float, q: Array) -> bool:
    """True if a torque (M,) keeps one value several times while the arm moves, and hardly any other value.

    A torque that keeps its largest or smallest value is saturated, and not interrupted.

    Args:
        torque: Torque of the joint, shape (M,).
        value: The value.
        q: Positions of all joints, shape (M, n).
    """
    if value in (torque.min(), torque.max()):
        return False
    edges = np.flatnonzero(np.concatenate([[True], torque[1:] != torque[:-1], [True]]))
    starts, lengths = edges[:-1], np.diff(edges)
    long = lengths >= DWELL
    moves = np.array([np.any(q[a] != q[a + k - 1]) for a, k in zip(starts[long], lengths[long], strict=True)])
    rows, there = lengths[long], torque[starts[long]] == value
    return bool((there & moves).sum() >= DWELLS) and int(rows[~there].sum()) < ELSEWHERE * int(rows[there].sum())


def _rests(evidence: LogEvidence) -> Finding | None:
    """Finding about times at which no joint moves; `None` if there are no such times.

    A motion that is repeated with pauses contains several rests. They are not a fault: gravity can be seen in long
    rests, and every repetition contains them.
    """
    recording = evidence.recording
    assert recording is not None
    counts = recording.valid[1:].any(axis=1) & recording.valid[:-1].any(axis=1)
    same = np.all(recording.q[1:] == recording.q[:-1], axis=1) & counts
    ends = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))).reshape(-1, 2)
    seconds = (ends[:, 1] - ends[:, 0]) / evidence.rate
    ends, seconds = ends[seconds >= STANDSTILL], seconds[seconds >= STANDSTILL]
    if not len(ends):
        return None
    k = int(np.argmax(seconds))
    text = f"No joint moves for {seconds[k]:.1f} s, rows {ends[k, 0]} to {ends[k, 1]}"
    if len(ends) > 1:
        whole = recording.samples / evidence.rate
        text += (
            f", the longest of {len(ends)} rests of {STANDSTILL:g} s or more, {seconds.sum():.1f} s of {whole:.1f} s"
        )
    text += ". Such rests are used, because they show gravity, except before and after repetitions."
    return Finding(
        "standstill", "info", "", text, lines("leaves out all rests", table="processing", standstill="moving")
    )


def _times(evidence: LogEvidence, first: int, last: int) -> tuple[float, float]:
    """Times of a first and a last row on the clock of the recording [s]."""
    recording = evidence.recording
    assert recording is not None
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    return float(time[first]), float(time[min(last, recording.samples - 1)])


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "channel-dead": "The joint's parameters are fitted to values that were not measured.",
    },
    untested={
        "channel-dead": "it removes rows without a measurement, so there is nothing to compare with the prediction",
    },
    hides=(
        "contact",
        "temperature-drift",
        "excitation-weak",
        "rotor-inertia-missing",
        "channel-delay",
        "position-offset",
        "velocity-mismatch",
        "period-misaligned",
    ),
    needs_torque=False,
)

"""Check for rows that are missing, that stand elsewhere or that were filled in, although the clock shows no gap.

If a recorder loses samples and writes time stamps of its own, or if someone cuts a log and numbers its rows again,
all positions jump at the same row. A single joint that jumps has another fault.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.torque_jumps import common_jumps
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.recording import Recording
from armid.measurement.remedy_builders import excluding

CODE, CONTACT = "rows-not-consecutive", "contact"

LOST = (1.6, 6.0)
"""Smallest and largest ratio of a step of the positions to the steps beside it, from which one to five rows count as
lost."""

STRAIGHT = 0.3
"""Largest part of such a step across the direction of the steps beside it, relative to the step."""

MANY = 0.01
"""Share of the rows in motion with lost rows before them, from which the clock is wrong."""

EVEN = 1.05
"""Largest ratio of long to short steps of an even clock. Only then lost rows are searched: time stamps that scatter
may be those at which rows arrived, and are examined as `clock-jitter`."""

JUMP = 8.0
"""Ratio of a step to the largest usual step (quantile 0.99) from which the rows are not consecutive."""

JOINTS = 0.5
"""Smallest share of the joints that must jump at the same row."""

MOVING = 0.3
"""Speed of the joints together, as a share of their RMS speed, above which a step is compared."""

FEWEST_JOINTS = 4
"""Smallest number of joints: two or three joints that stick and slide together take such steps, too."""

FEWEST = 100
"""Smallest number of rows in motion."""

REACH = 0.5
"""Time before and after a jump that is excluded by the remedy [s]."""

ALIKE, STEEP = 1e-6, 1e-3
"""Largest difference of two slopes in succession that are the same, and smallest slope, relative to the root mean
square of the slopes of the channel. So the lines are seen only in logs that keep all digits; where values are
rounded, two slopes in succession differ less than their rounding in sound logs, too."""

FILLED, LONG, LINES = 0.5, 3, 3
"""Share of the positions, and of the torques, that follow straight lines at the same rows, number of pairs of equal
slopes in succession, and number of such stretches, from which gaps were filled. In recordings of eight arms, no two
slopes in succession are the same in half of the positions and half of the torques."""

LISTED = 3
"""Number of jumps whose times are listed."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports rows that do not follow each other in time, or were not measured, although the clock shows no gap."""
    recording = evidence.recording
    if recording is None or recording.consecutive is False:
        return []
    if recording.samples < FEWEST or recording.n < FEWEST_JOINTS:
        return []
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    steps = np.diff(time)
    if not (steps > 0.0).all():
        return []
    filled = _filled(recording, time)
    bridged = [_bridged(evidence, time, filled)] if len(filled) >= LINES else []
    return [*bridged, *(_out_of_order(evidence, time) or _torques_out_of_order(evidence, time))]


def _torques_out_of_order(evidence: LogEvidence, time: Array) -> list[Finding]:
    """Reports torques that do not follow each other in time although the positions do, and no contact explains it."""
    assert evidence.recording is not None
    rows = common_jumps(evidence.recording)
    if not len(rows) or any(each.code == CONTACT for each in evidence.explanations):
        return []
    return [
        Finding(
            CODE,
            "warning",
            "effort",
            f"Most torques jump at the same rows while the joints move on, at t = {_listed(time, rows)}: the "
            "torques before and after do not follow each other in time, or the logger changed all of them there.",
            "log torques and positions in one message, or merge them by the times at which they were measured",
        )
    ]


def _out_of_order(evidence: LogEvidence, time: Array) -> list[Finding]:
    """Reports rows that do not follow each other in time, although the clock shows no gap."""
    recording, steps = evidence.recording, np.diff(time)
    assert recording is not None
    speed = np.diff(recording.q, axis=0) / steps[:, None]
    usable: NDArray[np.bool_] = np.asarray((recording.valid[1:] & recording.valid[:-1]).all(axis=1))
    jumps = np.flatnonzero(_jumps(speed, usable))
    if len(jumps):
        return [_jumped(evidence, time, jumps)]
    if np.quantile(steps, 0.9) > EVEN * np.quantile(steps, 0.1):
        return []
    lost, moving = _lost(speed, usable)
    if moving < FEWEST or lost.sum() < MANY * moving:
        return []
    rows = np.flatnonzero(lost)
    return [
        Finding(
            CODE,
            "error",
            "time",
            f"In {len(rows)} of {moving} rows in motion, all joints move {LOST[0]:g} times as far as in the "
            f"rows beside them or farther, first at t = {_listed(time, rows)}: rows are missing there, but the clock "
            "does not show it.",
            "log the time at which each row was measured; rewrite the log with these time stamps",
        )
    ]


def _filled(recording: Recording, time: Array) -> NDArray[np.intp]:
    """First and last row of each stretch in which positions and torques follow straight lines, shape (k, 2)."""
    if recording.effort is None:
        return np.zeros((0, 2), dtype=np.intp)
    usable: NDArray[np.bool_] = np.asarray(recording.valid.all(axis=1))
    straight = _straight(recording.q, time) & _straight(recording.effort, time)
    straight &= usable[:-2] & usable[1:-1] & usable[2:]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], straight.astype(np.int8), [0]]))).reshape(-1, 2)
    return edges[edges[:, 1] - edges[:, 0] >= LONG] + np.array([0, 1])


def _straight(values: Array, time: Array) -> NDArray[np.bool_]:
    """Mask of the rows between whose neighbours many channels (N, n) follow a straight line, shape (N - 2,)."""
    slope = np.diff(values, axis=0) / np.diff(time)[:, None]
    size = np.sqrt(np.mean(slope**2, axis=0))
    same = (np.abs(np.diff(slope, axis=0)) <= ALIKE * size) & (np.abs(slope[1:]) > STEEP * size)
    return np.asarray(same.mean(axis=1) >= FILLED)


def _bridged(evidence: LogEvidence, time: Array, filled: NDArray[np.intp]) -> Finding:
    """Finding about gaps that were filled by straight lines."""
    share = float(np.sum(filled[:, 1] - filled[:, 0])) / len(time)
    text = (
        f"In {len(filled)} stretches, {share:.0%} of the rows, positions and torques follow straight lines together, "
        f"first at t = {_listed(time, filled[:, 0])}: rows that were missing were filled in by interpolation."
    )
    intervals = [(float(time[a]), float(time[b])) for a, b in filled]
    return Finding(CODE, "warning", "time", text, excluding(evidence.reading, intervals, "s; or log all rows"))


def _jumps(speed: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the steps at which most joints jump and do not come back, shape (M,).

    Args:
        speed: Steps of the positions over the time between the rows, shape (M, n) [rad/s or m/s].
        usable: Mask of the steps between rows that are used, shape (M,).
    """
    size = np.abs(speed)
    usual = np.quantile(size[usable], 0.99, axis=0) if usable.any() else np.full(speed.shape[1], np.inf)
    far = (size > JUMP * np.where(usual > 0.0, usual, np.inf)) & usable[:, None]
    return far.mean(axis=1) >= JOINTS


def _lost(speed: Array, usable: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """Mask of the steps that are a multiple of the steps beside them, shape (M,), and number of steps in motion."""
    scaled = speed / np.maximum(np.sqrt(np.mean(speed**2, axis=0)), np.finfo(float).tiny)
    beside = np.zeros_like(scaled)
    beside[2:-2] = (scaled[:-4] + scaled[1:-3] + scaled[3:-1] + scaled[4:]) / 4.0
    power = np.sum(beside * beside, axis=1)
    moving = usable & (power > MOVING**2 * speed.shape[1])
    along = np.sum(scaled * beside, axis=1) / np.where(moving, power, 1.0)
    across = np.linalg.norm(scaled - along[:, None] * beside, axis=1)
    straight = across < STRAIGHT * np.linalg.norm(scaled, axis=1)
    return moving & straight & (along > LOST[0]) & (along < LOST[1]), int(moving.sum())


def _jumped(evidence: LogEvidence, time: Array, rows: NDArray[np.intp]) -> Finding:
    """Finding about rows at which most joints jump."""
    near = [(float(time[k]) - REACH, float(time[k + 1]) + REACH) for k in rows]
    low, high = float(time[0]), float(time[-1])
    intervals = [(max(a, low), min(b, high)) for a, b in near]
    text = (
        f"At t = {_listed(time, rows)} at least {JOINTS:.0%} of the joints jump by more than {JUMP:g} times their "
        "largest usual step, in one step of the clock: the rows before and after do not follow each other in time."
    )
    return Finding(
        CODE,
        "error",
        "time",
        text,
        excluding(evidence.reading, intervals, "s; or rewrite the log with the true times"),
    )


def _listed(time: Array, rows: NDArray[np.intp]) -> str:
    """Times of the first rows."""
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    return f"{', '.join(f'{t:.3f}' for t in time[rows[:LISTED]])} s{more}"


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        CODE: "Derivatives and filters across rows that are not neighbours in time are wrong; without consecutive "
        "rows, nothing can be filtered or differentiated.",
    },
    untested={CODE: "the rows near a jump have no usable derivatives"},
    hides=("contact", "velocity-mismatch"),
    needs_torque=False,
)

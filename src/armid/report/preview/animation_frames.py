"""Motion of the preview: positions and velocities at thirty frames per second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.excitation.plan import Plan
from armid.excitation.poses_and_sweeps import Moves
from armid.measurement.recording import Recording
from armid.model.motion import Motion

FRAMES = 30.0
"""Frame rate [Hz]; the page interpolates between frames, with errors below a millimetre at the speeds of arms."""

MAX_FRAMES = 9000
"""Largest number of frames of a clip, five minutes; longer motions have a lower frame rate."""

ROWS = 10.0
"""Rate at which rows of a recording without consecutive times are shown [Hz]."""


@dataclass(frozen=True, eq=False, slots=True)
class Clip:
    """Motion of a preview: K frames of n joints.

    Attributes:
        title: Short title.
        time: Time since the beginning of the clip, evenly spaced, shape (K,) [s].
        q: Positions, shape (K, n) [rad or m].
        dq: Velocities, shape (K, n) [rad/s or m/s].
    """

    title: str
    time: Array
    q: Array
    dq: Array


def clip_of_plan(plan: Plan | Moves, title: str) -> Clip:
    """Clip of a whole plan."""
    motion = plan.at(_times(plan.duration))
    return Clip(title, motion.time, motion.q, motion.dq)


def clip_of_motion(motion: Motion, title: str) -> Clip:
    """Clip of a sampled motion; positions and velocities are interpolated."""
    since = motion.time - motion.time[0]
    time = _times(float(since[-1]))
    q, dq = (np.column_stack([np.interp(time, since, x) for x in values.T]) for values in (motion.q, motion.dq))
    return Clip(title, time, q, dq)


def clip_of_recording(recording: Recording, title: str) -> Clip:
    """Clip of a recording; gaps are interpolated linearly, and rows without consecutive times are shown at 10 Hz."""
    rows = np.arange(recording.samples, dtype=np.float64)
    if recording.time is None or recording.consecutive is False:
        rate = ROWS if recording.consecutive is False or recording.rate is None else recording.rate
        since = rows / rate
    else:
        since = recording.time - recording.time[0]
    known = np.isfinite(recording.q).all(axis=1) & np.isfinite(since)
    since, q = np.maximum.accumulate(since[known]), recording.q[known]
    time = _times(float(since[-1]) if len(since) else 0.0)
    frames = np.column_stack([np.interp(time, since, x) for x in q.T])
    dq = np.gradient(frames, time, axis=0) if len(time) > 1 else np.zeros_like(frames)
    return Clip(title, time, frames, dq)


def still(q: Array, title: str) -> Clip:
    """Clip of an arm at rest in a pose q (n,) [rad or m]."""
    return Clip(title, np.zeros(1), np.asarray(q)[None], np.zeros((1, len(q))))


def _times(duration: float) -> Array:
    """Evenly spaced times from 0 to `duration` [s], at the rate `FRAMES`, or slower if there are `MAX_FRAMES`."""
    return np.linspace(0.0, duration, min(MAX_FRAMES, max(1, round(duration * FRAMES))) + 1)

"""Motions with a past: states that memory may have, and what a play operator does, written out; shared by tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion


def dragged(q: Array, width: float, start: float) -> Array:
    """The centre of a window of half-width `width` that begins at `start` and is dragged along by q (N,)."""
    states = np.empty(len(q))
    z = start
    for s, at in enumerate(q):
        z = min(max(z, at - width), at + width)
        states[s] = z
    return states


def known_from(q: Array, width: float) -> int:
    """First sample at which the window stands where it does whatever its beginning; N where it never does."""
    low, high = (dragged(q, width, q[0] + side * width) for side in (-1.0, 1.0))
    return int(np.argmax(low == high)) if (low == high).any() else len(q)


def joints_known_from(model: DynamicsModel, motion: Motion) -> NDArray[np.int64]:
    """The same for the joints of a model, all of whose memory must be known, shape (n,)."""
    since = np.zeros(model.n, dtype=np.int64)
    for _, law in model.laws:
        if law.memory is not None:
            drive = sum(w * motion.q[:, j] for j, w in law.coordinate)
            for j, _ in law.coordinate:
                since[j] = max(since[j], known_from(np.asarray(drive), law.memory.width))
    return since


def with_any_past(model: DynamicsModel, motion: Motion, rng: np.random.Generator) -> Motion:
    """The motion with any states that its positions allow; samples need not follow each other."""
    states = np.empty((motion.samples, len(model.nodes)))
    for column, node in zip(states.T, model.nodes, strict=True):
        drive = sum(w * motion.q[:, j] for j, w in node.coordinate)
        column[:] = drive + node.memory.width * rng.uniform(-1.0, 1.0, motion.samples)
    return motion.with_memory(states)

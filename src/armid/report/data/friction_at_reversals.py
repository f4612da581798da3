"""Friction around the moments at which a joint turns back, where memory shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from armid.report.data.recording_data import RecordingData
from armid.values import Array

__all__ = ["HALF_WINDOW", "Reversals", "find_reversals", "since_reversal"]

HALF_WINDOW = 0.6
"""Time looked at on either side of a reversal [s]: several times what presliding takes in a gear."""

STEPS = 41

MOVING = 0.05
"""Share of its fastest that a joint must reach on both sides; slower is trembling about standstill."""


@dataclass(frozen=True, eq=False, slots=True)
class Reversals:
    """Friction of one joint around its reversals, R of them, turned so that the motion after each is positive.

    The mean of the model's friction over each window is taken off both, so that offsets do not part them.

    Attributes:
        time: Since the reversal, shape (K,) [s].
        observed: Measured less what the model says of all but friction, shape (R, K) [N·m or N].
        fitted: Friction of the model, shape (R, K).
    """

    time: Array
    observed: Array
    fitted: Array


def find_reversals(evidence: Sequence[RecordingData], j: int) -> Reversals:
    """All reversals of a joint whose rows count and lie within one contiguous run."""
    grid = np.linspace(-HALF_WINDOW, HALF_WINDOW, STEPS)
    fastest = max((float(np.abs(each.dq[:, j]).max()) for each in evidence), default=0.0)
    observed: list[Array] = []
    fitted: list[Array] = []
    for each in (each for each in evidence if each.is_consecutive):
        friction = each.residual[:, j] + each.friction[:, j]
        for start, stop in pairwise(each.starts):
            time, dq = each.time[start:stop], each.dq[start:stop, j]
            for at, direction in _crossings(time, dq, MOVING * fastest):
                around = at + grid
                if around[0] < time[0] or around[-1] > time[-1]:
                    continue
                seen = direction * np.interp(around, time, friction[start:stop])
                if np.isfinite(seen).all():
                    said = direction * np.interp(around, time, each.friction[start:stop, j])
                    observed.append(seen - said.mean())
                    fitted.append(said - said.mean())
    empty = np.zeros((0, STEPS))
    return Reversals(grid, np.array(observed) if observed else empty, np.array(fitted) if fitted else empty)


def since_reversal(time: Array, dq: Array) -> Array:
    """Time since the last change of a velocity's sign (M,) [s]; NaN before the first."""
    turned = np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1
    last = np.searchsorted(turned, np.arange(len(dq)), side="right") - 1
    found = np.full(len(dq), np.nan)
    known = last >= 0
    found[known] = time[known] - time[turned[last[known]]]
    return found


def _crossings(time: Array, dq: Array, least: float) -> list[tuple[float, float]]:
    """Time of each change of sign, and the direction after it, where the joint really moves on both sides."""
    found: list[tuple[float, float]] = []
    rows = np.flatnonzero(np.sign(dq[:-1]) * np.sign(dq[1:]) < 0.0)
    for k in rows:
        at = float(time[k] - dq[k] * (time[k + 1] - time[k]) / (dq[k + 1] - dq[k]))
        near = np.abs(time - at) <= HALF_WINDOW
        before, after = near & (time < at), near & (time > at)
        direction = float(np.sign(dq[k + 1]))
        if before.any() and after.any():
            enough = min(float(np.max(-direction * dq[before])), float(np.max(direction * dq[after])))
            if enough >= least:
                found.append((at, direction))
    return found

"""Part of a log that has to be left out so that nothing changes in the rest: the smaller one of two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.refine import FittedChange
from armid.doctor.changes.scan import block_of
from armid.doctor.changes.shapes import BLOCKS

MOSTLY = 0.5
"""Size of a gradual change from which a block belongs to the changed part."""

MARGIN = 1.0
"""Length by which the part that is left out is extended into the rest, in blocks: the time of a change is known to
half a block, and filters spread it."""


@dataclass(frozen=True, slots=True)
class ExcludedPart:
    """Part of a log that is left out.

    Attributes:
        intervals: Begin and end of each interval [s].
        changed: True if the part is the one that differs from the rest; false if the rest of the log is smaller.
    """

    intervals: tuple[tuple[float, float], ...]
    changed: bool


def excluded_part(each: FittedChange, begin: float, end: float) -> ExcludedPart:
    """Finds the smaller part of a log on one side of a change.

    Args:
        each: The change.
        begin: Time of the first row of the recording [s].
        end: Time of its last row [s].
    """
    inside = each.candidate.shape.size > MOSTLY
    changed = bool(inside.sum() <= BLOCKS / 2)
    out = inside if changed else ~inside
    time = each.state.rows.motion.time
    edges = block_edges(time)
    bounds = np.flatnonzero(np.diff(np.concatenate([[False], out, [False]]).astype(int)))
    intervals: list[tuple[float, float]] = []
    for first, stop in zip(bounds[::2], bounds[1::2], strict=True):
        low = begin if first == 0 else edges[first] - MARGIN * (edges[first + 1] - edges[first])
        high = end if stop == BLOCKS else edges[stop] + MARGIN * (edges[stop] - edges[stop - 1])
        intervals.append((float(low), float(high)))
    return ExcludedPart(tuple(intervals), changed)


def near_changes(each: FittedChange) -> NDArray[np.bool_]:
    """Mask of the rows in the blocks on both sides of each abrupt change, shape (M,)."""
    size = each.candidate.shape.size
    edges = np.abs(np.diff(size)) > MOSTLY
    near = np.append(edges, False) | np.append(False, edges)
    return near[block_of(len(each.state.rows.torque))]


def block_edges(time: Array) -> Array:
    """Times between the blocks of some rows, with the first and the last time, shape (BLOCKS + 1,) [s]."""
    starts = np.searchsorted(block_of(len(time)), np.arange(1, BLOCKS))
    return np.concatenate([time[:1], 0.5 * (time[starts] + time[starts - 1]), time[-1:]])

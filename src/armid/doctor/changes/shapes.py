"""Shapes of a change over a recording: its size in each block of rows, from 0 to 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

BLOCKS = 20
"""Number of blocks of rows of equal length into which a log is divided. The time of a change is known to a block."""

SHORTEST = 2
"""Smallest number of blocks on either side of a change: a tenth of the log. Shorter ones are spikes or contacts."""

DECAYS = (3.0, 6.0)
"""Rates of an exponential decay along the log, for its length: gears that warm up lose friction in this way."""

Form = Literal["step", "ramp", "decay"]


@dataclass(frozen=True, slots=True)
class ChangeShape:
    """Change over a log.

    Attributes:
        form: `step` if the change is complete in some blocks and absent in others, `ramp` if it grows along the log,
            `decay` if it fades exponentially.
        first: First block that is changed.
        stop: Block after the last one that is changed.
        rate: Rate of the decay, for the length of the log.
        inverted: First block and block after the last one of a second part, in which a step is absent if it is
            complete there otherwise, and the reverse; empty without one.
    """

    form: Form
    first: int = 0
    stop: int = BLOCKS
    rate: float = 0.0
    inverted: tuple[int, ...] = ()

    @property
    def size(self) -> Array:
        """Size of the change in each block, shape (BLOCKS,)."""
        along = (np.arange(BLOCKS) + 0.5) / BLOCKS
        if self.form == "ramp":
            return along
        if self.form == "decay":
            return np.exp(-self.rate * along)
        inside = _between(self.first, self.stop)
        return (inside ^ _between(*self.inverted) if self.inverted else inside).astype(np.float64)


def _between(first: int, stop: int) -> NDArray[np.bool_]:
    """Mask of the blocks from the first one to the one before `stop`, shape (BLOCKS,)."""
    return (np.arange(BLOCKS) >= first) & (np.arange(BLOCKS) < stop)


@lru_cache(maxsize=1)
def shapes() -> tuple[tuple[ChangeShape, ...], NDArray[np.bool_], Array]:
    """All s shapes, the last one constant; a mask of those that are steps, and sizes in each block, (s, BLOCKS)."""
    steps = [
        ChangeShape("step", first, stop)
        for first in range(SHORTEST, BLOCKS)
        for stop in range(first + SHORTEST, BLOCKS + 1)
    ]
    every = (*steps, ChangeShape("ramp"), *(ChangeShape("decay", rate=rate) for rate in DECAYS), ChangeShape("step"))
    return every, np.array([shape.form == "step" for shape in every]), np.stack([shape.size for shape in every])


@lru_cache(maxsize=256)
def inverted_in_part(shape: ChangeShape) -> tuple[tuple[tuple[int, int], ...], Array]:
    """Second parts with which a step differs from a step (`ChangeShape.inverted`), and their sizes, (s, BLOCKS)."""
    every, abrupt, sizes = shapes()
    steps = np.flatnonzero(abrupt[:-1])
    size = sizes[steps].astype(np.bool_) ^ shape.size.astype(np.bool_)
    changed = np.count_nonzero(size, axis=1)
    enough = np.flatnonzero((changed >= SHORTEST) & (changed <= BLOCKS - SHORTEST))
    return tuple((every[k].first, every[k].stop) for k in steps[enough]), size[enough].astype(np.float64)

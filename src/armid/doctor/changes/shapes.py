"""Shapes of a change over a recording: its size in each block of rows, from 0 to 1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

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
    """

    form: Form
    first: int = 0
    stop: int = BLOCKS
    rate: float = 0.0

    @property
    def size(self) -> Array:
        """Size of the change in each block, shape (BLOCKS,)."""
        along = (np.arange(BLOCKS) + 0.5) / BLOCKS
        if self.form == "ramp":
            return along
        if self.form == "decay":
            return np.exp(-self.rate * along)
        return ((np.arange(BLOCKS) >= self.first) & (np.arange(BLOCKS) < self.stop)).astype(np.float64)


@lru_cache(maxsize=1)
def shapes() -> tuple[tuple[ChangeShape, ...], Array]:
    """All shapes, the last one without a change, and their sizes in each block, shape (s, BLOCKS)."""
    steps = [
        ChangeShape("step", first, stop)
        for first in range(SHORTEST, BLOCKS)
        for stop in range(first + SHORTEST, BLOCKS + 1)
    ]
    every = (*steps, ChangeShape("ramp"), *(ChangeShape("decay", rate=rate) for rate in DECAYS), ChangeShape("step"))
    return every, np.stack([shape.size for shape in every])

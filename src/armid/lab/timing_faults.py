"""Faults of the clock: rows that are lost, missing for a while, or repeated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armid.errors import LabError
from armid.measurement.recording import Recording
from armid.values import Array

QUANTITIES = ("q", "dq", "ddq", "effort")
"""Quantities that a recording may have for each channel."""


def check_share(name: str, value: float) -> None:
    """Raises an error for a number that is not a share."""
    if not 0.0 <= value < 1.0:
        raise LabError(f"{name} must be a share from 0 to 1; found {value}.")


def clock_of(recording: Recording) -> Array:
    """Times of the rows (N,) [s], uniform ones where the recording has no clock."""
    if recording.time is not None:
        return recording.time
    return np.arange(recording.samples) / (recording.rate or 1.0)


def _rows(recording: Recording, rows: NDArray[np.intp]) -> dict[str, Array]:
    """Recording with a selection of rows, which may repeat."""
    present = {name: getattr(recording, name) for name in QUANTITIES}
    return {name: x[rows] for name, x in present.items() if x is not None}


def _without(recording: Recording, kept: NDArray[np.bool_]) -> Recording:
    rows = np.flatnonzero(kept)
    time = None if recording.time is None else recording.time[rows]
    return replace(recording, **_rows(recording, rows), time=time, valid=recording.valid[rows])


@dataclass(frozen=True, slots=True)
class LostRows:
    """Rows that are missing together with their time stamps.

    Attributes:
        share: Probability of each row but the first and last.
    """

    share: float = 0.01
    name: ClassVar[str] = "lost-rows"

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The recording without these rows."""
        kept = rng.random(recording.samples) >= self.share
        kept[[0, -1]] = True
        return _without(recording, kept)


@dataclass(frozen=True, slots=True)
class Gap:
    """Interval without any row.

    Attributes:
        start: Begin as a share of the length of the recording.
        seconds: Length [s].
    """

    start: float = 0.5
    seconds: float = 0.5
    name: ClassVar[str] = "gap"

    def __post_init__(self) -> None:
        check_share("start", self.start)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The recording without this stretch."""
        del rng
        time = clock_of(recording)
        begin = time[0] + self.start * (time[-1] - time[0])
        return _without(recording, (time < begin) | (time >= begin + self.seconds))


@dataclass(frozen=True, slots=True)
class RepeatedRows:
    """Rows that repeat the values of the row before, as when a lost packet is replaced by the last one.

    Attributes:
        share: Probability of each row.
        stamps: Whether the time is repeated, too.
    """

    share: float = 0.01
    stamps: bool = False
    name: ClassVar[str] = "repeated-rows"

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The recording with these rows."""
        again = rng.random(recording.samples) < self.share
        again[0] = False
        rows = np.maximum.accumulate(np.where(again, 0, np.arange(recording.samples)))
        time = recording.time if recording.time is None or not self.stamps else recording.time[rows]
        return replace(recording, **_rows(recording, rows), time=time)


@dataclass(frozen=True, slots=True)
class NoClock:
    """Log without times and without a rate."""

    name: ClassVar[str] = "no-clock"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The recording without its clock."""
        del rng
        return replace(recording, time=None, rate=None)


@dataclass(frozen=True, slots=True)
class ShuffledRows:
    """Rows in random order without times, as in a table of samples for machine learning."""

    name: ClassVar[str] = "shuffled-rows"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """The recording with its rows in another order."""
        rows = rng.permutation(recording.samples)
        return replace(
            recording, **_rows(recording, rows), time=None, rate=None, consecutive=None, valid=recording.valid[rows]
        )

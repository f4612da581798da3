"""Faults of the time base: rows that are lost, missing for some time, repeated or shuffled, and missing times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import LabError
from armid.measurement.recording import Recording

QUANTITIES = ("q", "dq", "ddq", "effort", "command")
"""Quantities that a recording can have for each channel."""


def check_share(name: str, value: float) -> None:
    """Raises an error if a number is not a share, that is, at least 0 and below 1."""
    if not 0.0 <= value < 1.0:
        raise LabError(
            f"The key `{name}` must be a share of at least 0 and below 1; found {value}.", remedy="correct the value."
        )


def clock_of(recording: Recording) -> Array:
    """Times of the rows (N,) [s]; uniform times if the recording has no clock."""
    if recording.time is not None:
        return recording.time
    return np.arange(recording.samples) / (recording.rate or 1.0)


def _rows(recording: Recording, rows: NDArray[np.intp]) -> dict[str, Array]:
    """Quantities of a recording at rows with given indices, by name; an index may occur several times."""
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
        share: Probability that a row is lost; the first and the last row are never lost.
    """

    share: float = 0.01
    name: ClassVar[str] = "lost-rows"

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording without the rows that are lost; `rng` decides which rows are lost."""
        kept = rng.random(recording.samples) >= self.share
        kept[[0, -1]] = True
        return _without(recording, kept)


@dataclass(frozen=True, slots=True)
class Gap:
    """Interval of time without rows.

    Attributes:
        start: Start of the interval, as a share of the duration of the recording.
        seconds: Duration of the interval [s].
    """

    start: float = 0.5
    seconds: float = 0.5
    name: ClassVar[str] = "gap"

    def __post_init__(self) -> None:
        check_share("start", self.start)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording without the rows of the interval that begins at `start` and lasts `seconds`."""
        del rng
        time = clock_of(recording)
        begin = time[0] + self.start * (time[-1] - time[0])
        return _without(recording, (time < begin) | (time >= begin + self.seconds))


@dataclass(frozen=True, slots=True)
class RepeatedRows:
    """Rows that repeat the values of the row before, for instance because a lost packet was replaced by the last one.

    Attributes:
        share: Probability that a row is a repetition.
        stamps: True if the time stamp of the row before is repeated, too.
    """

    share: float = 0.01
    stamps: bool = False
    name: ClassVar[str] = "repeated-rows"

    def __post_init__(self) -> None:
        check_share("share", self.share)

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording in which rows repeat the row before; `rng` decides which rows are repetitions."""
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
        """Recording without times and rate."""
        del rng
        return replace(recording, time=None, rate=None)


@dataclass(frozen=True, slots=True)
class ShuffledRows:
    """Rows in random order and without times, as in a data set for machine learning."""

    name: ClassVar[str] = "shuffled-rows"

    def apply(self, recording: Recording, rng: np.random.Generator) -> Recording:
        """Recording with its rows in random order."""
        rows = rng.permutation(recording.samples)
        return replace(
            recording, **_rows(recording, rows), time=None, rate=None, consecutive=None, valid=recording.valid[rows]
        )

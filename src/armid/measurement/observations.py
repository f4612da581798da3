"""Observations for estimation: contiguous runs at the full sampling rate, and the band of torque and model."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.measurement.low_pass_band import Band
from armid.model.motion import Motion


@dataclass(frozen=True, eq=False, slots=True)
class ObservedRun:
    """Contiguous run: consecutive samples of motion and measured torque.

    The output grid has M rows: every `step`-th sample, beginning with sample `offset`. Masks and blocks have one
    entry for each row.

    Attributes:
        motion: Motion at the full sampling rate, N samples.
        torque: Joint torque, shape (N, n) [N·m or N].
        rate: Samples per second [Hz].
        step: Number of samples from one row of the output grid to the next.
        offset: Index of the sample of the first row.
        mask: Mask of the rows that are valid for each joint, shape (M, n).
        block: Block of each row, counted from 0 without gaps, shape (M,). A block is one period if a period is
            stated, otherwise about one second.
        consecutive: True if the samples are consecutive in time; otherwise nothing may be filtered.
        recording: Index of the recording to which the run belongs.
        repetition: Repetition of the motion to which each row belongs, if repetitions were detected, shape (M,). The
            rows of a block that are in use belong to one repetition.
    """

    motion: Motion
    torque: Array
    rate: float
    step: int
    offset: int
    mask: NDArray[np.bool_]
    block: NDArray[np.int64]
    consecutive: bool = True
    recording: int = 0
    repetition: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        N, n = self.motion.q.shape
        object.__setattr__(self, "torque", array(self.torque, (N, n), "torque"))
        if not (self.step >= 1 and 0 <= self.offset < max(N, 1)):
            raise ArmidError(
                f"The output grid (offset {self.offset}, step {self.step}) contains none of the {N} samples.",
                remedy="give an offset below the number of samples, and a step of at least one.",
            )
        rows = len(self.rows)
        mask = np.array(self.mask, dtype=np.bool_)
        block = np.array(self.block, dtype=np.int64)
        if mask.shape != (rows, n) or block.shape != (rows,):
            raise ArmidError(
                f"`mask` and `block` must have the shapes {(rows, n)} and {(rows,)}; found {mask.shape} and "
                f"{block.shape}."
            )
        mask.setflags(write=False)
        block.setflags(write=False)
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "block", block)
        if self.repetition is not None:
            repetition = np.array(self.repetition, dtype=np.int64)
            if repetition.shape != (rows,):
                raise ArmidError(f"`repetition` must have the shape {(rows,)}; found {repetition.shape}.")
            repetition.setflags(write=False)
            object.__setattr__(self, "repetition", repetition)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Sample index of each row of the output grid, shape (M,)."""
        return np.arange(self.offset, self.motion.samples, self.step)


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class Observations:
    """Contiguous runs and the band in which torque and model are compared.

    Attributes:
        runs: The runs.
        band: Filter for torque and regressor columns, not yet applied.
        position_noise: Standard deviation of the noise of each joint's positions, shape (n,) [rad or m], if
            accelerations are computed from positions by differences; zero if velocities were recorded or if the noise
            is not known.
    """

    runs: tuple[ObservedRun, ...]
    band: Band
    position_noise: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "runs", tuple(self.runs))
        object.__setattr__(self, "position_noise", array(self.position_noise, (None,), "position_noise"))
        if len({run.motion.n for run in self.runs}) > 1:
            raise ArmidError("All runs must have the same joints.")

    @property
    def samples(self) -> int:
        """Number of rows of all runs that are used for at least one joint."""
        return sum(int(run.mask.any(axis=1).sum()) for run in self.runs)

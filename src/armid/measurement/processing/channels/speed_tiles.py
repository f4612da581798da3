"""Speeds of joints at all samples of a run, computed tile by tile when they are needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.kernel.channels.passes import speeds

TILE = 16384
"""Number of samples whose speeds are in memory at a time: 1 MB for a seven-joint arm."""


@dataclass(frozen=True, eq=False, slots=True)
class SpeedTiles:
    """Absolute speeds of joints, computed from the means of the positions before and after each sample.

    Attributes:
        q: Positions at a uniform rate, not filtered, shape (N, n) [rad or m].
        half: Number of samples of each mean.
        rate: Sample rate [Hz].
        held: Number of samples at each end that have the speed of the sample next to them. Nearer to the ends than
            `half`, a speed depends on the first or last sample alone, whose noise no mean reduces.
    """

    q: Array
    half: int
    rate: float
    held: int = 0

    def between(self, begin: int, end: int) -> Array:
        """Speeds at the samples `begin` to `end - 1`, shape (n, end - begin) [rad/s or m/s]."""
        first, last = self.held, len(self.q) - self.held
        inside = speeds(self.q, self.half, self.rate, max(begin, first), min(end, last))
        if begin >= first and end <= last:
            return inside
        return np.pad(inside, ((0, 0), (max(0, first - begin), max(0, end - last))), mode="edge")

    def tiles(self) -> Iterator[tuple[slice, Array]]:
        """Yields all samples tile by tile, as a slice and their speeds (n, samples)."""
        # The held samples belong to the tile of the sample whose speed they have.
        begin, N = 0, len(self.q)
        while begin < N:
            end = begin + TILE + self.held
            end = N if end + self.held + TILE > N else end
            yield slice(begin, end), self.between(begin, end)
            begin = end

    def rms(self) -> Array:
        """RMS speed of each joint, shape (n,) [rad/s or m/s]."""
        squares = sum((np.einsum("jt,jt->j", v, v) for _, v in self.tiles()), start=np.zeros(self.q.shape[1]))
        return np.sqrt(squares / len(self.q))

    def below(
        self, limit: Array, joints: Sequence[int] = (), together: Sequence[Array] = ()
    ) -> tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]:
        """Masks of the samples at which joints are slower than limits, which have shape (n,) each.

        Args:
            limit: Limits of single joints.
            joints: Joints that must be slower at the same time.
            together: Limits of these joints.

        Returns:
            Mask for each joint and the limits `limit`, shape (n, N); for each array of limits in `together`, mask of
            the samples at which all joints in `joints` are slower, shape (N,).
        """
        single = np.empty(self.q.shape[::-1], dtype=np.bool_)
        all_of = [np.ones(len(self.q), dtype=np.bool_) for _ in together]
        for samples, v in self.tiles():
            np.less(v, limit[:, None], out=single[:, samples])
            for result, limits in zip(all_of, together, strict=True):
                for j in joints:
                    result[samples] &= v[j] < limits[j]
        return single, all_of

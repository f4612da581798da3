"""Motion of the joints of an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.notebook_display import Displayed, Summary, spans


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Motion(Displayed):
    """Positions, velocities and accelerations of n joints at N samples.

    Attributes:
        time: Time of each sample, shape (N,) [s].
        q: Joint positions, shape (N, n) [rad or m].
        dq: Joint velocities, shape (N, n) [rad/s or m/s].
        ddq: Joint accelerations, shape (N, n) [rad/s² or m/s²].
        memory: Hysteresis states of a model at the samples, shape (N, m), computed by `DynamicsModel.remember` along
            the whole contiguous run; `None` if there are none.
        mean_over: Length of the interval around each sample over which the torque there is a mean [s]; 0 if it is
            that of an instant. Friction is averaged over it where a joint reverses.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    memory: Array | None = None
    mean_over: float = 0.0

    def __post_init__(self) -> None:
        q = array(self.q, (None, None), "q")
        object.__setattr__(self, "q", q)
        object.__setattr__(self, "time", array(self.time, (len(q),), "time"))
        object.__setattr__(self, "dq", array(self.dq, q.shape, "dq"))
        object.__setattr__(self, "ddq", array(self.ddq, q.shape, "ddq"))
        if self.memory is not None:
            object.__setattr__(self, "memory", array(self.memory, (len(q), None), "memory"))

    def summary(self) -> Summary:
        """Table of the ranges of position, velocity and acceleration of each joint."""
        rows = tuple((str(j), *row) for j, row in enumerate(spans(self.q, self.dq, self.ddq), 1))
        seconds = float(np.ptp(self.time)) if self.samples else 0.0
        return Summary(f"{self.samples} samples over {seconds:.4g} s", ("joint", "q", "dq", "ddq"), rows, "SI units")

    @classmethod
    def of_states(cls, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Motion:
        """Motion made of separate, not consecutive states (N, n); the sample times are set one second apart."""
        q = array(q, (None, None), "q")
        return cls(range(len(q)), q, dq, ddq)  # pyright: ignore[reportArgumentType]

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.time)

    @property
    def n(self) -> int:
        """Number of joints n."""
        return self.q.shape[1]

    def __getitem__(self, rows: slice) -> Motion:
        """Motion at a slice of the samples, with their hysteresis states; the arrays are not copied."""
        part = object.__new__(Motion)
        for name in ("time", "q", "dq", "ddq", "memory"):
            values = getattr(self, name)
            object.__setattr__(part, name, None if values is None else values[rows])
        object.__setattr__(part, "mean_over", self.mean_over)
        return part

    def with_means(self, seconds: float) -> Motion:
        """Motion whose torque is a mean over an interval of the given length [s] around each sample."""
        whole = self[:]
        object.__setattr__(whole, "mean_over", float(seconds))
        return whole

    def with_memory(self, memory: Array) -> Motion:
        """Motion with the given hysteresis states (N, m); the array is not copied and becomes read-only."""
        if memory.ndim != 2 or len(memory) != self.samples or memory.dtype != np.float64:
            raise ArmidError(
                f"memory must have shape ({self.samples}, any) and type float64; found {memory.shape} "
                f"of {memory.dtype}."
            )
        memory.setflags(write=False)
        whole = self[:]
        object.__setattr__(whole, "memory", memory)
        return whole

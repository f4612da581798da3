"""Motion of the joints of an arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
        sign_deviation: Filtered sign of each velocity, less its sign at the samples, shape (N, n), if the torque has
            passed a filter that the motion has not; `None` if it is the torque at the instants of the samples. Torque
            laws with a step at reversals follow it (`armid.model.terms.filtered_steps`).
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    memory: Array | None = None
    sign_deviation: Array | None = None

    def __post_init__(self) -> None:
        q = array(self.q, (None, None), "q")
        object.__setattr__(self, "q", q)
        object.__setattr__(self, "time", array(self.time, (len(q),), "time"))
        object.__setattr__(self, "dq", array(self.dq, q.shape, "dq"))
        object.__setattr__(self, "ddq", array(self.ddq, q.shape, "ddq"))
        if self.memory is not None:
            object.__setattr__(self, "memory", array(self.memory, (len(q), None), "memory"))
        if self.sign_deviation is not None:
            object.__setattr__(self, "sign_deviation", array(self.sign_deviation, q.shape, "sign_deviation"))

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
        for name in ("time", "q", "dq", "ddq", "memory", "sign_deviation"):
            values = getattr(self, name)
            object.__setattr__(part, name, None if values is None else values[rows])
        return part

    def with_sign_deviation(self, deviation: Array) -> Motion:
        """Motion with filtered signs of its velocities, less their signs, shape (N, n)."""
        return replace(self, sign_deviation=deviation)

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

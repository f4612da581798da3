"""Recording that is to be corrupted, with the motion and the dynamics of its arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

SMOOTH = 6.0
"""Band in which velocities and accelerations are computed for corruptions that depend on them [Hz]."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A recording that is to be corrupted.

    Attributes:
        raw: The recording as logged.
        reading: Its log format.
        model: Model that was identified from the clean recording.
        parameters: Its standard parameters, shape (p,).
        joint: Index of the joint that a corruption of one channel concerns.
        other: Index of a second joint.
        rng: Random numbers.
    """

    raw: Recording
    reading: LogFormat
    model: DynamicsModel
    parameters: Array
    joint: int
    other: int
    rng: np.random.Generator

    @property
    def effort(self) -> Array:
        """Effort as logged (N, n)."""
        assert self.raw.effort is not None
        return self.raw.effort

    @cached_property
    def time(self) -> Array:
        """Sample times (N,) [s]."""
        if self.raw.time is not None:
            return self.raw.time
        return np.arange(self.raw.samples) / float(self.reading.rate or self.raw.rate or 1.0)

    @cached_property
    def step(self) -> float:
        """Typical time between rows [s]."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def size(self) -> Array:
        """Standard deviation of each effort as logged (n,)."""
        return self.effort.std(axis=0)

    @cached_property
    def share(self) -> Array:
        """Share of the recording that has passed (N,), from 0 to 1."""
        return (self.time - self.time[0]) / (self.time[-1] - self.time[0])

    @cached_property
    def motion(self) -> Motion:
        """Smoothed motion in the robot's convention."""
        positions, rate = np.unwrap(self.raw.q, axis=0), 1.0 / self.step
        sign = np.broadcast_to(self.reading.position_sign, self.raw.n)
        smooth = zero_phase(butterworth(2, SMOOTH, rate), positions * sign)
        velocity = np.gradient(smooth, self.time, axis=0)
        return Motion(self.time, smooth, velocity, np.gradient(velocity, self.time, axis=0))

    def logged(self, torque: Array) -> Array:
        """Joint torque (N, n) [N·m] as this log has it: with its sign, as a current where it has currents."""
        gain = 1.0 if self.reading.drive_gain is None else np.asarray(self.reading.drive_gain)
        return torque * np.broadcast_to(self.reading.torque_sign, self.raw.n) / gain

    def one(self, values: Array | float, joint: int | None = None) -> Array:
        """Values (N,) in the column of one joint, zero elsewhere, shape (N, n)."""
        table = np.zeros(self.raw.q.shape)
        table[:, self.joint if joint is None else joint] = values
        return table

    def between(self, low: float, high: float = 1.0) -> NDArray[np.bool_]:
        """Mask of the rows between two shares of the recording, shape (N,)."""
        return (self.share >= low) & (self.share <= high)

    def with_effort(self, effort: Array) -> Recording:
        """The recording with another effort."""
        return replace(self.raw, effort=effort)

    def moved(self, warp: Callable[[Array], Array], rows: NDArray[np.bool_] | None = None) -> Recording:
        """The recording with the position and velocity of the joint as another function (N,) of the row's values."""
        changed = {}
        for name in ("q", "dq"):
            if (values := getattr(self.raw, name)) is not None:
                new = values.copy()
                column = np.unwrap(values[:, self.joint]) if name == "q" else values[:, self.joint]
                new[:, self.joint] = warp(column)
                changed[name] = new if rows is None else np.where(rows[:, None], new, values)
        return replace(self.raw, **changed)

    def late(self, column: Array, seconds: float) -> Array:
        """A column (N,) that is late by some seconds."""
        return np.interp(self.time - seconds, self.time, column)

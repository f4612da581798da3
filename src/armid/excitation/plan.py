"""Motion of a whole recording: a smooth move to the start pose, the repeated excitation, and a smooth final move.

The excitation starts and ends at rest. A move is a polynomial of the fifth degree, so the acceleration has no jumps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.excitation.fourier import Excitation, required_series
from armid.input_boundary import within
from armid.model.motion import Motion
from armid.notebook_display import Displayed, Summary

PEAKS = (1.0, 1.875, 10.0 / 3.0**0.5, 60.0)
"""Largest absolute position, velocity, acceleration and jerk of the polynomial for a move of one radian in one
second."""


def seconds_for(distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike) -> float:
    """Shortest duration [s] of a move over distances (n,) [rad or m] within limits (n,) of velocity and so on."""
    way = np.abs(np.asarray(distance, dtype=np.float64))
    limits = (velocity, acceleration, jerk)
    times = [
        (peak * way / np.asarray(limit)) ** (1.0 / order)
        for order, (peak, limit) in enumerate(zip(PEAKS[1:], limits, strict=True), 1)
    ]
    return float(np.max(times))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Plan(Displayed):
    """Excitation with its repetitions, and the moves before and after it.

    Attributes:
        excitation: The periodic motion.
        repetitions: Number of periods; there is no pause between them.
        begin: Pose from which the arm moves to the start pose, shape (n,) [rad or m]; `None` for no such move.
        end: Pose to which the arm moves after the excitation, shape (n,) [rad or m]; `None` for no such move.
        lead_in: Duration of the move to the start pose [s].
        lead_out: Duration of the move after the excitation [s].
    """

    excitation: Excitation
    repetitions: int = 1
    begin: Array | None = None
    end: Array | None = None
    lead_in: float = 0.0
    lead_out: float = 0.0

    def __post_init__(self) -> None:
        required_series(self.excitation)
        if self.repetitions < 1:
            raise ArmidError(
                f"A plan needs at least one repetition of its excitation; found {self.repetitions}.",
                remedy="give repetitions of 1 or more.",
            )
        for name, seconds in (("begin", self.lead_in), ("end", self.lead_out)):
            pose = getattr(self, name)
            if pose is not None:
                object.__setattr__(self, name, array(pose, (self.excitation.n,), name))
            if (pose is None) != (seconds == 0.0) or seconds < 0.0:
                raise ArmidError(
                    f"A move before or after the excitation needs a pose and a duration above zero; {name!r} has "
                    f"{'no pose' if pose is None else 'a pose'} and {seconds} s.",
                    remedy=f"give both for {name!r}, or neither.",
                )

    def summary(self) -> Summary:
        """Summary of the excitation, with the number of repetitions and the total duration."""
        summary = self.excitation.summary()
        often = "once" if self.repetitions == 1 else f"{self.repetitions} times"
        return replace(summary, title=f"{summary.title}, {often}; {self.duration:.4g} s in all")

    @property
    def duration(self) -> float:
        """Total duration [s]."""
        return self.lead_in + self.repetitions * self.excitation.period + self.lead_out

    @property
    def start(self) -> Array:
        """Pose in which the excitation begins and ends, shape (n,) [rad or m]."""
        return self.excitation.at([0.0]).q[0]

    def at(self, time: ArrayLike) -> Motion:
        """Motion at times (N,) [s] from the beginning of the plan; before and after the plan the arm is at rest."""
        t = array(time, (None,), "time")
        q, dq, ddq = (np.zeros((len(t), self.excitation.n)) for _ in range(3))
        last = self.duration - self.lead_out
        inside = (t >= self.lead_in) & (t <= last)
        series = self.excitation.at(t[inside] - self.lead_in)
        q[inside], dq[inside], ddq[inside] = series.q, series.dq, series.ddq
        start = self.start
        begin = start if self.begin is None else self.begin
        end = start if self.end is None else self.end
        for part, since, seconds, a, b in (
            (t < self.lead_in, 0.0, self.lead_in, begin, start),
            (t > last, last, self.lead_out, start, end),
        ):
            s = np.clip((t[part] - since) / seconds, 0.0, 1.0) if seconds else np.ones(int(part.sum()))
            seconds = seconds or 1.0
            q[part] = a + np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), b - a)
            dq[part] = np.outer(30.0 * s**2 * (1.0 - s) ** 2 / seconds, b - a)
            ddq[part] = np.outer(60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / seconds**2, b - a)
        return Motion(t, q, dq, ddq)

    def sample(self, rate: float) -> Motion:
        """Samples of the whole plan at a rate [Hz], including both ends."""
        within("motion", self.duration * rate, f"The plan of {self.duration:.4g} s at {rate:.4g} Hz")
        return self.at(np.arange(int(np.floor(self.duration * rate + 1e-9)) + 1) / rate)

    def rehearsal(self, speed: float) -> Plan:
        """Plan along the same path with one repetition and reduced speed, for a trial before the plan itself.

        Args:
            speed: Factor of the speed, above 0 and at most 1. Velocities are multiplied by this factor, accelerations
                by its square.
        """
        if not 0.0 < speed <= 1.0:
            raise ArmidError(
                f"The speed of a rehearsal must be above 0 and at most 1; found {speed}.",
                remedy="give for instance 0.2 for a fifth of the planned speed.",
            )
        return replace(
            self,
            excitation=self.excitation.stretched(self.excitation.period / speed),
            repetitions=1,
            lead_in=self.lead_in / speed,
            lead_out=self.lead_out / speed,
        )

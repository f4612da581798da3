"""Observer of the external torque: difference between the torque of the model and the measured torque, both filtered.

Positions (or recorded velocities) and torque pass the same causal filter of two equal first-order stages, so that
they have the same delay. Velocity and acceleration follow from the states of the stages without difference quotients.
There are two kinds of observers:

- `momentum`: the generalised momentum p = M(q) q̇ gives r = K (p - ∫(τ + ∂T/∂q - g - τ_f + r) dt) [DeLuca2005]. Over a
  step h, the increment of p without the work of ∂T/∂q is M Δq̇ + h C q̇ at the middle of the step (midpoint rule), so
  one call of inverse dynamics at the middle, with Δq̇/h as acceleration, and a first-order filter with the gain K are
  the same observer; neither the derivative of the mass matrix nor an integral that drifts is needed.
- `residual`: inverse dynamics of the filtered motion minus filtered torque.

Both have a mean delay of 2/gain. The external torque is positive if it accelerates the joint in positive direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, did_you_mean
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

OBSERVERS = ("momentum", "residual")
"""Kinds of observers."""

GAIN = 100.0
"""Default gain K [1/s]: the delay of the observer is 20 ms, and its step response reaches 90 % after 35 ms."""

GAIN_PER_RATE = 0.5
"""Largest ratio of the gain [1/s] to the sample rate [Hz]. With a larger gain, the time constants of the filters
would be shorter than two samples."""

LEAST_GAIN = 10.0
"""Smallest gain that a user may give [1/s]; with this gain, the observer settles within the time `SETTLED`."""

SLOW = 10.0
"""Corner of the high-pass that gives the change of the torque of the model [1/s]; the effect of a reversal lasts
about 0.1 s."""

SETTLED = 1.0
"""Time after the start of a log or after a gap in which the observer settles and gives no alarms [s]."""


@dataclass(frozen=True, slots=True)
class ObserverOptions:
    """Options of an observer.

    Attributes:
        kind: `momentum` or `residual`.
        gain: Gain K [1/s]; the delay of the observer is 2/K. `None` for the smaller of `GAIN` and half the sample
            rate.
    """

    kind: Literal["momentum", "residual"] = "momentum"
    gain: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in OBSERVERS:
            raise ArmidError(
                f"Unknown observer {self.kind!r}.",
                possible=", ".join(OBSERVERS),
                remedy=did_you_mean(self.kind, OBSERVERS),
            )
        if self.gain is not None and not LEAST_GAIN <= self.gain < np.inf:
            raise ArmidError(
                f"The gain of the observer must be at least {LEAST_GAIN:g} 1/s, because it has not settled otherwise "
                f"when alarms begin; found {self.gain}.",
                remedy="give for instance --gain 50.",
            )

    def gain_at(self, rate: float) -> float:
        """Gain K of the observer [1/s] at a sample rate [Hz]: the stated gain, or the default.

        Raises:
            ArmidError: The stated gain is too high for the rate, or the rate is so low that no gain is possible.
        """
        highest = GAIN_PER_RATE * rate
        if highest < LEAST_GAIN * (1.0 - 1e-6):
            raise ArmidError(
                f"The observer needs samples at {LEAST_GAIN / GAIN_PER_RATE:g} Hz or more; found {rate:.5g} Hz.",
                remedy="record at a higher rate.",
            )
        if self.gain is not None and self.gain > highest * (1.0 + 1e-6):
            raise ArmidError(
                f"A gain of {self.gain:g} 1/s is too high for samples at {rate:.5g} Hz.",
                possible=f"at most {highest:.4g} 1/s",
                remedy="give a smaller --gain, or record at a higher rate.",
            )
        return min(GAIN, highest) if self.gain is None else self.gain

    def stage_at(self, rate: float) -> float:
        """Corner [1/s] of each stage of the filter of motion and torque, at a sample rate [Hz]."""
        return self.gain_at(rate) * (2.0 if self.kind == "momentum" else 1.0)


@dataclass(frozen=True, slots=True)
class LowPassStage:
    """First-order low-pass ẏ = ω (u - y), exact for an input that is linear between samples.

    y_k = decay · y_(k-1) + old · u_(k-1) + new · u_k

    Attributes:
        decay: Factor of the last output.
        old: Factor of the last input.
        new: Factor of the new input.
    """

    decay: float
    old: float
    new: float

    @classmethod
    def of(cls, corner: float, rate: float) -> LowPassStage:
        """Filter stage with a corner ω [1/s] for a sample rate [Hz]."""
        x = corner / rate
        decay = float(np.exp(-x))
        mean = -float(np.expm1(-x)) / x
        return cls(decay, mean - decay, 1.0 - mean)

    def along(self, u: Array) -> Array:
        """Filters an input (N, n), which counts as constant before its first sample; output of shape (N, n)."""
        from scipy.signal import lfilter

        start = (self.old + self.decay) * u[:1]
        return lfilter([self.new, self.old], [1.0, -self.decay], u, axis=0, zi=start)[0]


@dataclass(frozen=True, eq=False, slots=True)
class Observed:
    """Estimated external torque along N samples of n joints, and the quantities on which its threshold depends.

    Attributes:
        time: Times, shape (N,) [s].
        rate: Sample rate [Hz].
        q: Filtered positions, shape (N, n) [rad or m].
        dq: Filtered velocities, shape (N, n) [rad/s or m/s].
        external: Estimated external torque, shape (N, n) [N·m or N].
        change: Torque of the model after a high-pass, shape (N, n) [N·m or N].
        usable: Mask of samples at which alarms are possible, shape (N, n): false while the observer settles, and
            while samples that are not valid are in the filter.
        velocity: True if recorded velocities were used.
    """

    time: Array
    rate: float
    q: Array
    dq: Array
    external: Array
    change: Array
    usable: NDArray[np.bool_]
    velocity: bool = False


def filtered_motion(options: ObserverOptions, time: Array, rate: float, q: Array, dq: Array | None) -> Motion:
    """Motion after the causal filter of an observer.

    Args:
        options: Kind and gain of the observer.
        time: Times, shape (N,) [s].
        rate: Sample rate [Hz].
        q: Positions, shape (N, n) [rad or m].
        dq: Recorded velocities, shape (N, n); if `None`, velocities follow from the positions.
    """
    corner = options.stage_at(rate)
    stage = LowPassStage.of(corner, rate)
    first = stage.along(q)
    second = stage.along(first)
    if dq is None:
        return Motion(time, second, corner * (first - second), corner**2 * (q - 2.0 * first + second))
    one = stage.along(dq)
    two = stage.along(one)
    return Motion(time, second, two, corner * (one - two))


def at_middle(motion: Motion) -> Motion:
    """Motion at the middle of each of the N - 1 steps between N samples.

    The acceleration is the difference of the velocities at both ends of the step, divided by its duration.
    """
    step = np.diff(motion.time)[:, None]
    q, dq = (0.5 * (x[1:] + x[:-1]) for x in (motion.q, motion.dq))
    return Motion(motion.time[1:], q, dq, np.diff(motion.dq, axis=0) / step)


def external_torque_along(
    model: DynamicsModel,
    parameters: Array,
    options: ObserverOptions,
    *,
    rate: float,
    q: Array,
    dq: Array | None,
    torque: Array,
    start: float = 0.0,
    bad: NDArray[np.bool_] | None = None,
) -> Observed:
    """Computes the external torque along a log with a uniform sample rate; `LiveMonitor` gives the same values.

    Args:
        model: Arm and torque terms.
        parameters: Standard parameters, shape (p,).
        options: Kind and gain.
        rate: Sample rate [Hz].
        q: Positions, shape (N, n) [rad or m].
        dq: Recorded velocities, shape (N, n); `None` if there are none.
        torque: Measured torque, shape (N, n) [N·m or N].
        start: Time of the first sample [s].
        bad: Mask of samples that are not valid, shape (N, n); while they are in the filter, alarms are not possible.
    """
    time = start + np.arange(len(q)) / rate
    stage = LowPassStage.of(options.stage_at(rate), rate)
    motion = filtered_motion(options, time, rate, q, dq)
    measured = stage.along(stage.along(torque))
    if options.kind == "momentum":
        last = LowPassStage.of(options.gain_at(rate), rate)
        middle = model.torque(_with_states(model, at_middle(motion)), parameters)
        predicted = _step_filter(np.concatenate([middle[:1], middle]), last.decay)
        halfway = np.concatenate([measured[:1], 0.5 * (measured[1:] + measured[:-1])])
        measured = _step_filter(halfway, last.decay)
    else:
        predicted = model.torque(_with_states(model, motion), parameters)
    slow = _step_filter(predicted, float(np.exp(-SLOW / rate)))
    usable = np.ones(q.shape, dtype=np.bool_)
    settled = int(np.ceil(SETTLED * rate))
    usable[:settled] = False
    if bad is not None and bad.any():
        usable &= ~_spread(bad, int(np.ceil(0.5 * SETTLED * rate)))
    external, change = predicted - measured, predicted - slow
    return Observed(time, rate, motion.q, motion.dq, external, change, usable, dq is not None)


def _with_states(model: DynamicsModel, motion: Motion) -> Motion:
    """Adds hysteresis states to a motion; they start at the first positions, as in a monitor that runs live."""
    if not model.nodes:
        return motion
    motion, known = model.remembered(motion)
    assert motion.memory is not None
    states = motion.memory.copy()
    for k, node in enumerate(model.nodes):
        drive = motion.q[:, [j for j, _ in node.coordinate]] @ np.array([weight for _, weight in node.coordinate])
        z = float(drive[0])
        for i in range(int(known[k])):
            z = min(max(z, float(drive[i]) - node.memory.width), float(drive[i]) + node.memory.width)
            states[i, k] = z
    return motion.with_memory(states)


def _step_filter(u: Array, decay: float) -> Array:
    """First-order low-pass y_k = decay · y_(k-1) + (1 - decay) · u_k of values (N, n), with y_0 = u_0."""
    from scipy.signal import lfilter

    return lfilter([1.0 - decay], [1.0, -decay], u, axis=0, zi=decay * u[:1])[0]


def _spread(bad: NDArray[np.bool_], after: int) -> NDArray[np.bool_]:
    """Mask (N, n) that is true at each true sample of `bad` and at the `after` samples that follow it."""
    sums = np.cumsum(bad, axis=0)
    before = np.concatenate([np.zeros((min(after, len(bad)), bad.shape[1]), dtype=sums.dtype), sums[:-after]])
    return sums - before > 0

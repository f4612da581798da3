"""Monitor that processes one sample at a time, for a running controller.

The monitor is created once and then called for each sample:

    live = LiveMonitor(make_monitor(load_run("runs/arm"), false_alarms=1.0), rate=1000.0)
    sample = live.update(q, tau)  # for each sample
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.runs.callable_model import CallableMemory, CallableModel
from armid.runs.monitoring.monitor import Monitor, require_rate
from armid.runs.monitoring.observer import SETTLED, SLOW, LowPassStage
from armid.runs.monitoring.thresholds import AFTER_REST, REST_SPEED, REST_TIME
from armid.runs.monitoring.tip_wrench import TipWrench, tip_wrench

LONG_AGO = 10**6
"""Largest counted number of samples since a joint was at rest; after so many samples, the allowance for dry friction
is zero."""


class Sample(NamedTuple):
    """External torque and thresholds after one sample.

    Attributes:
        external: External torque of each joint, shape (n,) [N·m or N].
        threshold: Threshold of the absolute external torque of each joint, shape (n,) [N·m or N].
        exceeded: Mask of the joints whose external torque exceeds the threshold, shape (n,); false for all joints
            while the observer settles.
    """

    external: Array
    threshold: Array
    exceeded: NDArray[np.bool_]

    @property
    def alarm(self) -> bool:
        """True if the external torque of at least one joint exceeds its threshold."""
        return bool(self.exceeded.any())


class _Constants(NamedTuple):
    """Constants of the filters and counters of a monitor at its sample rate.

    Attributes:
        corner: Corner of each stage of the filter of motion and torque [1/s].
        stage: Stage of this filter.
        decay: Factor of the last output in the filter of the momentum observer; 0 for the other observer.
        momentum: True for the momentum observer.
        forgets: Factor of the last output in the low-pass from which the change of the torque follows.
        settled: Number of samples until the observer has settled.
        rest: Number of slow samples from which a joint counts as resting.
    """

    corner: float
    stage: LowPassStage
    decay: float
    momentum: bool
    forgets: float
    settled: int
    rest: int


@dataclass(slots=True)
class _State:
    """State of the observer and of the counters after some samples; arrays have one value per joint.

    Attributes:
        count: Number of samples.
        filtered: Last input, and outputs of the first and of the second stage, of the filter of motion and torque.
        last: Filtered position, velocity and measured torque of the last sample.
        both: Predicted and measured torque after the filter of the momentum observer, shape (n,) each [N·m or N].
        slow: Torque of the model after the low-pass from which its change follows, shape (n,) [N·m or N].
        slow_steps: Number of consecutive samples with a speed below `REST_SPEED`, shape (n,).
        since_rest: Number of samples since the last rest, shape (n,).
        position: Filtered positions, shape (n,) [rad or m].
        memory: Hysteresis states; `None` before the first sample or without hysteresis.
    """

    count: int
    filtered: tuple[Array, Array, Array]
    last: tuple[Array, Array, Array]
    both: tuple[Array, Array]
    slow: Array
    slow_steps: NDArray[np.int64]
    since_rest: NDArray[np.int64]
    position: Array
    memory: CallableMemory | None = None

    @classmethod
    def empty(cls, n: int, rest: int) -> _State:
        """State before the first sample of n joints; `rest` is the number of slow samples that counts as a rest."""
        zero = np.zeros(n)
        three = (zero, zero, zero)
        return cls(0, three, three, (zero, zero), zero, np.full(n, rest), np.full(n, LONG_AGO), zero)


class LiveMonitor:
    """Observer and thresholds of a monitor, sample by sample; only one thread may use it at a time.

    Args:
        monitor: Monitor of a run.
        rate: Sample rate of the calls of `update` [Hz]; samples must be evenly spaced.

    Raises:
        ArmidError: The rate differs from that of the thresholds, or the gain is too high for it.
    """

    def __init__(self, monitor: Monitor, rate: float) -> None:
        require_rate(monitor.rate, rate)
        self.monitor, self.rate = monitor, rate
        self._model = CallableModel.of(monitor.run)
        corner, momentum = monitor.options.stage_at(rate), monitor.options.kind == "momentum"
        self._constants = _Constants(
            corner,
            LowPassStage.of(corner, rate),
            LowPassStage.of(monitor.options.gain_at(rate), rate).decay if momentum else 0.0,
            momentum,
            float(np.exp(-SLOW / rate)),
            int(np.ceil(SETTLED * rate)),
            int(np.ceil(REST_TIME * rate)),
        )
        self.reset()

    def reset(self) -> None:
        """Returns to the state before the first sample, for instance after a gap; the observer settles again."""
        self._state = _State.empty(len(self._model.joints), self._constants.rest)

    def update(self, q: ArrayLike, torque: ArrayLike, dq: ArrayLike | None = None) -> Sample:
        """Processes a new sample, and returns external torque and thresholds.

        Args:
            q: Measured positions, shape (n,) [rad or m].
            torque: Measured torque, shape (n,) [N·m or N].
            dq: Measured velocities, shape (n,) [rad/s or m/s]; required if the thresholds were computed from
                recordings with velocities, otherwise not allowed.

        Raises:
            ArmidError: A shape is wrong, values are not finite, or velocities are missing or not allowed; the state
                of the observer does not change.
        """
        n = len(self._model.joints)
        u = array(q, (n,), "q")
        tau = array(torque, (n,), "torque")
        v = None if dq is None else array(dq, (n,), "dq")
        if (v is not None) != self.monitor.velocity:
            raise ArmidError(
                f"Velocities are {'missing' if v is None else 'given'}, but the recordings from which the thresholds "
                f"come have {'some' if v is None else 'none'}.",
                remedy="give the quantities that the recordings have.",
            )
        corner, state = self._constants.corner, self._state
        one, two = self._twice(np.array([u, tau] if v is None else [u, tau, v]))
        first, second, measured = one[0], two[0], two[1]
        if v is None:
            velocity, acceleration = corner * (first - second), corner**2 * (u - 2.0 * first + second)
        else:
            velocity, acceleration = two[2], corner * (one[2] - two[2])
        predicted, measured = self._torques(second, velocity, acceleration, measured)
        if state.count == 0:
            state.slow = predicted
        state.slow = self._constants.forgets * state.slow + (1.0 - self._constants.forgets) * predicted
        threshold = self._threshold(velocity, predicted - state.slow)
        external = predicted - measured
        state.position = second
        state.count += 1
        ready = state.count > self._constants.settled
        return Sample(external, threshold, (np.abs(external) > threshold) & ready)

    def wrench(self, sample: Sample) -> TipWrench:
        """Wrench at the tip that explains the external torque of `sample`, the result of the last `update`."""
        covariance = self.monitor.thresholds.covariance
        return tip_wrench(self.monitor.run.robot, self._state.position, sample.external, covariance)

    def _twice(self, u: Array) -> tuple[Array, Array]:
        """Filters a new sample of k quantities; input and outputs of first and second stage have the shape (k, n)."""
        stage, state = self._constants.stage, self._state
        before, first, second = (u, u, u) if state.count == 0 else state.filtered
        new = stage.decay * first + stage.old * before + stage.new * u
        out = stage.decay * second + stage.old * first + stage.new * new
        state.filtered = (u, new, out)
        return new, out

    def _torques(self, q: Array, dq: Array, ddq: Array, measured: Array) -> tuple[Array, Array]:
        """Predicted and measured torque after the filter of the observer, shape (n,) each [N·m or N].

        Args:
            q: Filtered positions, shape (n,) [rad or m].
            dq: Filtered velocities, shape (n,) [rad/s or m/s].
            ddq: Filtered accelerations, shape (n,) [rad/s² or m/s²].
            measured: Filtered measured torque, shape (n,) [N·m or N].
        """
        state = self._state
        if not self._constants.momentum:
            return self._inverse_dynamics(q, dq, ddq), measured
        if state.count == 0:
            state.last = (q, dq, measured)
            state.both = (np.zeros_like(q), measured)
            return self._inverse_dynamics(q, dq, ddq), measured
        q_before, dq_before, before = state.last
        state.last = (q, dq, measured)
        step = (dq - dq_before) * self.rate
        predicted = self._inverse_dynamics(0.5 * (q + q_before), 0.5 * (dq + dq_before), step)
        if state.count == 1:
            state.both = (predicted, state.both[1])
            state.slow = predicted
        decay, halfway = self._constants.decay, 0.5 * (measured + before)
        state.both = (
            decay * state.both[0] + (1.0 - decay) * predicted,
            decay * state.both[1] + (1.0 - decay) * halfway,
        )
        return state.both

    def _inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        state = self._state
        if not self._model.memories:
            return self._model.torque(q, dq, ddq)
        if state.memory is None or state.count == 0 or (self._constants.momentum and state.count == 1):
            state.memory = self._model.memory(q)
        else:
            state.memory.update(q)
        return self._model.torque(q, dq, ddq, state.memory)

    def _threshold(self, dq: Array, change: Array) -> Array:
        """Thresholds of all joints after a new sample, shape (n,) [N·m or N].

        Args:
            dq: Filtered velocities, shape (n,) [rad/s or m/s].
            change: Torque of the model after a high-pass, shape (n,) [N·m or N].
        """
        found, state = self.monitor.thresholds, self._state
        state.slow_steps = np.where(np.abs(dq) < REST_SPEED, state.slow_steps + 1, 0)
        resting = state.slow_steps >= self._constants.rest
        state.since_rest = np.where(resting, 0, np.minimum(state.since_rest + 1, LONG_AGO))
        weight = np.exp(-AFTER_REST / self.rate * state.since_rest)
        a = found.scale
        scale = np.sqrt(a[:, 0] + a[:, 1] * change**2 + a[:, 2] * dq**2)
        return found.factor * scale + found.friction * weight

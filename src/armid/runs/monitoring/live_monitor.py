"""Monitor that takes one sample at a time, for a running controller.

live = LiveMonitor(make_monitor(load_run("runs/arm"), false_alarms=1.0), rate=1000.0)
seen = live.update(q, tau)  # for each sample
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
"""Number of samples since a rest above which they are not counted, because the allowance has long vanished."""


class Sample(NamedTuple):
    """External torque and thresholds after one sample.

    Attributes:
        external: External torque, shape (n,) [N·m or N].
        threshold: Threshold, shape (n,) [N·m or N].
        exceeded: True for joints whose external torque exceeds the threshold, shape (n,); never while the observer
            settles.
    """

    external: Array
    threshold: Array
    exceeded: NDArray[np.bool_]

    @property
    def alarm(self) -> bool:
        """True if a joint exceeds its threshold."""
        return bool(self.exceeded.any())


class _Constants(NamedTuple):
    """Constants of a monitor at a sample rate."""

    corner: float
    stage: LowPassStage
    decay: float
    momentum: bool
    forgets: float
    settled: int
    rest: int


@dataclass(slots=True)
class _State:
    """State after `count` samples; values of joints (n,), and of the filter for each quantity."""

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
        """State before the first sample of n joints."""
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
        """Forgets all samples, for instance after a gap; the observer settles anew."""
        self._state = _State.empty(len(self._model.joints), self._constants.rest)

    def update(self, q: ArrayLike, torque: ArrayLike, dq: ArrayLike | None = None) -> Sample:
        """External torque and thresholds after a new sample.

        Args:
            q: Measured positions, shape (n,) [rad or m].
            torque: Measured torque, shape (n,) [N·m or N].
            dq: Measured velocities, shape (n,), if the recordings have them from which the thresholds come.

        Raises:
            ArmidError: A shape is wrong, or values are not finite; the observer is as before.
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
        """Wrench at the tip that explains the external torque of the last sample."""
        covariance = self.monitor.thresholds.covariance
        return tip_wrench(self.monitor.run.robot, self._state.position, sample.external, covariance)

    def _twice(self, u: Array) -> tuple[Array, Array]:
        """Values (k, n) of k quantities after one and after two stages of the filter."""
        stage, state = self._constants.stage, self._state
        before, first, second = (u, u, u) if state.count == 0 else state.filtered
        new = stage.decay * first + stage.old * before + stage.new * u
        out = stage.decay * second + stage.old * first + stage.new * new
        state.filtered = (u, new, out)
        return new, out

    def _torques(self, q: Array, dq: Array, ddq: Array, measured: Array) -> tuple[Array, Array]:
        """Predicted and measured torque (n,) after the filters of the observer."""
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
        """Thresholds (n,) for a velocity and a change of the torque of the model, each (n,)."""
        found, state = self.monitor.thresholds, self._state
        state.slow_steps = np.where(np.abs(dq) < REST_SPEED, state.slow_steps + 1, 0)
        resting = state.slow_steps >= self._constants.rest
        state.since_rest = np.where(resting, 0, np.minimum(state.since_rest + 1, LONG_AGO))
        weight = np.exp(-AFTER_REST / self.rate * state.since_rest)
        a = found.scale
        scale = np.sqrt(a[:, 0] + a[:, 1] * change**2 + a[:, 2] * dq**2)
        return found.factor * scale + found.friction * weight

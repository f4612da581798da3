"""Monitor that takes one sample at a time, for a running controller.

live = LiveMonitor(make_monitor(load_run("runs/arm"), false_alarms=1.0), rate=1000.0)
seen = live.update(q, tau)  # for each sample
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.runs.callable_model import CallableModel
from armid.runs.monitoring.monitor import Monitor
from armid.runs.monitoring.observer import SETTLED, SLOW, Stage
from armid.runs.monitoring.thresholds import AFTER_REST, REST_SPEED, REST_TIME
from armid.runs.monitoring.tip_wrench import TipWrench, tip_wrench

RATE_RATIO = 1.1
"""Largest ratio of the sample rate to that of the unseen motion, and its inverse; other noise passes otherwise."""


class Sample(NamedTuple):
    """What a monitor knows after one sample.

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


class LiveMonitor:
    """Observer and thresholds of a monitor, sample by sample; only one thread may use it at a time.

    Args:
        monitor: Monitor of a run.
        rate: Sample rate of the calls of `update` [Hz]; samples must be evenly spaced.

    Raises:
        ArmidError: The rate differs from that of the thresholds, or the gain is too high for it.
    """

    def __init__(self, monitor: Monitor, rate: float) -> None:
        if not 1.0 / RATE_RATIO <= rate / monitor.rate <= RATE_RATIO:
            raise ArmidError(
                f"The samples come at {rate:g} Hz, but the thresholds are for {monitor.rate:.5g} Hz.",
                remedy="make the monitor with reference recordings at this rate.",
            )
        self.monitor, self.rate = monitor, rate
        self._model = CallableModel.of(monitor.run)
        self._corner = monitor.options.stage_at(rate)
        self._stage = Stage.of(self._corner, rate)
        momentum = monitor.options.kind == "momentum"
        self._decay = Stage.of(monitor.options.gain_at(rate), rate).decay if momentum else 0.0
        self._momentum, self._forgets = momentum, float(np.exp(-SLOW / rate))
        self._settled, self._rest = int(np.ceil(SETTLED * rate)), int(np.ceil(REST_TIME * rate))
        self.reset()

    def reset(self) -> None:
        """Forgets all samples, for instance after a gap; the observer settles anew."""
        self.count = 0

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
        corner = self._corner
        one, two = self._twice(np.array([u, tau] if v is None else [u, tau, v]))
        first, second, measured = one[0], two[0], two[1]
        if v is None:
            velocity, acceleration = corner * (first - second), corner**2 * (u - 2.0 * first + second)
        else:
            velocity, acceleration = two[2], corner * (one[2] - two[2])
        predicted, measured = self._torques(second, velocity, acceleration, measured)
        if self.count == 0:
            self._slow = predicted
            self._slow_steps, self._since_rest = np.full(n, self._rest), np.full(n, 10**6)
        self._slow = self._forgets * self._slow + (1.0 - self._forgets) * predicted
        threshold = self._threshold(velocity, predicted - self._slow)
        external = predicted - measured
        self._position = second
        self.count += 1
        ready = self.count > self._settled
        return Sample(external, threshold, (np.abs(external) > threshold) & ready)

    def wrench(self, sample: Sample) -> TipWrench:
        """Wrench at the tip that explains the external torque of the last sample."""
        covariance = self.monitor.thresholds.covariance
        return tip_wrench(self.monitor.run.robot, self._position, sample.external, covariance)

    def _twice(self, u: Array) -> tuple[Array, Array]:
        """Values (k, n) of k quantities after one and after two stages of the filter."""
        stage = self._stage
        before, first, second = (u, u, u) if self.count == 0 else self._filtered
        new = stage.decay * first + stage.old * before + stage.new * u
        out = stage.decay * second + stage.old * first + stage.new * new
        self._filtered = (u, new, out)
        return new, out

    def _torques(self, q: Array, dq: Array, ddq: Array, measured: Array) -> tuple[Array, Array]:
        """Predicted and measured torque (n,) after the filters of the observer."""
        if not self._momentum:
            return self._inverse_dynamics(q, dq, ddq), measured
        if self.count == 0:
            self._last = (q, dq, measured)
            self._both = (np.zeros_like(q), measured)
            return self._inverse_dynamics(q, dq, ddq), measured
        q_before, dq_before, before = self._last
        self._last = (q, dq, measured)
        step = (dq - dq_before) * self.rate
        predicted = self._inverse_dynamics(0.5 * (q + q_before), 0.5 * (dq + dq_before), step)
        if self.count == 1:
            self._both = (predicted, self._both[1])
            self._slow = predicted
        decay, halfway = self._decay, 0.5 * (measured + before)
        self._both = (
            decay * self._both[0] + (1.0 - decay) * predicted,
            decay * self._both[1] + (1.0 - decay) * halfway,
        )
        return self._both

    def _inverse_dynamics(self, q: Array, dq: Array, ddq: Array) -> Array:
        if not self._model.memories:
            return self._model.torque(q, dq, ddq)
        if self.count == 0 or (self._momentum and self.count == 1):
            self._memory = self._model.memory(q)
        else:
            self._memory.update(q)
        return self._model.torque(q, dq, ddq, self._memory)

    def _threshold(self, dq: Array, change: Array) -> Array:
        """Thresholds (n,) for a velocity and a change of the torque of the model, each (n,)."""
        found = self.monitor.thresholds
        self._slow_steps = np.where(np.abs(dq) < REST_SPEED, self._slow_steps + 1, 0)
        resting = self._slow_steps >= self._rest
        self._since_rest = np.where(resting, 0, np.minimum(self._since_rest + 1, 10**6))
        weight = np.exp(-AFTER_REST / self.rate * self._since_rest)
        a = found.scale
        scale = np.sqrt(a[:, 0] + a[:, 1] * change**2 + a[:, 2] * dq**2)
        return found.factor * scale + found.friction * weight

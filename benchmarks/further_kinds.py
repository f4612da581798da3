"""Kinds of corruption that were written after the checks of the doctor, and run once before anything was mended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.recording import Recording
from corruption_kinds import CLOCK, GAIN, LATE, LAW, MIDWAY, ORDER, SIGN, UNIT, WARMING, ZERO, Kind
from corruption_scene import Scene
from corruptions import added, payload, position_as, rows_taken, standardised, torque_as


def averaged(s: Scene, column: Array, seconds: float) -> Array:
    """Mean of a column (N,) over the last seconds."""
    count = max(2, round(seconds / s.step))
    padded = np.concatenate([np.full(count - 1, column[0]), column])
    return np.convolve(padded, np.full(count, 1.0 / count), mode="valid")


def bit_stuck(s: Scene) -> Recording:
    """Position of an encoder of 4096 counts whose bit for 64 counts (0.1 rad) is always zero."""
    counts = np.round(s.raw.q[:, s.joint] / (2.0 * np.pi) * 4096.0).astype(np.int64)
    position = (counts & ~64) * 2.0 * np.pi / 4096.0
    return replace(s.raw, q=s.raw.q + s.one(position - s.raw.q[:, s.joint]))


def wrapped(s: Scene) -> Recording:
    """Position that is a turn further above its median, as that of an encoder of one turn."""
    q = s.raw.q[:, s.joint]
    return replace(s.raw, q=s.raw.q - s.one(np.where(q > np.median(q), 2.0 * np.pi, 0.0)))


def neighbours_swapped(s: Scene) -> np.ndarray:
    """Rows of which every tenth stands after the next one."""
    rows = np.arange(s.raw.samples)
    first = np.arange(5, len(rows) - 1, 10)
    rows[first], rows[first + 1] = first + 1, first
    return rows


def velocity_clipped(s: Scene) -> Recording:
    """Velocity that is clipped at a third of its range; it is added where the log has none."""
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n)
    dq = (s.motion.dq * sign if s.raw.dq is None else s.raw.dq).copy()
    dq[:, s.joint] = np.clip(dq[:, s.joint], dq[:, s.joint].min() / 3.0, dq[:, s.joint].max() / 3.0)
    return replace(s.raw, dq=dq)


def one_weightless(s: Scene) -> Recording:
    """Torque of one joint from which the controller took the weight."""
    weight = s.logged(s.model.gravity_torque(s.motion.q, s.parameters))
    return s.with_effort(s.effort - s.one(weight[:, s.joint]))


def overflowed(s: Scene, column: Array) -> Array:
    """Column (N,) whose number overflows at three fifths of its largest amount."""
    end = 0.6 * np.abs(column).max()
    return (column + end) % (2.0 * end) - end


def milliseconds_since(s: Scene) -> Recording:
    """Stamps whose steps are in milliseconds in the second half."""
    steps = np.diff(s.time, prepend=s.time[0]) * np.where(s.between(0.5), 1000.0, 1.0)
    return replace(s.raw, time=s.time[0] + np.cumsum(steps))


FURTHER: tuple[Kind, ...] = (
    Kind(
        "further",
        "torque without frequencies above 1 Hz",
        torque_as(lambda s, x: zero_phase(butterworth(2, 1.0, 1.0 / s.step), x[:, None])[:, 0]),
        ("filtered-before-logging", *LATE, "channel-coarse"),
        True,
    ),
    Kind(
        "further",
        "mean of a torque over 0.3 s",
        torque_as(lambda s, x: averaged(s, x, 0.3)),
        ("filtered-before-logging", *LATE),
        True,
    ),
    Kind(
        "further",
        "bit of an encoder stuck",
        bit_stuck,
        ("spikes", "channel-coarse", "velocity-mismatch", "channel-noisy", *MIDWAY),
        True,
    ),
    Kind("further", "position a turn off above its median", wrapped, ("position-wrapped", "spikes", *MIDWAY), True),
    Kind(
        "further",
        "torque new four times a second",
        torque_as(lambda s, x: x[np.arange(len(x)) // (k := max(2, round(0.25 / s.step))) * k]),
        (*LATE, "rows-repeated", "channel-coarse"),
        True,
    ),
    Kind(
        "further",
        "friction that falls with speed",
        added(
            lambda s: 0.8 * np.tanh(s.motion.dq / 0.02)[:, s.joint] * np.exp(-((s.motion.dq[:, s.joint] / 0.1) ** 2))
        ),
        LAW,
        True,
    ),
    Kind("further", "offset of a torque settles", added(lambda s: 1.5 * np.exp(-4.0 * s.share)), WARMING, True),
    Kind(
        "further",
        "offset of all torques settles",
        added(lambda s: 1.0 * np.exp(-4.0 * s.share)[:, None], whole=True),
        WARMING,
    ),
    Kind(
        "further",
        "every tenth row after the next one",
        rows_taken(neighbours_swapped, evenly=True),
        (*CLOCK, "spikes"),
    ),
    Kind("further", "velocity clipped at a third", velocity_clipped, ("velocity-mismatch", "saturation"), True),
    Kind("further", "torques one joint onward", lambda s: s.with_effort(np.roll(s.effort, 1, axis=1)), ORDER),
    Kind(
        "further",
        "position drifts by 0.3 rad",
        lambda s: replace(s.raw, q=s.raw.q + s.one(0.3 * s.share)),
        (*MIDWAY, *ZERO, "position-drift"),
        True,
    ),
    Kind("further", "stamps in milliseconds, second half", milliseconds_since, (*CLOCK, "clock-unit")),
    Kind("further", "another tool", payload(0.0, 1.0), ("recordings-disagree", "mass-far-from-description")),
    Kind(
        "further",
        "one torque without the weight",
        one_weightless,
        ("description-does-not-match", "gravity-direction", *LAW),
        True,
    ),
    Kind("further", "one current without its gain", torque_as(lambda s, x: x / 12.0), (*GAIN, *UNIT), True),
    Kind(
        "further",
        "dead band of a torque",
        torque_as(lambda s, x: np.where(np.abs(x) < 0.7 * x.std(), 0.0, x)),
        ("channel-dead", "channel-coarse", *LAW),
        True,
    ),
    Kind(
        "further",
        "stamps in steps of five rows",
        lambda s: replace(s.raw, time=s.time[0] + np.floor((s.time - s.time[0]) / (5.0 * s.step)) * 5.0 * s.step),
        CLOCK,
    ),
    Kind(
        "further",
        "amount of a torque without its sign",
        torque_as(lambda s, x: np.abs(x)),
        (*SIGN, "torque-unsigned"),
        True,
    ),
    Kind("further", "torque overflows", torque_as(overflowed), ("spikes", "saturation", *MIDWAY), True),
    Kind(
        "further",
        "gain of a torque falls with its amount",
        torque_as(lambda s, x: x * (1.0 - 0.5 * np.abs(x) / np.abs(x).max())),
        (*GAIN, *LAW, "saturation"),
        True,
    ),
    Kind(
        "further",
        "torque of one joint lost for every other tenth of a second",
        torque_as(lambda s, x: np.where((s.time * 10.0).astype(np.int64) % 2 == 0, x, 0.0)),
        ("channel-dead", "spikes", "channel-noisy"),
        True,
    ),
    Kind(
        "further",
        "position eased by a nonlinear gear",
        position_as(lambda s, x: x + 0.1 * np.sin(3.0 * standardised(x))),
        ("residual-by-angle", "position-scale", *ZERO),
        True,
    ),
)
"""Kinds of corruption."""

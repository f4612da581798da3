"""Kinds of corruption of a recording, in families, with the codes that name each: `KINDS`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corruptions import (
    Change,
    added,
    backlash,
    base_tilted,
    clock_as,
    doubled,
    drive_coupled,
    empty_rows,
    gain_of,
    gain_ramp,
    held,
    jittered,
    kept,
    lagged,
    late_since,
    more_friction,
    offset_of,
    order_since,
    payload,
    piece_reversed,
    position_as,
    position_held,
    position_noise,
    position_outliers,
    position_steps,
    positions_mixed,
    push,
    rows_taken,
    sampled_slowly,
    slip,
    standardised,
    swapped,
    torque_as,
    torque_clock,
    torque_copied,
    torque_mixed,
    torque_outliers,
    torque_value,
    unit_of,
    velocity_as,
    wander,
    weightless,
    without_piece,
    zeros_off,
)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of corruption.

    Attributes:
        family: Family.
        name: Name.
        change: Function that makes the corrupted recording.
        codes: Codes of findings that name it.
        one_joint: True if a finding must name the joint or, of two, one of them.
    """

    family: str
    name: str
    change: Change
    codes: tuple[str, ...]
    one_joint: bool = False


SPIKES, ORDER, CHANNEL = ("spikes",), ("joint-order",), ("channel-dead",)
LATE = ("joint-delay", "channel-delay")
MIDWAY = ("changes-midway",)
"""Codes of what changes within one recording; a check that brings another code adds it here."""

WARMING = ("temperature-drift", *MIDWAY)
CROSSED = ("cross-talk",)
UNIT = ("torque-unit", "motor-side", "current-without-gain", "description-does-not-match")
CLOCK = ("clock-jitter", "clock-gap", "rows-repeated", "rows-not-consecutive", "clock-rate", "time-scale")
ZERO = ("position-offset",)
LAW = ("friction-missing", "residual-by-angle", "friction-negative")
GAIN, SIGN = ("torque-gain",), ("torque-sign",)

KINDS: tuple[Kind, ...] = (
    Kind("outliers", "one torque sample of 1e6", torque_outliers(1, 1, 1e6), SPIKES, True),
    Kind("outliers", "20 torque samples 8 sigma off", torque_outliers(20, 1, 8.0), SPIKES, True),
    Kind(
        "outliers", "30 torque samples in a row 5 sigma off", torque_outliers(1, 30, 5.0), (*SPIKES, "contact"), True
    ),
    Kind("outliers", "1 % of a torque is 999", torque_value(0.01, 999.0), SPIKES, True),
    Kind("outliers", "2 % of a torque is zero", torque_value(0.02, 0.0), SPIKES, True),
    Kind("outliers", "one position sample 1 rad off", position_outliers(1, 1.0), SPIKES, True),
    Kind("outliers", "15 position samples zero", position_outliers(15, 0.0, zero=True), SPIKES, True),
    Kind("outliers", "6 rows of zeros", empty_rows, SPIKES),
    Kind("midway", "sign of one torque, second half", gain_of(0.5, 1.0, -1.0), (*MIDWAY, *SIGN), True),
    Kind("midway", "sign of all torques, last third", gain_of(0.67, 1.0, -1.0, whole=True), (*MIDWAY, *SIGN)),
    Kind("midway", "gain 1.5 of one torque, second half", gain_of(0.5, 1.0, 1.5), (*MIDWAY, *GAIN), True),
    Kind("midway", "gain 0.6 of all torques, second half", gain_of(0.5, 1.0, 0.6, whole=True), MIDWAY),
    Kind("midway", "gain 1.6 of one torque for a fifth", gain_of(0.4, 0.6, 1.6), MIDWAY, True),
    Kind("midway", "gain rises by half", gain_ramp, MIDWAY),
    Kind("midway", "offset of one torque, second half", offset_of(0.5, 1.0, 1.0), MIDWAY, True),
    Kind("midway", "offset of one torque for a fifth", offset_of(0.3, 0.5, 1.5), MIDWAY, True),
    Kind("midway", "offset of one torque drifts", offset_of(0.0, 1.0, 2.0, ramp=True), MIDWAY, True),
    Kind("midway", "encoder slips by 0.2 rad", slip(0.2, 0.6), (*MIDWAY, *ZERO), True),
    Kind("midway", "encoder slips by 0.05 rad", slip(0.05, 0.5), (*MIDWAY, *ZERO), True),
    Kind("midway", "payload picked up", payload(0.5, 1.0), MIDWAY),
    Kind("midway", "payload carried for a third", payload(0.33, 0.67), MIDWAY),
    Kind("midway", "torques 60 ms late, second half", late_since(0.06, 0.5), (*MIDWAY, *LATE)),
    Kind("midway", "friction of one joint, second half", more_friction(0.4, 0.5), WARMING, True),
    Kind("midway", "friction of all joints, second half", more_friction(0.3, 0.5, whole=True), WARMING),
    Kind("midway", "two torques exchanged, second half", order_since, (*MIDWAY, *ORDER), True),
    Kind("midway", "base tilted by 15°, second half", base_tilted(0.5, 15.0), (*MIDWAY, "gravity-direction")),
    Kind("channel", "torque 50 ms late", torque_as(lambda s, x: s.late(x, 0.05)), LATE, True),
    Kind("channel", "torque 0.2 s late", torque_as(lambda s, x: s.late(x, 0.2)), LATE, True),
    Kind("channel", "position 50 ms late", position_as(lambda s, x: s.late(x, 0.05)), LATE, True),
    Kind("channel", "position 0.1 s early", position_as(lambda s, x: s.late(x, -0.1)), LATE, True),
    Kind("channel", "torque lags by 80 ms", torque_as(lambda s, x: lagged(s, x, 0.08)), LATE, True),
    Kind("channel", "position lags by 80 ms", position_as(lambda s, x: lagged(s, x, 0.08)), LATE, True),
    Kind("channel", "torque twice as large", torque_as(lambda s, x: 2.0 * x), GAIN, True),
    Kind("channel", "torque half as large", torque_as(lambda s, x: 0.5 * x), GAIN, True),
    Kind("channel", "torque inverted", torque_as(lambda s, x: -x), SIGN, True),
    Kind(
        "channel",
        "torque clipped at 40 %",
        torque_as(lambda s, x: np.clip(x, 0.4 * x.min(), 0.4 * x.max())),
        ("saturation",),
        True,
    ),
    Kind(
        "channel",
        "torque in 5 steps",
        torque_as(lambda s, x: np.round(x / np.ptp(x) * 5.0) * np.ptp(x) / 5.0),
        ("channel-coarse", "saturation"),
        True,
    ),
    Kind("channel", "position in steps of 0.05 rad", position_steps(0.05), ("channel-coarse",), True),
    Kind(
        "channel",
        "noise of one torque",
        torque_as(lambda s, x: x + 1.0 * x.std() * s.rng.standard_normal(len(x))),
        ("channel-noisy", "spikes"),
        True,
    ),
    Kind("channel", "noise of one position", position_noise(0.02), ("channel-noisy", "spikes"), True),
    Kind(
        "channel", "torque keeps its value for a fifth", torque_as(lambda s, x: held(s, x, 0.4, 0.6)), CHANNEL, True
    ),
    Kind(
        "channel",
        "torque zero for a fifth",
        torque_as(lambda s, x: np.where(s.between(0.4, 0.6), 0.0, x)),
        CHANNEL,
        True,
    ),
    Kind(
        "channel",
        "position keeps its value for a tenth",
        position_held(0.4, 0.5),
        CHANNEL,
        True,
    ),
    Kind("channel", "position inverted", position_as(lambda s, x: -x), ("position-sign", *SIGN), True),
    Kind("channel", "position 1.2 times", position_as(lambda s, x: 1.2 * x), ("position-scale", *ZERO), True),
    Kind(
        "channel",
        "hum of 2 Hz on one torque",
        torque_as(lambda s, x: x + 0.7 * x.std() * np.sin(4.0 * np.pi * s.time)),
        ("channel-noisy", *LAW),
        True,
    ),
    Kind("between", "30 % of another torque", torque_mixed(0.3), CROSSED, True),
    Kind("between", "all of another torque added", torque_mixed(1.0), CROSSED, True),
    Kind("between", "two torques mixed by 40 %", torque_mixed(0.4, mutual=True), CROSSED, True),
    Kind("between", "10 % of another position", positions_mixed(0.1), CROSSED, True),
    Kind("between", "two joints behind a coupled drive", drive_coupled, (*CROSSED, "motor-side"), True),
    Kind("between", "torque of another joint", torque_copied, (*ORDER, *CROSSED), True),
    Kind("between", "two torques exchanged", swapped("effort"), ORDER, True),
    Kind("between", "two positions exchanged", swapped("q", "dq", "ddq"), ORDER, True),
    Kind("between", "two joints exchanged", swapped("q", "dq", "ddq", "effort"), ORDER, True),
    Kind("between", "two velocities exchanged", swapped("dq"), ("velocity-mismatch",), True),
    Kind("units", "N·cm", unit_of(100.0), UNIT),
    Kind("units", "mN·m", unit_of(1000.0), UNIT),
    Kind("units", "kgf·cm", unit_of(10.197), UNIT),
    Kind("units", "kN·m", unit_of(0.001), UNIT),
    Kind("units", "one torque in N·cm", unit_of(100.0, whole=False), (*GAIN, *UNIT), True),
    Kind("units", "velocities in deg/s", velocity_as(180.0 / np.pi), ("velocity-mismatch", "degrees")),
    Kind("units", "velocities in rpm", velocity_as(30.0 / np.pi), ("velocity-mismatch",)),
    Kind(
        "units", "one position in degrees", position_as(lambda s, x: np.rad2deg(x)), ("degrees", "motor-side"), True
    ),
    Kind("time", "5 % of the rows lost, stamps written anew", rows_taken(kept(0.05), evenly=True), CLOCK),
    Kind("time", "10 % of the rows lost", rows_taken(kept(0.1), evenly=False), CLOCK),
    Kind("time", "10 % of the rows doubled", rows_taken(doubled(0.1), evenly=True), CLOCK),
    Kind("time", "a twentieth cut out, stamps written anew", rows_taken(without_piece, evenly=True), CLOCK),
    Kind("time", "a tenth stands elsewhere, stamps written anew", rows_taken(piece_reversed, evenly=True), CLOCK),
    Kind("time", "stamps jitter", clock_as(jittered), CLOCK),
    Kind("time", "torque new in every eighth row", sampled_slowly, (*LATE, "rows-repeated", "channel-coarse")),
    Kind("time", "torque's clock 1 % fast", torque_clock(0.01), (*LATE, *MIDWAY)),
    Kind("time", "clock runs at half speed", clock_as(lambda s: s.time[0] + 2.0 * (s.time - s.time[0])), CLOCK),
    Kind("time", "all torques 80 ms late", late_since(0.08, 0.0), LATE),
    Kind("geometry", "zero off by 10 mrad", zeros_off(0.01), ZERO, True),
    Kind("geometry", "zero off by 0.1 rad", zeros_off(0.1), ZERO, True),
    Kind("geometry", "zero off by 0.5 rad", zeros_off(0.5), ZERO, True),
    Kind("geometry", "all zeros off by 30 mrad", zeros_off(0.03, whole=True), ZERO),
    Kind("geometry", "base tilted by 8°", base_tilted(0.0, 8.0), ("gravity-direction", *ZERO)),
    Kind("geometry", "base tilted by 30°", base_tilted(0.0, 30.0), ("gravity-direction", *ZERO)),
    Kind("unmodelled", "spring", added(lambda s: standardised(s.motion.q[:, s.joint])), LAW, True),
    Kind("unmodelled", "ripple", added(lambda s: 0.6 * np.sin(15.0 * s.motion.q[:, s.joint])), LAW, True),
    Kind("unmodelled", "backlash", added(lambda s: 0.6 * backlash(s)), LAW, True),
    Kind(
        "unmodelled",
        "drag",
        added(lambda s: 0.6 * standardised(s.motion.dq[:, s.joint] * np.abs(s.motion.dq[:, s.joint]))),
        LAW,
        True,
    ),
    Kind(
        "unmodelled",
        "friction of one direction",
        added(lambda s: 0.6 * (s.motion.dq[:, s.joint] > 0.0) * s.motion.dq[:, s.joint]),
        LAW,
        True,
    ),
    Kind("unmodelled", "offset wanders", added(wander), (*WARMING, *LAW), True),
    Kind(
        "unmodelled",
        "a cold arm warms up",
        added(lambda s: 0.6 * np.tanh(s.motion.dq / 0.02) * np.exp(-6.0 * s.share)[:, None], whole=True),
        WARMING,
    ),
    Kind("unmodelled", "pushes", push, ("contact",)),
    Kind("unmodelled", "torque without the weight", weightless, ("description-does-not-match", "gravity-direction")),
)
"""All kinds, by family."""

"""Spikes: isolated samples of positions, velocities and torques that no arm can have.

A dropped packet that is logged as zeros, or a bit error on a bus, is one sample or a few of them. A filter spreads
such a sample over the rows around it, so spikes are found and interpolated before anything is filtered, and the
samples are not used. Positions spike where they jump out and back faster than several times the velocity limit;
velocities and torques where a few samples are far beyond all others, on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.signals.isolated_samples import FEWEST, heights, isolated_samples, marked, smallest_step
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

FASTER = 3.0
"""Smallest speed of a spike, divided by the velocity limit of the joint."""

PLAUSIBLE_ANGULAR, PLAUSIBLE_LINEAR = 10.0, 3.0
"""Largest plausible speed of a joint whose description has no velocity limit [rad/s and m/s]."""

STEPS, QUANTILE = 10.0, 0.9
"""Smallest height of a spike of a position, divided by a quantile of the steps from sample to sample, for
descriptions whose limits are too small. On recorded arms the largest ratio is 0.33."""

LONGEST = 10
"""Largest number of samples of a spike of a position; longer ones are reported as stuck channels."""

BROKEN = 0.005
"""Share of samples from which spikes are an error: they then have a permanent cause, and the ones that are too small
to be found are many as well."""

LISTED = 3
"""Number of spikes whose times are listed."""

NAMES = {"q": "position", "dq": "velocity", "effort": "torque"}
"""Quantities in which spikes are searched, with their names in messages."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class Channels:
    """Units and speed limits of the channels of a log.

    Attributes:
        speed: Largest speed of each channel in units of the log per second, shape (n,).
        turn: A full turn in units of the log; infinite for prismatic joints, shape (n,).
        units: Units of the positions.
        effort_units: Units of the efforts.
    """

    speed: Array
    turn: Array
    units: tuple[str, ...]
    effort_units: tuple[str, ...]

    def unit(self, quantity: str, joint: int) -> str:
        """Unit of a quantity of a joint, as logged."""
        if quantity == "effort":
            return self.effort_units[joint]
        return self.units[joint] + ("/s" if quantity == "dq" else "")


def without_spikes(
    recording: Recording, log_format: LogFormat, robot: Robot
) -> tuple[Recording, tuple[Finding, ...]]:
    """The recording with spikes interpolated and masked, and findings about them.

    A sample whose position or velocity spikes is masked for all joints, since the torques of all depend on it; a
    spike of a torque for its joint alone.

    Args:
        recording: In robot order and in the units of the log, with finite values.
        log_format: Log format of the recording.
        robot: The arm that was recorded.
    """
    if recording.consecutive is False or recording.samples < FEWEST:
        return recording, ()
    channels = _channels(recording, log_format, robot)
    time = np.arange(recording.samples) / (recording.rate or 1.0) if recording.time is None else recording.time
    found = {"q": impossible_positions(recording.q, time, channels.speed, channels.turn)}
    if recording.dq is not None:
        found["dq"] = isolated_samples(recording.dq)
    if recording.effort is not None:
        found["effort"] = _whole_rows(isolated_samples(recording.effort), recording.effort)
    if not any(flags.any() for flags in found.values()):
        return recording, ()
    kept = log_format.spikes == "keep"
    findings = [
        _finding(recording, name, flags & recording.valid, time, channels, kept=kept)
        for name, flags in found.items()
        if (flags & recording.valid).any()
    ]
    if kept:
        return recording, tuple(findings)
    return _repaired(recording, channels.turn, found, time), tuple(findings)


def impossible_positions(q: Array, time: Array, speed: Array, turn: Array) -> Flags:
    """Mask of the positions that jump out and back faster than an arm can move.

    Args:
        q: Positions, shape (N, n).
        time: Shape (N,) [s].
        speed: Largest speed of each channel, shape (n,).
        turn: A full turn of each channel, by which wrapped angles jump, shape (n,); infinite if it is not an angle.

    Returns:
        Shape (N, n).
    """
    found = np.zeros(q.shape, dtype=np.bool_)
    steps, seconds = np.diff(q, axis=0), np.abs(np.diff(time))
    largest, fastest = np.maximum(steps.max(axis=0), -steps.min(axis=0)), FASTER * speed
    for j in np.flatnonzero(largest > fastest * seconds.min()):
        x = np.ascontiguousarray(q[:, j]) if largest[j] <= turn[j] / 2 else np.unwrap(q[:, j], period=turn[j])
        step = np.abs(np.diff(x))
        if not (step > fastest[j] * seconds).any():
            continue
        usual = STEPS * max(float(np.quantile(step, QUANTILE)), smallest_step(step))
        extended = np.concatenate([[time[0] - seconds[0]], time, [time[-1] + seconds[-1]]])
        for length in range(1, LONGEST + 1):
            span = np.abs(extended[length + 1 :] - extended[: -length - 1])
            height, _ = heights(x, length)
            marked(height > np.maximum(fastest[j] * span / 2, usual), length, found[:, j])
    return found


def _channels(recording: Recording, log_format: LogFormat, robot: Robot) -> Channels:
    """Units and speed limits of the channels of a log."""
    turns = np.array([not joint.is_prismatic for joint in robot.joints])
    plausible = np.where(turns, PLAUSIBLE_ANGULAR, PLAUSIBLE_LINEAR)
    limits = np.array([joint.velocity_limit for joint in robot.joints])
    speed = np.where(np.isfinite(limits) & (limits > 0.0), limits, plausible)
    if log_format.transmission is not None:
        speed = np.abs(np.asarray(log_format.transmission)) @ speed
    degrees = turns & log_format.degrees(robot.n)
    turn = np.where(turns, np.where(degrees, 360.0, 2.0 * np.pi), np.inf)
    units = tuple("deg" if each else joint.unit for each, joint in zip(degrees, robot.joints, strict=True))
    current = recording.effort_is_current or log_format.drive_gain is not None
    efforts = tuple("A" if current else joint.effort_unit for joint in robot.joints)
    return Channels(np.where(degrees, np.degrees(speed), speed), turn, units, efforts)


def _whole_rows(flags: Flags, effort: Array) -> Flags:
    """Flags of all torques of the rows in which all are zero and one of them spikes: the packet was lost."""
    rows = np.flatnonzero(flags.any(axis=1))
    flags[rows[(effort[rows] == 0.0).all(axis=1)]] = True
    return flags


def _repaired(recording: Recording, turn: Array, found: dict[str, Flags], time: Array) -> Recording:
    """The recording with the found samples interpolated and masked.

    Args:
        recording: The recording.
        turn: A full turn of each channel, shape (n,); infinite if it is not an angle.
        found: Mask of the spikes of each quantity, shape (N, n) each.
        time: Shape (N,) [s].
    """
    rows = np.logical_or.reduce([found[name].any(axis=1) for name in found if name != "effort"])
    valid = recording.valid & ~rows[:, None]
    changed: dict[str, Array] = {}
    for name in ("q", "dq", "ddq", "effort"):
        values = getattr(recording, name)
        if values is None:
            continue
        flags = np.broadcast_to(rows[:, None], values.shape)
        if name == "effort":
            flags = flags | found[name]
            valid &= ~flags
        if flags.any():
            changed[name] = _interpolated(values, flags, time, turn if name == "q" else np.full_like(turn, np.inf))
    return replace(recording, valid=valid, **changed)


def _interpolated(values: Array, flags: Flags, time: Array, turn: Array) -> Array:
    """Values (N, n) whose flagged samples are interpolated, along unwrapped angles where there is a full turn."""
    result = values.copy()
    for j in np.flatnonzero(flags.any(axis=0)):
        bad, good = np.flatnonzero(flags[:, j]), np.flatnonzero(~flags[:, j])
        kept = values[good, j]
        smooth = kept if np.isinf(turn[j]) else np.unwrap(kept, period=turn[j])
        last = np.maximum(np.searchsorted(good, bad) - 1, 0)
        result[bad, j] = np.interp(time[bad], time[good], smooth) + (kept - smooth)[last]
    return result


def _finding(
    recording: Recording, quantity: str, flags: Flags, time: Array, channels: Channels, *, kept: bool
) -> Finding:
    """Finding about the spikes of a quantity."""
    joints, rows = np.flatnonzero(flags.any(axis=0)), np.flatnonzero(flags.any(axis=1))
    values = getattr(recording, quantity)
    good = np.flatnonzero(~flags.any(axis=1))
    worst, size = (0, 0), -1.0
    for j in joints:
        bad = np.flatnonzero(flags[:, j])
        off = np.abs(values[bad, j] - np.interp(time[bad], time[good], values[good, j])) / np.ptp(values[good, j])
        if off.max() > size:
            worst, size = (int(bad[np.argmax(off)]), int(j)), float(off.max())
    row, j = worst
    place = int(np.searchsorted(good, row))
    sides = [f"{values[good[k], j]:.4g}" for k in (place - 1, place) if 0 <= k < len(good)]
    times = ", ".join(f"{t:.3f}" for t in time[rows[:LISTED]]) + " s"
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    name, unit = NAMES[quantity], channels.unit(quantity, j)
    evidence = (
        f"In {len(rows)} of {recording.samples} rows the {name} jumps out and back, at t = {times}{more}. The largest "
        f"jump is that of {recording.channels[j]} at t = {time[row]:.3f} s: {values[row, j]:.4g} {unit} next to "
        f"{' and '.join(sides)} {unit}."
    )
    if quantity == "q":
        evidence += f" That is faster than {FASTER:g} times its speed limit, {channels.speed[j]:.3g} {unit}/s."
    names = ", ".join(recording.channels[k] for k in joints)
    broken = len(rows) >= BROKEN * recording.samples
    if kept:
        remedy = 'leave the key `spikes` out; these samples are used because of spikes = "keep".'
        return Finding("spikes", "error" if broken else "warning", names, evidence, remedy)
    used = "Rows near them are left out for their joint." if quantity == "effort" else "They are left out for all joints."
    if broken:
        remedy = "check the sensor, the cable and the driver or logger of these channels, and record again."
        return Finding("spikes", "error", names, f"{evidence} {used}", remedy)
    remedy = (
        "nothing to do for this log; look for the cause in the cable, the driver or the logger. If the values are "
        'real, spikes = "keep" in [[recording]] uses them.'
    )
    return Finding("spikes", "warning", names, f"{evidence} {used}", remedy)

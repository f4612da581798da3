"""Spikes: isolated samples of positions, velocities, torques and commands that no arm can produce.

A dropped packet that is logged as zeros, or a bit error on a bus, affects one sample or a few samples. A filter
spreads such a sample over the rows around it. Therefore spikes are detected and interpolated before anything is
filtered, and the samples are not used. A position is a spike if it jumps away and back at a speed of several times
the velocity limit, or with an acceleration that no arm reaches. A velocity or a torque is a spike if it is isolated:
one sample, or a few samples, far from the samples on both sides. A commanded position is examined like a measured
one. A velocity is not a spike if the differences of the positions agree with it. In logs with a low sample rate,
velocities and torques are not examined, because a real motion can be as short as a spike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.channels.isolated_samples import (
    FEWEST,
    heights,
    isolated_samples,
    marked,
    smallest_step,
)
from armid.measurement.recording import Recording
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot

FASTER = 3.0
"""Smallest speed of the jump of a position that counts as a spike, divided by the velocity limit of the joint."""

PLAUSIBLE_ANGULAR, PLAUSIBLE_LINEAR = 10.0, 3.0
"""Largest plausible speeds of a revolute joint [rad/s] and of a prismatic joint [m/s], for descriptions without a
velocity limit or with a placeholder."""

SHARPEST_ANGULAR, SHARPEST_LINEAR = 1000.0, 300.0
"""Largest accelerations of a revolute joint [rad/s²] and of a prismatic joint [m/s²]; a servo of a light arm reaches
some hundred. At low sample rates this bound is lower than that of the speed: 0.2 rad in one sample at 50 Hz."""

STEPS, QUANTILE = 10.0, 0.9
"""Smallest height of a spike of a position, divided by a quantile of the absolute steps from sample to sample, and
the probability of this quantile. This second condition is needed for descriptions whose velocity limits are too
small. In recordings of real arms the largest ratio is 0.33."""

LONGEST = 10
"""Largest number of samples in a spike of a position; longer jumps are reported as stuck channels."""

WRAP_TOLERANCE = 0.08
"""Largest difference between a jump and a whole number of turns at which the jump counts as a wrap of the angle
[turns]; it is half a radian. If the typical step from sample to sample is larger, the log contains angles of motors,
which do not wrap."""

SLOWEST = 0.011
"""Largest time from sample to sample at which velocities and torques are examined [s]: 100 Hz with some tolerance. At
lower rates three samples are longer than 30 ms, a time in which an arm can move or friction reverse."""

CONFIRMED = 0.7
"""Largest difference between a logged velocity and the velocity computed from the positions over two steps, divided
by the height of the isolated velocity, at which the positions confirm the logged velocity. For a real motion of a
single sample the difference is half of the height; for a spike it is the whole height."""

BROKEN = 0.005
"""Share of samples with spikes at and above which the finding is an error. Such spikes have a permanent cause, and
many others are too small to be detected."""

FEWEST_ZEROS = 3
"""Smallest number of channels of a quantity with which a row of zeros counts as a fault and not as chance."""

LISTED = 3
"""Largest number of spikes whose times are listed in a finding."""

TINY = 1e-300
"""Smallest divisor in place of the range of a channel, so that the divisor is not zero."""

NAMES = {"q": "position", "dq": "velocity", "effort": "torque", "command": "commanded position"}
"""Quantities that are examined for spikes, and their names in messages."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class Channels:
    """Units and speed limits of the channels of a log.

    Attributes:
        speed: Largest plausible speed of each channel, shape (n,) [units of the log per second]; infinite if
            unknown.
        acceleration: Largest acceleration of each channel, shape (n,) [units of the log per second squared].
        turn: Full turn of each channel, shape (n,) [units of the log]; infinite for prismatic joints.
        units: Units of the positions.
        effort_units: Units of the efforts.
    """

    speed: Array
    acceleration: Array
    turn: Array
    units: tuple[str, ...]
    effort_units: tuple[str, ...]

    def unit(self, quantity: str, joint: int) -> str:
        """Unit of a quantity (`q`, `dq`, `effort` or `command`) of a joint, as logged."""
        if quantity == "effort":
            return self.effort_units[joint]
        return self.units[joint] + ("/s" if quantity == "dq" else "")


def without_spikes(
    recording: Recording, log_format: LogFormat, robot: Robot
) -> tuple[Recording, tuple[Finding, ...]]:
    """Interpolates and masks the spikes of a recording, and reports them in findings.

    If a position or a velocity is a spike, the sample is masked for all joints, because the torques of all joints
    depend on the motion of each joint. If only a torque is a spike, the sample is masked only for its joint, and
    likewise if only a command is a spike in a recording without torque. In a recording with torque, a command is
    interpolated, but not masked, because results from the torque do not need it.

    Args:
        recording: Recording in the robot's joint order and in the units of the log, with finite values. If its rate
            was reduced, it was searched then, and a real peak may have become a single sample.
        log_format: Log format of the recording.
        robot: The arm that was recorded.
    """
    searched = recording.logged_rate is not None  # before the rate was reduced
    if searched or recording.consecutive is False or recording.samples < FEWEST:
        return recording, ()
    channels = _channels(recording, log_format, robot)
    time = np.arange(recording.samples) / (recording.rate or 1.0) if recording.time is None else recording.time
    found = {"q": impossible_positions(recording.q, time, channels)}
    usual_step = float(median(np.abs(np.diff(time))))
    if recording.dq is not None and usual_step <= SLOWEST:
        flags = isolated_samples(recording.dq, usual_step)
        q = _interpolated(recording.q, found["q"], time, channels.turn)
        found["dq"] = flags & ~confirmed_velocities(recording.dq, flags, q, time, channels)
    if recording.effort is not None and usual_step <= SLOWEST:
        found["effort"] = isolated_samples(recording.effort, usual_step)
    if recording.command is not None:
        found["command"] = impossible_positions(recording.command, time, channels)
    return interpolate_spikes(recording, found, time, channels, kept=log_format.spikes == "keep")


def interpolate_spikes(
    recording: Recording, found: dict[str, Flags], time: Array, channels: Channels, *, kept: bool
) -> tuple[Recording, tuple[Finding, ...]]:
    """Interpolates and masks samples that were found to be spikes, and the findings about them.

    Args:
        recording: Recording in the units of the log.
        found: Mask of the spikes of each examined quantity, shape (N, n) each. Rows of zeros beside a spike are
            added to them in place.
        time: Times of the samples, shape (N,) [s].
        channels: Units and speed limits of the channels.
        kept: True if the samples are left as they are, so that there are only findings.
    """
    for name, flags in found.items():
        _add_lost_packets(flags, getattr(recording, name))
    if not any(flags.any() for flags in found.values()):
        return recording, ()
    findings = [
        _finding(recording, name, flags & recording.valid, time, channels, kept=kept)
        for name, flags in found.items()
        if (flags & recording.valid).any()
    ]
    if kept:
        return recording, tuple(findings)
    return _repaired(recording, channels.turn, found, time), tuple(findings)


def impossible_positions(q: Array, time: Array, channels: Channels) -> Flags:
    """Mask of the positions that jump away and back faster than an arm can move, shape (N, n).

    Args:
        q: Positions, shape (N, n) [units of the log].
        time: Times of the samples, shape (N,) [s].
        channels: Limits of the channels, and the full turns by which wrapped angles jump.
    """
    found = np.zeros(q.shape, dtype=np.bool_)
    steps, seconds = np.diff(q, axis=0), np.abs(np.diff(time))
    largest = np.maximum(steps.max(axis=0), -steps.min(axis=0))
    least = np.minimum(FASTER * channels.speed * seconds.min(), channels.acceleration * seconds.min() ** 2 / 2)
    for j in np.flatnonzero(largest > least):
        x, turn = np.ascontiguousarray(q[:, j]), channels.turn[j]
        limits = FASTER * channels.speed[j], channels.acceleration[j]
        wraps = largest[j] > turn / 2 and float(median(np.abs(steps[:, j]))) < WRAP_TOLERANCE * turn
        if wraps:
            _mark_impossible(np.unwrap(x, period=turn), time, limits, np.inf, found[:, j])
        _mark_impossible(x, time, limits, turn if wraps else np.inf, found[:, j])
    return found


def _mark_impossible(x: Array, time: Array, limits: tuple[float, float], turn: float, found: Flags) -> None:
    """Marks impossible positions of one channel (N,) in the mask `found`; jumps by whole turns are not marked.

    `limits` are a speed and an acceleration. With the acceleration a, a position that is at the same place at two
    times T apart has left it by at most a T²/8 in between; with the speed v by at most v T/2.
    """
    step, seconds = np.abs(np.diff(x)), np.abs(np.diff(time))
    if not (step > _farthest(2.0 * seconds, limits)).any():
        return
    usual = STEPS * max(float(np.quantile(step, QUANTILE)), smallest_step(step))
    extended = np.concatenate([[time[0] - seconds[0]], time, [time[-1] + seconds[-1]]])
    for length in range(1, LONGEST + 1):
        span = np.abs(extended[length + 1 :] - extended[: -length - 1])
        height, _ = heights(x, length, ends=True)
        starts = height > np.maximum(_farthest(span, limits), usual)
        if np.isfinite(turn):
            starts &= np.abs(height - turn * np.round(height / turn)) > WRAP_TOLERANCE * turn
        marked(starts, length, found)


def _farthest(span: Array, limits: tuple[float, float]) -> Array:
    """Largest distance that a position moves away and back within times `span`, with a speed and an acceleration."""
    return np.minimum(limits[0] * span / 2, limits[1] * span**2 / 8)


def confirmed_velocities(dq: Array, flags: Flags, q: Array, time: Array, channels: Channels) -> Flags:
    """Mask of the isolated velocities that are real motion, because the differences of the positions agree.

    Args:
        dq: Velocities, shape (N, n).
        flags: Mask of the isolated velocities, shape (N, n).
        q: Positions without spikes, shape (N, n).
        time: Times of the samples, shape (N,) [s].
        channels: Units and speed limits. A jump of the positions that is faster than an arm can move does not confirm
            a velocity.

    Returns:
        Mask, shape (N, n).
    """
    result = np.zeros_like(flags)
    rows, joints = np.nonzero(flags)
    if not len(rows):
        return result
    first, last = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(time) - 1)
    change = _without_wraps(q[last, joints] - q[first, joints], channels.turn[joints])
    seconds = time[last] - time[first]
    mean = np.where(seconds > 0.0, change / np.where(seconds > 0.0, seconds, 1.0), np.inf)
    beside = _interpolated(dq, flags, time, np.full_like(channels.turn, np.inf))[rows, joints]
    value = dq[rows, joints]
    agrees = np.abs(value - mean) <= CONFIRMED * np.abs(value - beside)
    result[rows, joints] = agrees & (np.abs(mean) <= FASTER * channels.speed[joints])
    return result


def _without_wraps(change: Array, turn: Array) -> Array:
    """Subtracts whole turns from changes of positions that are close to whole turns; `turn` may be infinite."""
    whole = np.round(change / turn) * np.where(np.isfinite(turn), turn, 0.0)
    return change - np.where(np.abs(change - whole) < WRAP_TOLERANCE * turn, whole, 0.0)


def _channels(recording: Recording, log_format: LogFormat, robot: Robot) -> Channels:
    """Units and speed limits of the channels of a log."""
    turns = np.array([not joint.is_prismatic for joint in robot.joints])
    plausible = np.where(turns, PLAUSIBLE_ANGULAR, PLAUSIBLE_LINEAR)
    sharpest = np.where(turns, SHARPEST_ANGULAR, SHARPEST_LINEAR)
    limits = np.array([joint.velocity_limit for joint in robot.joints])
    speed = np.where(limits > 0.0, np.minimum(limits, plausible), plausible)
    if log_format.transmission is not None:
        speed, sharpest = (np.abs(np.asarray(log_format.transmission)) @ each for each in (speed, sharpest))
    degrees = turns & log_format.degrees(robot.n)
    turn = np.where(turns, np.where(degrees, 360.0, 2.0 * np.pi), np.inf)
    units = tuple("deg" if each else joint.unit for each, joint in zip(degrees, robot.joints, strict=True))
    current = recording.effort_is_current or log_format.drive_gain is not None
    efforts = tuple("A" if current else joint.effort_unit for joint in robot.joints)
    speed, sharpest = (np.where(degrees, np.degrees(each), each) for each in (speed, sharpest))
    return Channels(speed, sharpest, turn, units, efforts)


def _add_lost_packets(flags: Flags, values: Array) -> None:
    """Flags all short groups of rows with only zeros, if one such row already contains a spike.

    Without this, zeros of a lost packet would not be detected if the other values are near zero.
    """
    rows = np.flatnonzero(flags.any(axis=1))
    if values.shape[1] < FEWEST_ZEROS or not (values[rows] == 0.0).all(axis=1).any():
        return
    zero = np.concatenate([[False], (values == 0.0).all(axis=1), [False]])
    for first, behind in np.flatnonzero(np.diff(zero)).reshape(-1, 2):
        if behind - first <= LONGEST:
            flags[first:behind] = True


def _repaired(recording: Recording, turn: Array, found: dict[str, Flags], time: Array) -> Recording:
    """Interpolates and masks the samples of a recording at which spikes were found.

    Args:
        recording: The recording.
        turn: A full turn of each channel, shape (n,); infinite if it is not an angle.
        found: Mask of the spikes of each quantity, shape (N, n) each.
        time: Times of the samples, shape (N,) [s].
    """
    rows = np.logical_or.reduce([found[name].any(axis=1) for name in found if name not in ("effort", "command")])
    valid = recording.valid & ~rows[:, None]
    changed: dict[str, Array] = {}
    for name in ("q", "dq", "ddq", "effort", "command"):
        values = getattr(recording, name)
        if values is None:
            continue
        flags = np.broadcast_to(rows[:, None], values.shape)
        if name in ("effort", "command") and name in found:
            flags = flags | found[name]
            if name == "effort" or recording.effort is None:
                valid &= ~flags
        if flags.any():
            whole = turn if name in ("q", "command") else np.full_like(turn, np.inf)
            changed[name] = _interpolated(values, flags, time, whole)
    return replace(recording, valid=valid, **changed)


def _interpolated(values: Array, flags: Flags, time: Array, turn: Array) -> Array:
    """Values (N, n) in which flagged samples are interpolated; angles with a finite full turn are unwrapped before.

    A channel in which all samples are flagged is not changed.
    """
    result = values.copy()
    for j in np.flatnonzero(flags.any(axis=0) & ~flags.all(axis=0)):
        bad, good = np.flatnonzero(flags[:, j]), np.flatnonzero(~flags[:, j])
        kept, place = values[good, j], np.searchsorted(good, bad)
        last, following = np.maximum(place - 1, 0), np.minimum(place, len(good) - 1)
        change = _without_wraps(kept[following] - kept[last], np.full(len(bad), turn[j]))
        seconds = time[good[following]] - time[good[last]]
        share = (time[bad] - time[good[last]]) / np.where(seconds > 0.0, seconds, 1.0)
        result[bad, j] = kept[last] + np.where(seconds > 0.0, share, 0.0) * change
    return result


def _finding(
    recording: Recording, quantity: str, flags: Flags, time: Array, channels: Channels, *, kept: bool
) -> Finding:
    """Finding about the spikes of one quantity (`q`, `dq`, `effort` or `command`) in all channels."""
    rows = np.flatnonzero(flags.any(axis=1))
    times = ", ".join(f"{t:.3f}" for t in time[rows[:LISTED]]) + " s"
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    evidence = (
        f"In {len(rows)} of {recording.samples} rows the {NAMES[quantity]} jumps away and back, "
        f"at t = {times}{more}. {_largest(recording, quantity, flags, time, channels)}"
    ).rstrip()
    names = ", ".join(recording.channels[j] for j in np.flatnonzero(flags.any(axis=0)))
    broken = len(rows) >= BROKEN * recording.samples
    if kept:
        remedy = Remedy("remove ", setting("spikes", "keep"), " from the study, so that these samples are not used")
        return Finding("spikes", "error" if broken else "warning", names, evidence, remedy)
    of_joint = quantity == "effort" or (quantity == "command" and recording.effort is None)
    left_out = "Rows near them are left out for their joint." if of_joint else "These rows are left out."
    left_out = left_out if quantity != "command" or of_joint else "The command was interpolated there."
    remedy = (
        "find out the cause, in the cable, the driver or the logger; for this log nothing has to be done. If the "
        'values are real, spikes = "keep" in [[recording]] uses them.'
    )
    if broken:
        remedy = "record again; before that, check sensor, cable, driver and logger of these channels."
    return Finding("spikes", "error" if broken else "warning", names, f"{evidence} {left_out}", remedy)


def _largest(recording: Recording, quantity: str, flags: Flags, time: Array, channels: Channels) -> str:
    """Text about the largest spike of a quantity, relative to the range of its channel; may be empty."""
    values = getattr(recording, quantity)
    good = np.flatnonzero(~flags.any(axis=1))
    if not len(good):
        return ""
    size, row, j = -1.0, 0, 0
    for joint in np.flatnonzero(flags.any(axis=0)):
        bad, kept = np.flatnonzero(flags[:, joint]), values[good, joint]
        off = np.abs(values[bad, joint] - np.interp(time[bad], time[good], kept)) / max(float(np.ptp(kept)), TINY)
        if off.max() > size:
            size, row, j = float(off.max()), int(bad[np.argmax(off)]), int(joint)
    place = int(np.searchsorted(good, row))
    sides = " and ".join(f"{values[good[k], j]:.4g}" for k in (place - 1, place) if 0 <= k < len(good))
    unit = channels.unit(quantity, j)
    text = (
        f"The largest jump is that of {recording.channels[j]} at t = {time[row]:.3f} s: {values[row, j]:.4g} {unit} "
        f"next to {sides} {unit}."
    )
    if quantity in ("q", "command") and np.isfinite(channels.speed[j]):
        text += (
            f" For that it would need {FASTER:g} times its largest speed, {channels.speed[j]:.3g} {unit}/s, or "
            f"{channels.acceleration[j]:.3g} {unit}/s²."
        )
    return text

"""Kinds of corruption written after those of `further_kinds.py`, and run once before the doctor was changed again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from corruption_kinds import CROSSED, LATE, LAW, MIDWAY, SIGN, UNIT, ZERO, Kind
from corruption_scene import Scene
from corruptions import Change, added, standardised, torque_as


def bursts(s: Scene, column: Array) -> Array:
    """Column (N,) with twelve bursts of a fifth of a second of noise of three standard deviations."""
    noise = np.zeros(len(column))
    length = max(3, round(0.2 / s.step))
    for start in s.rng.choice(len(column) - length, 12, replace=False):
        noise[start : start + length] = 3.0 * column.std() * s.rng.standard_normal(length)
    return column + noise


def stale(s: Scene) -> Recording:
    """Position of which 3 % of the rows are those of a fifth of a second before."""
    back = max(2, round(0.2 / s.step))
    rows = s.rng.random(s.raw.samples) < 0.03
    rows[:back] = False
    old = np.roll(s.raw.q[:, s.joint], back)
    return replace(s.raw, q=s.raw.q + s.one(np.where(rows, old - s.raw.q[:, s.joint], 0.0)))


def gain_in_turns(s: Scene) -> Recording:
    """Gain 1.5 of one torque in the second and in the fourth quarter."""
    rows = s.between(0.25, 0.5) | s.between(0.75)
    return s.with_effort(s.effort * (1.0 + s.one(np.where(rows, 0.5, 0.0))))


def scaled_since(since: float, factor: float) -> Change:
    """Position and velocity of one joint by another scale from a share of the recording on, without a jump."""

    def change(s: Scene) -> Recording:
        rows = s.between(since)
        q = np.unwrap(s.raw.q[:, s.joint])
        pivot = q[np.argmax(rows)]
        changed = {"q": s.raw.q + s.one(np.where(rows, (factor - 1.0) * (q - pivot), 0.0))}
        if s.raw.dq is not None:
            changed["dq"] = s.raw.dq * (1.0 + s.one(np.where(rows, factor - 1.0, 0.0)))
        return replace(s.raw, **changed)

    return change


def slips(s: Scene) -> Recording:
    """Position of one joint that slips ten times by 0.05 rad, either way."""
    jumps = np.zeros(s.raw.samples)
    jumps[s.rng.choice(np.arange(1, s.raw.samples), 10, replace=False)] = 0.05 * s.rng.choice((-1.0, 1.0), 10)
    return replace(s.raw, q=s.raw.q + s.one(np.cumsum(jumps)))


def other_velocity(s: Scene) -> Array:
    """Velocity of the other joint (N,), standardised."""
    return 0.6 * standardised(s.motion.dq[:, s.other])


def cross_talk_since(s: Scene) -> Recording:
    """Half of another torque in that of one joint, in the second half."""
    return s.with_effort(s.effort + s.one(0.5 * s.effort[:, s.other] * s.between(0.5)))


def slow_clock(s: Scene, column: Array) -> Array:
    """Column (N,) by a clock that is 2 % slow."""
    return np.interp(s.time, s.time[0] + (s.time - s.time[0]) * 1.02, column)


def base_turns(s: Scene) -> Recording:
    """Base that tilts by 25° over the recording, as the torque shows it."""
    robot = s.model.robot
    g, angle = robot.gravity, np.deg2rad(25.0)
    aside = np.linalg.norm(g) * np.array([0.0, 1.0, 0.0])
    tilted = DynamicsModel(replace(robot, gravity=np.cos(angle) * g + np.sin(angle) * aside), s.model.terms)
    difference = tilted.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
    return s.with_effort(s.effort + s.logged(difference) * s.share[:, None])


LATER: tuple[Kind, ...] = (
    Kind("later", "bursts of noise of a torque", torque_as(bursts), ("spikes", "channel-noisy", "contact"), True),
    Kind(
        "later",
        "3 % of a position old by 0.2 s",
        stale,
        ("spikes", "channel-noisy", "velocity-mismatch", "rows-not-consecutive"),
        True,
    ),
    Kind("later", "gain 1.5 of one torque, every other quarter", gain_in_turns, MIDWAY, True),
    Kind(
        "later",
        "position counts backwards, second half",
        scaled_since(0.5, -1.0),
        (*MIDWAY, "position-sign", *SIGN),
        True,
    ),
    Kind(
        "later", "position 1.3 times, second half", scaled_since(0.5, 1.3), (*MIDWAY, "position-scale", *ZERO), True
    ),
    Kind(
        "later",
        "torque 80 ms late, second half",
        torque_as(lambda s, x: np.where(s.between(0.5), s.late(x, 0.08), x)),
        (*MIDWAY, *LATE),
        True,
    ),
    Kind("later", "encoder slips ten times by 0.05 rad", slips, (*MIDWAY, *ZERO, "spikes"), True),
    Kind("later", "torque follows another velocity", added(other_velocity), (*LAW, *CROSSED), True),
    Kind("later", "half of another torque, second half", cross_talk_since, (*MIDWAY, *CROSSED), True),
    Kind(
        "later",
        "mean of all torques taken off",
        lambda s: s.with_effort(s.effort - s.effort.mean(axis=1, keepdims=True)),
        CROSSED,
    ),
    Kind("later", "one torque's clock 2 % slow", torque_as(slow_clock), (*LATE, *MIDWAY), True),
    Kind("later", "base tilts slowly by 25°", base_turns, (*MIDWAY, "gravity-direction")),
    Kind(
        "later",
        "torques in mN·m from a third on",
        lambda s: s.with_effort(s.effort * np.where(s.between(0.33), 1000.0, 1.0)[:, None]),
        (*MIDWAY, *UNIT),
    ),
    Kind(
        "later",
        "positions in turns",
        lambda s: replace(s.raw, q=s.raw.q / (2.0 * np.pi)),
        ("motor-side", "degrees", "position-scale", "velocity-mismatch", "time-scale"),
    ),
)
"""Kinds of corruption."""

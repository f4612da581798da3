"""Corruptions of a recording, each as it would stand in the file.

A corruption is made in the numbers as logged, before signs, gains and units of the log format are applied. What
needs the arm's dynamics, as a payload or a tilted base, is computed with a model that was identified from the clean
recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from corruption_scene import Scene

Change = Callable[[Scene], Recording]


# Outliers --------------------------------------------------------------------------------------------------------


def torque_outliers(count: int, length: int, height: float) -> Change:
    """Some stretches of some samples in one torque that are far off, by a number of standard deviations."""

    def change(s: Scene) -> Recording:
        effort = s.effort.copy()
        for start in s.rng.choice(np.arange(s.raw.samples // 10, s.raw.samples * 9 // 10), count, replace=False):
            effort[start : start + length, s.joint] += height * s.size[s.joint] * s.rng.choice((-1.0, 1.0))
        return s.with_effort(effort)

    return change


def torque_value(share: float, value: float) -> Change:
    """A share of the samples of one torque with a fixed value."""

    def change(s: Scene) -> Recording:
        return s.with_effort(
            np.where(s.one(np.where(s.rng.random(s.raw.samples) < share, 1.0, 0.0)) > 0.0, value, s.effort)
        )

    return change


def position_outliers(count: int, value: float, *, zero: bool = False) -> Change:
    """Single samples of a position that jump by a value, or fall to zero."""

    def change(s: Scene) -> Recording:
        q = s.raw.q.copy()
        rows = s.rng.choice(np.arange(s.raw.samples // 10, s.raw.samples * 9 // 10), count, replace=False)
        q[rows, s.joint] = 0.0 if zero else q[rows, s.joint] + value
        return replace(s.raw, q=q)

    return change


def empty_rows(s: Scene) -> Recording:
    """Rows whose numbers are all zero."""
    rows = s.rng.choice(np.arange(1, s.raw.samples - 1), 6, replace=False)
    changed = {}
    for name in ("q", "dq", "ddq", "effort"):
        if (values := getattr(s.raw, name)) is not None:
            changed[name] = values.copy()
            changed[name][rows] = 0.0
    return replace(s.raw, **changed)


# Changes midway --------------------------------------------------------------------------------------------------


def gain_of(low: float, high: float, gain: float, *, whole: bool = False) -> Change:
    """Another gain of one torque, or of all, between two shares of the recording."""

    def change(s: Scene) -> Recording:
        factor = np.where(s.between(low, high), gain, 1.0)[:, None]
        return s.with_effort(s.effort * (factor if whole else 1.0 + s.one(factor[:, 0] - 1.0)))

    return change


def gain_ramp(s: Scene) -> Recording:
    """Gain of all torques that rises by a half over the recording."""
    return s.with_effort(s.effort * (1.0 + 0.5 * s.share)[:, None])


def offset_of(low: float, high: float, height: float, *, ramp: bool = False) -> Change:
    """Offset of one torque, in standard deviations, between two shares, or rising between them."""

    def change(s: Scene) -> Recording:
        shape = np.clip((s.share - low) / (high - low), 0.0, 1.0) if ramp else s.between(low, high).astype(float)
        return s.with_effort(s.effort + s.one(height * s.size[s.joint] * shape))

    return change


def slip(size: float, since: float) -> Change:
    """Position of one joint that is off by an angle from a share of the recording on."""

    def change(s: Scene) -> Recording:
        return replace(s.raw, q=s.raw.q + s.one(np.where(s.between(since), size, 0.0)))

    return change


def payload(low: float, high: float) -> Change:
    """A payload of a tenth of the arm's weight, 10 cm from the flange, between two shares."""

    def change(s: Scene) -> Recording:
        arm = DynamicsModel(s.model.robot, (RigidBody(),))
        described = s.model.robot.inertial_vector
        mass = 2.0 if described is None else 0.1 * float(described[:, 0].sum())
        theta = np.zeros(len(arm.parameters))
        theta[arm.inertial_columns[-10:][:4]] = mass * np.array([1.0, 0.0, 0.05, 0.1])
        return s.with_effort(s.effort + s.logged(arm.torque(s.motion, theta)) * s.between(low, high)[:, None])

    return change


def late_since(seconds: float, since: float) -> Change:
    """All torques late from a share of the recording on."""

    def change(s: Scene) -> Recording:
        delayed = np.column_stack([s.late(column, seconds) for column in s.effort.T])
        return s.with_effort(np.where(s.between(since)[:, None], delayed, s.effort))

    return change


def more_friction(share: float, since: float, *, whole: bool = False) -> Change:
    """Additional Coulomb friction, a share of each torque's standard deviation, from a share of the recording on."""

    def change(s: Scene) -> Recording:
        sign = np.sign(s.reading.torque_sign) * np.tanh(s.motion.dq / 0.02)
        added = share * s.size * sign * s.between(since)[:, None]
        return s.with_effort(s.effort + (added if whole else s.one(added[:, s.joint])))

    return change


def order_since(s: Scene) -> Recording:
    """Two torques exchanged in the second half."""
    return s.with_effort(np.where(s.between(0.5)[:, None], s.effort[:, _exchanged(s)], s.effort))


def base_tilted(low: float, degrees: float) -> Change:
    """Base that is tilted, as the torque shows it, from a share of the recording on."""

    def change(s: Scene) -> Recording:
        robot = s.model.robot
        angle, g = np.deg2rad(degrees), robot.gravity
        aside = np.linalg.norm(g) * np.array([1.0, 0.0, 0.0])
        tilted = DynamicsModel(replace(robot, gravity=np.cos(angle) * g + np.sin(angle) * aside), s.model.terms)
        difference = tilted.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
        return s.with_effort(s.effort + s.logged(difference) * s.between(low)[:, None])

    return change


# One channel -----------------------------------------------------------------------------------------------------


def torque_as(warp: Callable[[Scene, Array], Array]) -> Change:
    """One torque as a function of itself."""

    def change(s: Scene) -> Recording:
        effort = s.effort.copy()
        effort[:, s.joint] = warp(s, effort[:, s.joint])
        return s.with_effort(effort)

    return change


def position_as(warp: Callable[[Scene, Array], Array]) -> Change:
    """One position, with its velocity, as a function of itself."""
    return lambda s: s.moved(lambda column: warp(s, column))


def lagged(s: Scene, column: Array, seconds: float) -> Array:
    """First-order lag of a column (N,)."""
    result, share = column.copy(), s.step / (seconds + s.step)
    for k in range(1, len(column)):
        result[k] = result[k - 1] + share * (column[k] - result[k - 1])
    return result


def held(s: Scene, column: Array, low: float, high: float) -> Array:
    """Column (N,) that keeps its value between two shares."""
    rows = s.between(low, high)
    return np.where(rows, column[np.argmax(rows)], column)


def position_held(low: float, high: float) -> Change:
    """Position of one joint that keeps its value between two shares, the velocity as it was."""

    def change(s: Scene) -> Recording:
        q = s.raw.q.copy()
        q[:, s.joint] = held(s, q[:, s.joint], low, high)
        return replace(s.raw, q=q)

    return change


def position_noise(size: float) -> Change:
    """White noise on the position alone."""
    return lambda s: replace(s.raw, q=s.raw.q + s.one(size * s.rng.standard_normal(s.raw.samples)))


def position_steps(size: float) -> Change:
    """Position in coarse steps, the velocity as it was."""
    return lambda s: replace(s.raw, q=s.raw.q + s.one((np.round(s.raw.q / size) * size - s.raw.q)[:, s.joint]))


# Between channels ------------------------------------------------------------------------------------------------


def _exchanged(s: Scene) -> NDArray[np.intp]:
    order = np.arange(s.raw.n)
    order[[s.joint, s.other]] = order[[s.other, s.joint]]
    return order


def swapped(*names: str) -> Change:
    """Two joints exchanged in some quantities."""

    def change(s: Scene) -> Recording:
        known = {name: getattr(s.raw, name) for name in names}
        return replace(
            s.raw, **{name: values[:, _exchanged(s)] for name, values in known.items() if values is not None}
        )

    return change


def torque_mixed(share: float, *, mutual: bool = False) -> Change:
    """A share of another joint's torque in that of one joint, and the reverse."""

    def change(s: Scene) -> Recording:
        effort = s.effort + s.one(share * s.effort[:, s.other])
        return s.with_effort(effort + s.one(share * s.effort[:, s.joint], s.other) if mutual else effort)

    return change


def torque_copied(s: Scene) -> Recording:
    """Torque of another joint in place of a joint's own."""
    return s.with_effort(s.effort + s.one(s.effort[:, s.other] - s.effort[:, s.joint]))


def positions_mixed(share: float) -> Change:
    """A share of another joint's position and velocity in those of one joint."""

    def change(s: Scene) -> Recording:
        mixed = {"q": s.raw.q + s.one(share * np.unwrap(s.raw.q[:, s.other]))}
        if s.raw.dq is not None:
            mixed["dq"] = s.raw.dq + s.one(share * s.raw.dq[:, s.other])
        return replace(s.raw, **mixed)

    return change


def drive_coupled(s: Scene) -> Recording:
    """Two joints behind a coupled drive whose positions and torques stand as those of the motors."""
    own = positions_mixed(0.5)(s)
    return replace(own, effort=s.effort + s.one(-0.5 * s.effort[:, s.joint], s.other))


# Units, time, geometry, unmodelled dynamics ----------------------------------------------------------------------


def unit_of(factor: float, *, whole: bool = True) -> Change:
    """All torques, or one, in another unit."""
    return lambda s: s.with_effort(s.effort * factor if whole else s.effort * (1.0 + s.one(factor - 1.0)))


def velocity_as(factor: float) -> Change:
    """Velocities in another unit; they are added where the log has none."""
    return lambda s: replace(s.raw, dq=factor * (_velocity(s) if s.raw.dq is None else s.raw.dq))


def _velocity(s: Scene) -> Array:
    return s.motion.dq * np.broadcast_to(s.reading.position_sign, s.raw.n)


def rows_taken(keep: Callable[[Scene], NDArray[np.integer]], *, evenly: bool) -> Change:
    """Rows left out or repeated, their stamps kept, or written anew as if all were there."""

    def change(s: Scene) -> Recording:
        rows = keep(s)
        names = ("q", "dq", "ddq", "effort")
        taken = {name: v[rows] for name in names if (v := getattr(s.raw, name)) is not None}
        time = s.time[0] + s.step * np.arange(len(rows)) if evenly else s.time[rows]
        return replace(s.raw, time=time, valid=s.raw.valid[rows], **taken)

    return change


def kept(share: float) -> Callable[[Scene], NDArray[np.integer]]:
    """Rows of which a random share is left out."""
    return lambda s: np.flatnonzero(s.rng.random(s.raw.samples) >= share)


def doubled(share: float) -> Callable[[Scene], NDArray[np.integer]]:
    """Rows of which a random share stands twice."""
    return lambda s: np.repeat(np.arange(s.raw.samples), 1 + (s.rng.random(s.raw.samples) < share))


def without_piece(s: Scene) -> NDArray[np.integer]:
    """Rows without a twentieth of them, in the middle."""
    return np.flatnonzero(~s.between(0.5, 0.55))


def piece_reversed(s: Scene) -> NDArray[np.integer]:
    """Rows of which a tenth, in the middle, stands elsewhere."""
    rows = np.arange(s.raw.samples)
    return np.concatenate(
        [rows[s.share < 0.3], rows[s.between(0.6, 0.7)], rows[s.between(0.3) & ~s.between(0.6, 0.7)]]
    )


def clock_as(warp: Callable[[Scene], Array]) -> Change:
    """Stamps as a function of the true ones."""
    return lambda s: replace(s.raw, time=warp(s))


def jittered(s: Scene) -> Array:
    """Stamps with a jitter of two fifths of a step."""
    return np.maximum.accumulate(s.time + 0.4 * s.step * s.rng.standard_normal(s.raw.samples))


def sampled_slowly(s: Scene) -> Recording:
    """Torques that are new in every eighth row only."""
    return s.with_effort(s.effort[np.arange(s.raw.samples) // 8 * 8])


def torque_clock(drift: float) -> Change:
    """Torques by a clock that is faster than that of the positions."""

    def change(s: Scene) -> Recording:
        run = s.time[0] + (s.time - s.time[0]) * (1.0 + drift)
        return s.with_effort(np.column_stack([np.interp(s.time, run, column) for column in s.effort.T]))

    return change


def zeros_off(size: float, *, whole: bool = False) -> Change:
    """Zero of one joint, or of all, off by an angle."""
    return lambda s: replace(s.raw, q=s.raw.q + (size * s.rng.choice((-1.0, 1.0), s.raw.n) if whole else s.one(size)))


def added(torque: Callable[[Scene], Array], *, whole: bool = False) -> Change:
    """Torque of a law that the model lacks (N,), or (N, n), in standard deviations of the joint's torque."""

    def change(s: Scene) -> Recording:
        values = torque(s) * (s.size if whole else s.size[s.joint])
        return s.with_effort(s.effort + np.sign(s.reading.torque_sign) * (values if whole else s.one(values)))

    return change


def standardised(x: Array) -> Array:
    """Values (N,) with mean 0 and standard deviation 1."""
    return (x - x.mean()) / max(float(x.std()), 1e-9)


def backlash(s: Scene) -> Array:
    """Torque (N,) of a play element over a tenth of a radian."""
    q, state = s.motion.q[:, s.joint], np.zeros(s.raw.samples)
    for k in range(1, s.raw.samples):
        state[k] = np.clip(state[k - 1] + q[k] - q[k - 1], -0.05, 0.05)
    return state / 0.05


def wander(s: Scene) -> Array:
    """Random walk (N,) that ends about one standard deviation off."""
    return np.asarray(np.cumsum(s.rng.standard_normal(s.raw.samples)) / np.sqrt(s.raw.samples))


def push(s: Scene) -> Recording:
    """A push at the tip for half a second, at three moments."""
    torque = np.zeros(s.raw.q.shape)
    for at in (0.25, 0.5, 0.75):
        shape = np.clip(1.0 - np.abs(s.time - s.time[0] - at * np.ptp(s.time)) / 0.5, 0.0, None)
        torque += 2.0 * shape[:, None] * s.size * s.rng.choice((-1.0, 1.0), s.raw.n)
    return s.with_effort(s.effort + torque)


def weightless(s: Scene) -> Recording:
    """Torques from which the controller took the weight."""
    weight = s.model.gravity_torque(s.motion.q, s.parameters)
    return s.with_effort(s.effort - s.logged(weight))

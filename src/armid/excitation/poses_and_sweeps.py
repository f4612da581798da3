"""Point-to-point experiments: static poses for gravity, and sweeps at constant velocity for friction.

The poses are selected from many random poses by an exchange algorithm that minimises the volume of the confidence
ellipsoid of the gravity parameters. A sweep moves one joint back and forth at a constant velocity, while the other
joints rest. Both motions consist of segments: polynomials of the fifth degree, standstill, and motion at constant
velocity.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.plan import seconds_for
from armid.input_boundary import within
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

CANDIDATES = 600
"""Number of random poses from which the static poses are selected."""

EXCHANGES = 6
"""Largest number of passes in which the exchange algorithm tries to replace every selected pose; after the third pass
the determinant of the information matrix hardly changes."""

RIDGE = 1e-6
"""Information at the start of the selection, divided by the information of all random poses. It is needed because the
information matrix of few poses is singular."""

SHARE = 0.5
"""Share of the limits of velocity and acceleration that moves between poses use."""

USUAL_ACCELERATION = 2.0
"""Acceleration limit of moves and sweeps if no acceleration limit is known [rad/s² or m/s²]."""

LOOKS = 60
"""Number of poses on a straight move between two poses that are checked for collisions."""

EVEN = 4.0
"""Longest time at constant velocity in a sweep [s]; a longer time would hardly improve the estimate of friction at
this velocity."""

PLACES, NARROW = 80, 1e-3
"""Number of positions of each joint, on each side of the start position, that are checked for collisions; and
smallest distance of the start position from the ends of the range that remains [rad or m]."""

EDGE = 0.05
"""Share of the range of a joint, at each end, that poses and sweeps do not use."""


@dataclass(frozen=True, eq=False, slots=True)
class Moves:
    """Motion that consists of consecutive segments, each from one pose to the next.

    Attributes:
        joints: Names of the joints.
        poses: Poses between the segments, including the first and the last one, shape (k + 1, n) [rad or m].
        seconds: Duration of each segment, shape (k,) [s].
        speeds: Joint velocities in these poses, shape (k + 1, n) [rad/s or m/s].
        kinds: Kind of each segment: `way` (a move between poses), `rest` (standstill) or `sweep` (constant velocity).
    """

    joints: tuple[str, ...]
    poses: Array
    seconds: Array
    speeds: Array
    kinds: tuple[str, ...]

    def __post_init__(self) -> None:
        k, n = len(self.kinds), len(self.joints)
        object.__setattr__(self, "poses", array(self.poses, (k + 1, n), "poses"))
        object.__setattr__(self, "speeds", array(self.speeds, (k + 1, n), "speeds"))
        object.__setattr__(self, "seconds", array(self.seconds, (k,), "seconds"))

    @property
    def duration(self) -> float:
        """Total duration of all segments [s]."""
        return float(self.seconds.sum())

    def at(self, time: Array) -> Motion:
        """Motion at times (N,) [s] from the beginning; after the end the arm rests in the last pose."""
        t = array(time, (None,), "time")
        ends = np.cumsum(self.seconds)
        k = np.minimum(np.searchsorted(ends, t, side="right"), len(self.kinds) - 1)
        T = self.seconds[k][:, None]
        s = np.clip((t - (ends - self.seconds)[k])[:, None] / T, 0.0, 1.0)
        a, b = self.poses[k], self.poses[k + 1]
        u, v = self.speeds[k] * T, self.speeds[k + 1] * T
        # Polynomial of the fifth degree with these end positions and velocities and zero acceleration at both ends.
        d = b - a
        c3, c4, c5 = 10 * d - 6 * u - 4 * v, -15 * d + 8 * u + 7 * v, 6 * d - 3 * u - 3 * v
        q = a + s * (u + s**2 * (c3 + s * (c4 + s * c5)))
        dq = (u + s**2 * (3 * c3 + s * (4 * c4 + s * 5 * c5))) / T
        ddq = s * (6 * c3 + s * (12 * c4 + s * 20 * c5)) / T**2
        return Motion(t, q, dq, ddq)

    def rehearsal(self, speed: float) -> Moves:
        """Motion along the same path at `speed` times the planned speed, above 0 and at most 1."""
        if not 0.0 < speed <= 1.0:
            raise ArmidError(
                f"The speed of a rehearsal must be above 0 and at most 1; found {speed}.",
                remedy="give for instance 0.2 for a fifth of the planned speed.",
            )
        return replace(self, seconds=self.seconds / speed, speeds=self.speeds * speed)

    def sample(self, rate: float) -> Motion:
        """Samples of the whole motion at a rate [Hz]."""
        within("motion", self.duration * rate, f"The plan of {self.duration:.4g} s at {rate:.4g} Hz")
        return self.at(np.arange(float(round(self.duration * rate) + 1)) / rate)


def choose_poses(
    model: DynamicsModel,
    base: BaseParameters,
    limits: Limits,
    count: int,
    *,
    seed: int = 1,
    allowed: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Array:
    """Selects from random poses the static poses (count, n) that determine the gravity parameters best.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        limits: Limits of the joints.
        count: Number of poses.
        seed: Seed of the random poses.
        allowed: Function that returns the mask (N,) of the allowed ones of poses (N, n); if not given, all poses are
            allowed.

    Raises:
        ArmidError: The count is below one, too few random poses are allowed, or gravity causes no torque.
    """
    if count < 1:
        raise ArmidError(f"At least one pose is needed; found {count}.", remedy="ask for one pose or more.")
    rng = np.random.default_rng(seed)
    low, high = _range(limits)
    q = rng.uniform(low, high, (CANDIDATES, model.n))
    if allowed is not None:
        q = q[allowed(q)]
    if len(q) < count:
        problem = f"Only {len(q)} of {CANDIDATES} random poses are free of collisions, but {count} poses are needed."
        raise ArmidError(problem, remedy="ask for fewer poses, or give a smaller --clearance or wider limits.")
    zero = np.zeros_like(q)
    rows = model.regressor(Motion.of_states(q, zero, zero))[:, :, base.kept]
    everything = np.einsum("nja,njb->ab", rows, rows)
    values, vectors = np.linalg.eigh(everything)
    if values[-1] <= 0.0:
        problem = f"Gravity causes no torque in any joint of {model.robot.name}; static poses give no information."
        raise ArmidError(problem, remedy="record sweeps instead of poses.")
    seen = vectors[:, values > 1e-10 * values[-1]]
    rows = rows @ seen
    parts = np.einsum("nja,njb->nab", rows, rows)
    chosen: list[int] = []
    G = RIDGE * parts.sum(axis=0)
    for _ in range(count):
        best = _best(G, rows, chosen)
        chosen.append(best)
        G = G + parts[best]
    for _ in range(EXCHANGES):
        before = list(chosen)
        for place in range(count):
            G = G - parts[chosen[place]]
            others = chosen[:place] + chosen[place + 1 :]
            chosen[place] = _best(G, rows, others)
            G = G + parts[chosen[place]]
        if chosen == before:
            break
    poses = q[chosen]
    return poses[_short_way(poses)]


def _best(G: Array, rows: Array, taken: Sequence[int]) -> int:
    """Index of the pose whose rows increase the determinant of G most; poses in `taken` are excluded.

    `rows` are the regressor rows of the random poses, shape (N, n, parameters).
    """
    inverse = np.linalg.inv(G)
    n = rows.shape[1]
    gain = np.linalg.slogdet(np.eye(n) + np.einsum("nja,ab,nkb->njk", rows, inverse, rows))[1]
    gain[list(taken)] = -np.inf
    return int(gain.argmax())


def _short_way(q: Array) -> list[int]:
    """Order in which poses (k, n) are visited: each pose is followed by the nearest of the remaining poses."""
    order, rest = [0], list(range(1, len(q)))
    while rest:
        nearest = min(rest, key=lambda k: float(np.abs(q[k] - q[order[-1]]).max()))
        order.append(nearest)
        rest.remove(nearest)
    return order


def _range(limits: Limits) -> tuple[Array, Array]:
    """Lowest and highest positions of poses, (n,) each: joint ranges without their ends, or ± π if unlimited."""
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    edge = EDGE * (high - low)
    return low + edge, high - edge


def _acceleration(limits: Limits) -> Array:
    return np.where(np.isfinite(limits.acceleration), limits.acceleration, USUAL_ACCELERATION)


def _way(a: Array, b: Array, limits: Limits) -> float:
    """Duration [s] of a move between two poses with half of the limits of velocity and acceleration.

    It is at least 0.2 s.
    """
    return max(seconds_for(b - a, SHARE * limits.velocity, SHARE * _acceleration(limits), limits.jerk), 0.2)


def poses_plan(
    poses: Array,
    limits: Limits,
    *,
    rest: float = 2.0,
    via: Array | None = None,
    free: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Moves:
    """Motion through poses with a standstill in each pose.

    Args:
        poses: Poses in order, shape (k, n) [rad or m].
        limits: Limits of the joints.
        rest: Duration of the standstill in each pose [s].
        via: Pose (n,) through which the arm moves if a straight move would collide; `None` for straight moves only.
        free: Function that returns the mask (N,) of the poses (N, n) without collisions; if not given, all poses
            count as free.

    Raises:
        ArmidError: The duration of the standstill is not positive.
    """
    if not rest > 0.0:
        raise ArmidError(
            f"The duration of the standstill in each pose must be positive; found {rest} s.",
            remedy="give for instance 2 s.",
        )
    places, seconds, kinds = [poses[0]], [rest], ["rest"]
    for a, b in pairwise(poses):
        straight = free is None or via is None or bool(free(straight_way(a, b)).all())
        for c, d in [(a, b)] if straight or via is None else [(a, via), (via, b)]:
            places.append(c)
            seconds.append(_way(c, d, limits))
            kinds.append("way")
        places.append(b)
        seconds.append(rest)
        kinds.append("rest")
    places.append(poses[-1])
    speeds = np.zeros((len(places), poses.shape[1]))
    return Moves(limits.joints, np.array(places), np.array(seconds), speeds, tuple(kinds))


def straight_way(a: Array, b: Array) -> Array:
    """Poses (N, n) on the straight move from a to b in joint space [rad or m]."""
    return a + np.linspace(0.0, 1.0, LOOKS)[:, None] * (b - a)


def free_ranges(start: Array, limits: Limits, allowed: Callable[[Array], NDArray[np.bool_]]) -> Limits:
    """Limits in which the position range of each joint is reduced to the range that it can move through alone.

    The joint moves from the start pose while the others rest.

    Args:
        start: Start pose, shape (n,) [rad or m].
        limits: Limits of the joints.
        allowed: Function that returns the mask (N,) of the allowed ones of poses (N, n).
    """
    ends = limits.lower.copy(), limits.upper.copy()
    for j in range(len(start)):
        for end, place in zip(ends, _range(limits), strict=True):
            way = np.tile(start, (PLACES, 1))
            way[:, j] = np.linspace(start[j], place[j], PLACES)
            free = int(np.logical_and.accumulate(allowed(way)).sum())
            if free < PLACES:  # one position before the last that is free
                end[j] = way[max(free - 2, 0), j]
    return replace(limits, lower=np.minimum(ends[0], start - NARROW), upper=np.maximum(ends[1], start + NARROW))


def sweeps_plan(start: Array, limits: Limits, speeds: Sequence[float] = (0.05, 0.15, 0.4, 0.8)) -> Moves:
    """Motion of one joint after the other, back and forth at constant velocities around the start pose.

    Before and after the constant velocity, the joint accelerates and decelerates with at most half its acceleration
    limit. A velocity is left out if the range of the joint is too short to reach it.

    Args:
        start: Pose in which the other joints rest, shape (n,) [rad or m].
        limits: Limits of the joints.
        speeds: Velocities divided by the velocity limit of each joint, above 0 and at most 1.

    Raises:
        ArmidError: A velocity is not above 0 and at most 1, or no velocity is given.
    """
    if not len(speeds) or not all(0.0 < speed <= 1.0 for speed in speeds):
        raise ArmidError(
            "The velocities of sweeps are shares of the velocity limit, above 0 and at most 1; found "
            f"{list(speeds) or 'none'}.",
            remedy="give for instance 0.1 and 0.5.",
        )
    low, high = _range(limits)
    places, seconds, kinds = [start], list[float](), list[str]()
    velocities = [np.zeros(len(start))]

    def add(place: Array, velocity: Array, time: float, kind: str) -> None:
        places.append(place)
        velocities.append(velocity)
        seconds.append(time)
        kinds.append(kind)

    still = np.zeros(len(start))
    for j, unit in enumerate(np.eye(len(start))):
        for share in speeds:
            speed = share * float(limits.velocity[j])
            # From rest to a speed in time T over the distance speed · T / 2, the peak acceleration is 1.5 speed / T.
            ramp = max(1.5 * speed / (SHARE * float(_acceleration(limits)[j])), 0.05)
            way = 0.5 * speed * ramp
            if high[j] - low[j] <= 2.5 * way:
                continue  # the range is too short for this speed
            half = 0.5 * min(high[j] - low[j], 2.0 * way + EVEN * speed)
            middle = float(np.clip(start[j], low[j] + half, high[j] - half))
            for first, last in ((middle - half, middle + half), (middle + half, middle - half)):
                sign = np.sign(last - first)
                begin, even, done, stop = (
                    start + unit * (x - start[j]) for x in (first, first + sign * way, last - sign * way, last)
                )
                if np.abs(begin - places[-1]).max() > 0.0:
                    add(begin, still, _way(places[-1], begin, limits), "way")
                add(even, sign * speed * unit, ramp, "way")
                add(done, sign * speed * unit, float(np.abs(done - even).max()) / speed, "sweep")
                add(stop, still, ramp, "way")
        if np.abs(start - places[-1]).max() > 0.0:
            add(start, still, _way(places[-1], start, limits), "way")
    return Moves(limits.joints, np.array(places), np.array(seconds), np.array(velocities), tuple(kinds))

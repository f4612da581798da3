"""The two experiments that come before any series: static poses for gravity, constant velocities for friction.

Poses are chosen from many random ones by exchange, so that the gravity parameters' confidence ellipsoid is smallest.
A sweep moves one joint at a time back and forth at a constant velocity, the others at rest. Both are stretches of
polynomials of the fifth degree, of standing still, and of even motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.plan import seconds_for
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array, array

__all__ = ["Moves", "choose_poses", "free_ranges", "poses_plan", "straight_way", "sweeps_plan"]

CANDIDATES = 600
"""Random poses from which the static ones are chosen."""

EXCHANGES = 6
"""Passes of exchange over the chosen poses; the value hardly changes after the third."""

RIDGE = 1e-6
"""Information, over that of all candidates, with which the choice begins, when it is still singular."""

SHARE = 0.5
"""Share of the limits of velocity and acceleration that ways between poses use."""

USUAL_ACCELERATION = 2.0
"""Where no limit of acceleration is known [rad/s² or m/s²]."""

LOOKS = 60
"""Poses on a way in which bodies are looked at."""

EVEN = 4.0
"""Longest even stretch of a sweep [s]: friction at a speed is known long before."""

PLACES, NARROW = 80, 1e-3
"""Places of each joint at which bodies are looked at either way of the start, and the least range left [rad or m]."""

EDGE = 0.05
"""Share of a joint's range that stays free at its ends."""


@dataclass(frozen=True, eq=False, slots=True)
class Moves:
    """Stretches one after the other, each from one pose to the next.

    Attributes:
        joints: Names of the joints.
        poses: Where stretches begin and end, shape (k + 1, n) [rad or m].
        seconds: Length of each stretch, shape (k,) [s].
        speeds: Velocity of each joint at the beginning and end of each stretch, shape (k + 1, n) [rad/s or m/s].
        kinds: What each stretch is: `way`, `rest` or `sweep`.
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
        """Of all stretches [s]."""
        return float(self.seconds.sum())

    def at(self, time: Array) -> Motion:
        """The motion at times (N,) [s]; at rest in the last pose afterwards."""
        t = array(time, (None,), "time")
        ends = np.cumsum(self.seconds)
        k = np.minimum(np.searchsorted(ends, t, side="right"), len(self.kinds) - 1)
        T = self.seconds[k][:, None]
        s = np.clip((t - (ends - self.seconds)[k])[:, None] / T, 0.0, 1.0)
        a, b = self.poses[k], self.poses[k + 1]
        u, v = self.speeds[k] * T, self.speeds[k + 1] * T
        # The polynomial of the fifth degree with these ends and speeds, and no acceleration there.
        d = b - a
        c3, c4, c5 = 10 * d - 6 * u - 4 * v, -15 * d + 8 * u + 7 * v, 6 * d - 3 * u - 3 * v
        q = a + s * (u + s**2 * (c3 + s * (c4 + s * c5)))
        dq = (u + s**2 * (3 * c3 + s * (4 * c4 + s * 5 * c5))) / T
        ddq = s * (6 * c3 + s * (12 * c4 + s * 20 * c5)) / T**2
        return Motion(t, q, dq, ddq)

    def rehearsal(self, speed: float) -> Moves:
        """The same path at a share of the speed."""
        if not 0.0 < speed <= 1.0:
            raise ArmidError(f"A rehearsal is no faster than the plan; found a speed of {speed}.")
        return replace(self, seconds=self.seconds / speed, speeds=self.speeds * speed)

    def sample(self, rate: float) -> Motion:
        """The whole at `rate` samples a second [Hz]."""
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
    """Static poses (count, n) that determine the gravity parameters best, by exchange among random ones.

    Args:
        model: Arm and torque terms.
        base: Its base parameters.
        limits: Of the joints.
        count: How many poses.
        seed: Of the candidates.
        allowed: Says which poses (N, n) may be taken, shape (N,); all where left out.

    Raises:
        ArmidError: Too few poses, or none is allowed, or gravity acts on no joint.
    """
    if count < 1:
        raise ArmidError(f"At least one pose is needed; found {count}.")
    rng = np.random.default_rng(seed)
    low, high = _range(limits)
    q = rng.uniform(low, high, (CANDIDATES, model.n))
    if allowed is not None:
        q = q[allowed(q)]
    if len(q) < count:
        raise ArmidError(
            f"Only {len(q)} of {CANDIDATES} random poses keep bodies apart; {count} are asked.",
            remedy="ask for fewer poses, a smaller --clearance, or wider limits.",
        )
    zero = np.zeros_like(q)
    rows = model.regressor(Motion.of_states(q, zero, zero))[:, :, base.kept]
    everything = np.einsum("nja,njb->ab", rows, rows)
    values, vectors = np.linalg.eigh(everything)
    if values[-1] <= 0.0:
        raise ArmidError(f"Gravity acts on no joint of {model.robot.name}.", remedy="record sweeps, not poses.")
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
    """The candidate whose rows add most to the determinant of G."""
    inverse = np.linalg.inv(G)
    n = rows.shape[1]
    gain = np.linalg.slogdet(np.eye(n) + np.einsum("nja,ab,nkb->njk", rows, inverse, rows))[1]
    gain[list(taken)] = -np.inf
    return int(gain.argmax())


def _short_way(q: Array) -> list[int]:
    """An order in which the nearest pose comes next."""
    order, rest = [0], list(range(1, len(q)))
    while rest:
        nearest = min(rest, key=lambda k: float(np.abs(q[k] - q[order[-1]]).max()))
        order.append(nearest)
        rest.remove(nearest)
    return order


def _range(limits: Limits) -> tuple[Array, Array]:
    """Tell where poses may lie: the range less its edges, ± π where it has no end."""
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    edge = EDGE * (high - low)
    return low + edge, high - edge


def _acceleration(limits: Limits) -> Array:
    return np.where(np.isfinite(limits.acceleration), limits.acceleration, USUAL_ACCELERATION)


def _way(a: Array, b: Array, limits: Limits) -> float:
    """Time from one pose to another at half the limits [s]."""
    return max(seconds_for(b - a, SHARE * limits.velocity, SHARE * _acceleration(limits), limits.jerk), 0.2)


def poses_plan(
    poses: Array,
    limits: Limits,
    *,
    rest: float = 2.0,
    via: Array | None = None,
    free: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Moves:
    """Ways between poses, and standing still in each.

    Args:
        poses: Shape (k, n) [rad or m].
        limits: Of the joints.
        rest: How long the arm stands still in each [s].
        via: Pose (n,) through which it goes where the straight way is not free.
        free: Says which poses (N, n) keep bodies apart, shape (N,); all where left out.
    """
    if not rest > 0.0:
        raise ArmidError(f"The arm has to stand still for some time in each pose; found {rest} s.")
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
    """Poses (N, n) on the way from one to another [rad or m]."""
    return a + np.linspace(0.0, 1.0, LOOKS)[:, None] * (b - a)


def free_ranges(start: Array, limits: Limits, allowed: Callable[[Array], NDArray[np.bool_]]) -> Limits:
    """The limits with positions only as far as each joint alone can go from the start.

    Args:
        start: Pose, shape (n,) [rad or m].
        limits: Of the joints.
        allowed: Says which poses (N, n) may be taken, shape (N,).
    """
    ends = limits.lower.copy(), limits.upper.copy()
    for j in range(len(start)):
        for end, place in zip(ends, _range(limits), strict=True):
            way = np.tile(start, (PLACES, 1))
            way[:, j] = np.linspace(start[j], place[j], PLACES)
            free = int(np.logical_and.accumulate(allowed(way)).sum())
            if free < PLACES:  # one place short of what is in the way
                end[j] = way[max(free - 2, 0), j]
    return replace(limits, lower=np.minimum(ends[0], start - NARROW), upper=np.maximum(ends[1], start + NARROW))


def sweeps_plan(start: Array, limits: Limits, speeds: Sequence[float] = (0.05, 0.15, 0.4, 0.8)) -> Moves:
    """Each joint back and forth at constant velocities, shares of its limit, the others in the start pose.

    A joint speeds up and slows down outside the even stretch, at no more than half its limit of acceleration.

    Args:
        start: Pose of the joints that rest, shape (n,) [rad or m].
        limits: Of the joints.
        speeds: Velocities, as shares of each joint's limit, between 0 and 1.
    """
    if not len(speeds) or not all(0.0 < speed <= 1.0 for speed in speeds):
        raise ArmidError(f"Velocities of sweeps are shares of the limit, above 0 and up to 1; found {list(speeds)}.")
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
            # From rest to a speed in T along half of speed · T, the fifth degree peaks at 1.5 speed / T.
            ramp = max(1.5 * speed / (SHARE * float(_acceleration(limits)[j])), 0.05)
            way = 0.5 * speed * ramp
            if high[j] - low[j] <= 2.5 * way:
                continue  # no room for an even stretch at this speed
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

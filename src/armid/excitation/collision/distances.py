"""Distances between bodies of the arm and of its surroundings, with their gradients by the points that are nearest.

A search asks for distances millions of times, so bodies of the arm are taken as capsules here (see
`armid.excitation.collision.capsules`), several to a body where one would be too wide. Boxes and half-spaces of the
surroundings are exact. The few pairs whose capsules overlap where bodies do not are measured by convex bodies closer
around them (`armid.excitation.collision.convex_hulls`). `armid.excitation.collision.coal` measures bodies as they
are, when a plan is done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.excitation.collision.convex_hulls import Hulls
from armid.excitation.limits.constraints import States
from armid.excitation.limits.workspace import SCALE, carried_by, point_gradient
from armid.kernel.tree import Tree
from armid.maths.spatial import homogeneous
from armid.robot.shapes import Shape, rotation_with_z
from armid.values import Array

__all__ = ["Clearance", "CollisionBodies", "floor", "nearest_on_box", "nearest_on_segments"]

TINY = 1e-12
"""Squared length [m²] below which a line is a point."""

FEW, REACH = 80, 0.15
"""Of more pairs than so many, a stage of a search looks at those that come as near to each other as this [m]: two
arms of seven joints have seven hundred pairs."""

TILE = 30000
"""Pairs times poses that are looked at at a time: what is computed of them stays in cache."""

SECTIONS = 40
"""Steps of the golden section along a capsule beside a box: 4e-9 of its length."""

GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def nearest_on_segments(uu: Array, vv: Array, uv: Array, ur: Array, vr: Array) -> tuple[Array, Array]:
    """Find where two segments are nearest each other, 0 at their beginnings a and b and 1 at their ends a + u, b + v.

    Args:
        uu: Squared length of the first.
        vv: Squared length of the second.
        uv: Product of their directions u and v, shape (..., c).
        ur: Product of u and a - b, shape (..., c).
        vr: Product of v and a - b, shape (..., c).
    """
    across = uu * vv - uv**2
    s = np.clip((uv * vr - ur * vv) / np.maximum(across, TINY * TINY), 0.0, 1.0)
    s = np.where(across > TINY * np.maximum(uu * vv, TINY), s, 0.0)
    t = np.clip((uv * s + vr) / np.maximum(vv, TINY), 0.0, 1.0)
    s = np.clip((uv * t - ur) / np.maximum(uu, TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / np.maximum(vv, TINY), 0.0, 1.0)
    return s, t


def nearest_on_box(a: Array, u: Array, half: Array) -> tuple[Array, Array, Array]:
    """Nearest point of segments to a box about the origin of their frame.

    The signed distance of a point to a box is convex, so a golden section along the segment finds it.

    Args:
        a: Where the segments begin, shape (..., 3).
        u: From beginning to end, shape (..., 3).
        half: Half the edges of the box, shape (..., 3).

    Returns:
        Places (...,) along the segments, 0 to 1, signed distances (...,) of their axes, and its slopes (..., 3).
    """
    low, high = np.zeros(a.shape[:-1]), np.ones(a.shape[:-1])
    for _ in range(SECTIONS):
        x, y = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = _box_distance(a + x[..., None] * u, half)[0] <= _box_distance(a + y[..., None] * u, half)[0]
        low, high = np.where(left, low, x), np.where(left, y, high)
    s = 0.5 * (low + high)
    return s, *_box_distance(a + s[..., None] * u, half)


def _box_distance(point: Array, half: Array) -> tuple[Array, Array]:
    """Signed distance of points to a box, and its slope."""
    beyond = np.abs(point) - half
    outside = np.maximum(beyond, 0.0)
    length = np.linalg.norm(outside, axis=-1)
    deepest = beyond.max(axis=-1)
    distance = np.where(deepest > 0.0, length, deepest)
    slope = np.where(
        (deepest > 0.0)[..., None],
        outside / np.maximum(length, TINY)[..., None],
        np.eye(3)[beyond.argmax(axis=-1)],
    )
    return distance, slope * np.sign(point)


Nearest = tuple[Array, Array, Array, Array]

NO_HULLS = Hulls((), np.zeros((0, 2), dtype=np.intp), np.zeros(0, dtype=np.intp))


@dataclass(frozen=True, eq=False, slots=True)
class CollisionBodies:
    """Capsules of the arm, and pairs of bodies with each other or with the surroundings.

    Attributes:
        capsules: Of the arm and, carried by -1, of the base and the surroundings.
        solids: Boxes and half-spaces of the surroundings.
        pairs: Indices of two capsules, or of a capsule and, counted on after the capsules, a solid, shape (c, 2).
        groups: Which pair of bodies each pair of capsules belongs to, rising from 0 without gaps, shape (c,).
        hulls: Pairs of bodies that are measured more closely; nothing of them is outside the capsules.
    """

    capsules: tuple[Shape, ...]
    solids: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    groups: NDArray[np.intp]
    hulls: Hulls = NO_HULLS

    def __len__(self) -> int:
        return len(self.first)

    @property
    def first(self) -> NDArray[np.intp]:
        """Tell where the capsules of each pair of bodies begin among `pairs`, shape (m,)."""
        return np.flatnonzero(np.diff(self.groups, prepend=-1))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the pairs of bodies."""
        every = (*self.capsules, *self.solids)
        return tuple(f"{every[a].name} - {every[b].name}" for a, b in self.pairs[self.first])

    def links(self, side: int) -> list[int]:
        """Links that carry the first or the second bodies of the pairs."""
        every = (*self.capsules, *self.solids)
        return [every[k].link for k in self.pairs[self.first, side]]

    def distances(self, poses: tuple[Array, Array], hulls: Nearest | None = None) -> Array:
        """Distances (N, m) [m].

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            hulls: What the hulls say, where that is known already.
        """
        result = self._places(*self.axes(poses))[0]
        if len(self.first) < len(self.pairs):
            result = np.minimum.reduceat(result, self.first, axis=1)
        if len(self.hulls):
            result[:, self.hulls.at] = self.hulls.distances(poses) if hulls is None else hulls[0]
        return result

    def nearest(self, poses: tuple[Array, Array], hulls: Nearest | None = None) -> Nearest:
        """Distances (N, m) [m], nearest points of both and directions from the second, each (N, m, 3).

        The nearest points of capsules are those of their axes.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            hulls: What the hulls say, where that is known already.
        """
        begin, along = self.axes(poses)
        distance, places, slopes = self._places(begin, along)
        row, at = np.arange(len(begin))[:, None], np.tile(self.first, (len(begin), 1))
        for k, (start, end) in enumerate(pairwise((*self.first, len(self.pairs)))):
            if end > start + 1:
                at[:, k] += distance[:, start:end].argmin(axis=1)
        i, j = self.pairs[at].transpose(2, 0, 1)
        solid = j >= len(self.capsules)
        j = np.where(solid, i, j)
        s, t = (place[row, at][:, :, None] for place in places)
        first = begin[row, i] + s * along[row, i]
        second = begin[row, j] + t * along[row, j]
        gap = first - second
        normal = gap / np.maximum(np.sqrt(np.einsum("nmx,nmx->nm", gap, gap)), TINY)[:, :, None]
        for k in np.flatnonzero(solid.any(axis=0)):
            normal[:, k] = np.array([slopes[pair][n] for n, pair in enumerate(at[:, k].tolist())])
        result = distance[row, at], first, second, normal
        if len(self.hulls):
            for whole, closer in zip(result, hulls or self.hulls.nearest(poses), strict=True):
                whole[:, self.hulls.at] = closer
        return result

    def _places(self, begin: Array, along: Array) -> tuple[Array, tuple[Array, Array], dict[int, Array]]:
        """Each pair of capsules by itself, from their axes (N, c, 3).

        Returns:
            Distances (N, p) [m], places (N, p) along both axes, 0 to 1, and by pair the slope (N, 3) of the distance
            to a solid; the place on a solid is that on the capsule.
        """
        count, samples = len(self.capsules), len(begin)
        radius, length, _ = np.array([capsule.size for capsule in self.capsules]).reshape(-1, 3).T
        distance, s, t = (np.zeros((samples, len(self.pairs))) for _ in range(3))
        both = np.flatnonzero(self.pairs[:, 1] < count)
        i, j = self.pairs[both].T
        block = max(1, TILE // max(1, len(both)))
        for k in range(0, samples if len(both) else 0, block):
            part = slice(k, k + block)
            b, u = begin[part], along[part]
            # All products of all axes at once are less work than a few of those that are needed.
            bb, ub, uu = (x @ y.transpose(0, 2, 1) for x, y in ((b, b), (u, b), (u, u)))
            ur, vr = ub[:, i, i] - ub[:, i, j], ub[:, j, i] - ub[:, j, j]
            one, other, uv = length[i] ** 2, length[j] ** 2, uu[:, i, j]
            x, y = nearest_on_segments(one, other, uv, ur, vr)
            rr = bb[:, i, i] + bb[:, j, j] - 2.0 * bb[:, i, j]
            squared = rr + x * (x * one + 2.0 * (ur - y * uv)) + y * (y * other - 2.0 * vr)
            distance[part, both] = np.sqrt(np.maximum(squared, 0.0)) - radius[i] - radius[j]
            s[part, both], t[part, both] = x, y
        slopes: dict[int, Array] = {}
        for k in np.flatnonzero(self.pairs[:, 1] >= count).tolist():
            carrier, solid = int(self.pairs[k, 0]), self.solids[int(self.pairs[k, 1]) - count]
            R, o = solid.placement[:3, :3], solid.placement[:3, 3]
            a, u = (begin[:, carrier] - o) @ R, along[:, carrier] @ R
            if solid.kind == "half-space":
                place = np.where(u[:, 2] < 0.0, 1.0, 0.0)
                gap, slope = a[:, 2] + place * u[:, 2], np.tile([0.0, 0.0, 1.0], (samples, 1))
            else:
                place, gap, slope = nearest_on_box(a, u, 0.5 * solid.size)
            distance[:, k], slopes[k] = gap - radius[carrier], slope @ R.T
            s[:, k] = t[:, k] = place
        return distance, (s, t), slopes

    def axes(self, poses: tuple[Array, Array]) -> tuple[Array, Array]:
        """Tell where the axes of the capsules begin, and from there to their ends, base frame, (N, c, 3)."""
        R, p = poses
        begin, along = (np.empty((len(p), len(self.capsules), 3)) for _ in range(2))
        for k, capsule in enumerate(self.capsules):
            axis, centre = capsule.size[1] * capsule.placement[:3, 2], capsule.placement[:3, 3]
            if capsule.link < 0:
                begin[:, k], along[:, k] = centre - 0.5 * axis, axis
            else:
                begin[:, k] = p[:, capsule.link] + R[:, capsule.link] @ (centre - 0.5 * axis)
                along[:, k] = R[:, capsule.link] @ axis
        return begin, along

    def lengths(self, poses: tuple[Array, Array], tree: Tree) -> Array:
        """Tell how far the points of each capsule are at most from each joint's axis, shape (N, c, n) [m].

        The distance to a line is convex, so one of the ends of the capsule's axis is the furthest.
        """
        begin, along = self.axes(poses)
        R, p = poses
        axes = np.einsum("njik,jk->nji", R, tree.axis)[:, None]
        result = np.zeros((len(p), len(self.capsules), tree.n))
        for end in (begin, begin + along):
            away = end[:, :, None] - p[:, None]
            away -= (away * axes).sum(axis=-1, keepdims=True) * axes
            np.maximum(result, np.linalg.norm(away, axis=-1), out=result)
        return result + np.array([capsule.size[0] for capsule in self.capsules])[:, None]

    def approach(self, poses: tuple[Array, Array], tree: Tree, speed: Array, beyond: float = 0.0) -> Array:
        """Bound (N, m) [m/s] of how fast the bodies of each pair come together.

        Only the joints between them do that, and none moves a point faster than its speed times how far the point is
        from its axis.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            tree: The arm's geometry.
            speed: Of the joints, shape (n,) or (N, n) [rad/s or m/s].
            beyond: What is added to every distance from an axis [m].
        """
        reach = np.where(tree.prismatic.astype(np.bool_), 1.0, self.lengths(poses, tree) + beyond)
        one, other = (carried_by(tree, self.links(side)) for side in (0, 1))
        solid = self.pairs[:, 1] >= len(self.capsules)
        i, j = self.pairs[:, 0], np.where(solid, 0, self.pairs[:, 1])
        # A joint that carries both moves neither by the other; one that carries a solid does not exist.
        at = self.groups
        moved = reach[:, i] * (one * (1.0 - other))[at] + reach[:, j] * (other * (1.0 - one))[at]
        fastest = (moved @ speed[:, :, None])[:, :, 0] if speed.ndim == 2 else moved @ speed
        return np.maximum.reduceat(fastest, self.first, axis=1)

    def only(self, which: Sequence[int] | NDArray[np.intp]) -> CollisionBodies:
        """Some of the pairs of bodies, in rising order."""
        chosen = np.isin(self.groups, np.asarray(which, dtype=np.intp))
        kept, groups = np.unique(self.groups[chosen], return_inverse=True)
        return CollisionBodies(self.capsules, self.solids, self.pairs[chosen], groups, self.hulls.only(kept))


@dataclass(frozen=True, eq=False, slots=True)
class Clearance:
    """Pairs of bodies stay apart.

    Attributes:
        name: What it is.
        bodies: Which, and which pairs of them.
        margin: Distance that stays between them, of each pair, shape (m,) or one for all [m].
        spare: What a search keeps beyond it, of each pair, shape (m,) or one for all [m].
    """

    name: str
    bodies: CollisionBodies
    margin: Array | float
    spare: Array | float = 0.0

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the pairs."""
        return self.bodies.labels

    @property
    def margins(self) -> Array:
        """Distance that each pair keeps, shape (m,) [m]."""
        return np.broadcast_to(self.margin, len(self.labels))

    def near(self, states: States) -> Clearance:
        """Pairs that matter to a motion and to others like it: all where they are few, else those within reach."""
        if len(self.labels) <= FEW:
            return self
        which = np.flatnonzero(self._distances(states).min(axis=0) < self.margin + REACH)
        spare = np.broadcast_to(self.spare, len(self.labels))[which]
        return replace(self, bodies=self.bodies.only(which), margin=self.margins[which], spare=spare)

    def values(self, states: States) -> Array:
        """One less the room that is left over a tenth of a metre, shape (N, m)."""
        return 1.0 - (self._distances(states) - self.margin - self.spare) / SCALE

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k): the nearest points move with the links that carry them."""
        _, first, second, normal = self._nearest(states)
        forces = -weights[:, :, None] * normal / SCALE
        by_q = np.zeros((*weights.shape, states.tree.n))
        for side, points, sign in ((0, first, 1.0), (1, second, -1.0)):
            mask = carried_by(states.tree, self.bodies.links(side))
            by_q += point_gradient(states.tree, states.poses, mask, points, sign * forces)
        return states.pull_positions(by_q)

    def between(self, states: States, step: float) -> Array:
        """Tell how far each pair may come together between points of a grid beyond its closest there, as a share.

        Two bodies approach each other no faster than the joints between them move the points of either, so half a
        step brings them together by no more than that. For pairs that are far apart a rougher bound does: no point of
        the arm is further from an axis than the widest spread of all points.
        """
        distance, speed = self._distances(states), states.speed_bound
        begin, along = self.bodies.axes(states.poses)
        places = (begin, begin + along, states.poses[1])
        spread = 2.0 * max(float(np.abs(points).max(initial=0.0)) for points in places) * 3.0**0.5
        size = max((float(capsule.size[:2].sum()) for capsule in self.bodies.capsules), default=0.0)
        reach = np.where(states.tree.prismatic.astype(np.bool_), 1.0, spread + size)
        total = np.full(len(self.labels), step * float(speed @ reach))
        close = np.flatnonzero(distance.min(axis=0) - total < self.margin + SCALE)
        if len(close):
            nearer = distance[:, close] - self._approach(states, step, self.bodies.only(close), float(speed @ reach))
            total[close] = distance[:, close].min(axis=0) - nearer.min(axis=0)
        return total / SCALE

    def _approach(self, states: States, step: float, bodies: CollisionBodies, fastest: float) -> Array:
        """Tell how far (N, m) [m] pairs may come together within half a step of each point of a grid.

        Args:
            states: The motion.
            step: Of the grid [s].
            bodies: The pairs.
            fastest: Bound of the speed of any point of the arm [m/s].
        """
        half = 0.5 * step
        speed = np.abs(states.derivatives[1]) + half * states.basis.peaks_between(states.x, 2)
        return half * bodies.approach(states.poses, states.tree, speed, half * fastest)

    def _hulls(self, states: States) -> Nearest | None:
        """Return what the hulls say, asked once a point of a search."""
        if not len(self.bodies.hulls):
            return None
        if id(self) not in states.hulls:
            states.hulls[id(self)] = self.bodies.hulls.nearest(states.poses)
        return states.hulls[id(self)]

    def _nearest(self, states: States) -> Nearest:
        """Distances, nearest points and directions, computed once a point of a search."""
        if id(self) not in states.nearest:
            states.nearest[id(self)] = self.bodies.nearest(states.poses, self._hulls(states))
        return states.nearest[id(self)]

    def _distances(self, states: States) -> Array:
        """Distances alone, which are a third of the work."""
        if id(self) in states.nearest:
            return states.nearest[id(self)][0]
        if id(self) not in states.distances:
            states.distances[id(self)] = self.bodies.distances(states.poses, self._hulls(states))
        return states.distances[id(self)]


def floor(height: float = 0.0, gravity: ArrayLike = (0.0, 0.0, -1.0)) -> Shape:
    """Everything further down than a height [m], counted upwards from the base.

    Args:
        height: Where it begins; negative below the base, as the floor under a hanging arm.
        gravity: Which way is down in the base frame, shape (3,); without gravity that is -z.
    """
    up = -np.asarray(gravity, dtype=np.float64)
    up = up / np.linalg.norm(up) if up.any() else np.array([0.0, 0.0, 1.0])
    return Shape("floor", -1, "half-space", np.zeros(3), homogeneous(rotation_with_z(up), height * up))

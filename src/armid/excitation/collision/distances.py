"""Distances between bodies of the arm and of its surroundings, with gradients computed from the nearest points.

A search computes distances millions of times. It therefore represents the bodies of the arm by capsules
(`armid.excitation.collision.capsules`). A body for which one capsule would be too wide is represented by several.
Boxes and half-spaces of the surroundings are exact. If capsules overlap but bodies do not, tighter convex hulls are
used (`armid.excitation.collision.hull_distances`). After a plan is finished, `armid.excitation.collision.coal`
computes the distances of the bodies themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array
from armid.excitation.collision.hull_distances import Hulls
from armid.excitation.collision.segment_distances import TINY, nearest_on_box, nearest_on_segments
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.workspace import SCALE, carried_by, point_gradient
from armid.kernel.tree import Tree
from armid.maths.rotations import homogeneous
from armid.robot.collision_body_names import BodyPair
from armid.robot.shapes import Shape, rotation_with_z

FEW, REACH = 80, 0.15
"""Number of pairs of bodies above which a stage of a search uses only the pairs that come close; and largest excess
distance of a pair that counts as close [m]. Two arms of seven joints, for instance, have seven hundred pairs."""

TILE = 30000
"""Number of pairs times poses that are computed at a time; the data then fit into the processor's cache."""


Nearest = tuple[Array, Array, Array, Array]

NO_HULLS = Hulls((), np.zeros((0, 2), dtype=np.intp), np.zeros(0, dtype=np.intp))


@dataclass(frozen=True, eq=False, slots=True)
class CollisionBodies:
    """Bounding capsules of an arm, solids of the surroundings, and pairs of bodies.

    Attributes:
        capsules: Capsules of the arm, and with link -1 the capsules of the base and the surroundings.
        solids: Boxes and half-spaces of the surroundings.
        pairs: Indices of two capsules, or of a capsule and a solid, shape (c, 2); the solids are numbered after the
            capsules.
        groups: Index of the pair of bodies to which each pair of capsules belongs, in ascending order from 0 without
            gaps, shape (c,).
        hulls: Pairs of bodies whose distances are computed with tighter convex hulls, which lie inside the capsules.
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
        """Index of the first pair of capsules of each pair of bodies, shape (m,)."""
        return np.flatnonzero(np.diff(self.groups, prepend=-1))

    @property
    def labels(self) -> tuple[BodyPair, ...]:
        """Names of the two bodies of each pair."""
        every = (*self.capsules, *self.solids)
        return tuple(BodyPair(every[a].name, every[b].name) for a, b in self.pairs[self.first])

    def links(self, side: int) -> list[int]:
        """Index of the link of the first (side 0) or the second (side 1) body of each pair; -1 for the base."""
        every = (*self.capsules, *self.solids)
        return [every[k].link for k in self.pairs[self.first, side]]

    def distances(
        self, poses: tuple[Array, Array], hulls: Nearest | None = None, reach: Array | None = None
    ) -> Array:
        """Distances of the m pairs of bodies in N poses, shape (N, m) [m].

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            hulls: Result of `Hulls.nearest` in the same poses, if it is already known.
            reach: Distances of capsules above which the distances of hulls are not computed, shape (m,) [m].
        """
        result = self._places(*self.axes(poses))[0]
        if len(self.first) < len(self.pairs):
            result = np.minimum.reduceat(result, self.first, axis=1)
        at = self.hulls.at
        if hulls is not None:
            result[:, at] = hulls[0]
        elif reach is not None:
            result[:, at] = self.hulls.distances_below(reach[at], result[:, at], poses)
        elif len(at):
            result[:, at] = self.hulls.distances(poses)
        return result

    def nearest(self, poses: tuple[Array, Array], hulls: Nearest | None = None) -> Nearest:
        """Distances (N, m) [m] of the pairs, nearest points of both bodies, and unit vectors between them.

        Points and vectors have shape (N, m, 3) each. The vectors point from the second to the first body. For
        capsules, the nearest points on their axes are returned.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            hulls: Result of `Hulls.nearest` in the same poses, if it is already known.
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
        """Distances and nearest points of each pair of capsules, or of a capsule and a solid.

        `begin` and `along` are the start points and the vectors of the axes of the capsules, shape (N, c, 3) each.

        Returns:
            For `pairs` of length p: distances (N, p) [m]; positions (N, p) of the nearest points along both axes,
            from 0 to 1; and for each pair with a solid the gradient (N, 3) of the distance. For a solid, the position
            on the axis of the capsule is given twice.
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
            # All products of all axes in one matrix product are faster than only the needed ones.
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
        """Start points of the axes of c capsules, and vectors to their end points, (N, c, 3) each [m].

        Points and vectors are in the base frame, for N poses.
        """
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
        """Largest distance of the points of each capsule from each joint axis in N poses, shape (N, c, n) [m].

        The distance from a line is a convex function, so its maximum along the axis of a capsule is at one end of the
        axis.
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

    def approach(self, poses: tuple[Array, Array], tree: Tree, speed: Array, extra: float = 0.0) -> Array:
        """Upper bound of the speed at which the two bodies of each pair approach each other, shape (N, m) [m/s].

        Only the joints between two bodies change the distance of these bodies. A revolute joint moves a point with at
        most the speed of the joint times the distance of the point from the joint axis.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
            tree: The arm's geometry.
            speed: Joint speeds, shape (n,) or (N, n) [rad/s or m/s].
            extra: Distance [m] that is added to the distance of every point from a joint axis.
        """
        reach = np.where(tree.prismatic.astype(np.bool_), 1.0, self.lengths(poses, tree) + extra)
        one, other = (carried_by(tree, self.links(side)) for side in (0, 1))
        solid = self.pairs[:, 1] >= len(self.capsules)
        i, j = self.pairs[:, 0], np.where(solid, 0, self.pairs[:, 1])
        # A joint that moves both bodies does not change their distance; no joint moves a solid.
        at = self.groups
        of_one, of_other = (one * (1.0 - other))[at], (other * (1.0 - one))[at]
        fastest: Array = np.empty((len(reach), len(at)))
        block = max(1, TILE // max(1, len(at)))
        for k in range(0, len(reach), block):
            part = slice(k, k + block)
            moved = reach[part][:, i] * of_one + reach[part][:, j] * of_other
            fastest[part] = (moved @ speed[part, :, None])[:, :, 0] if speed.ndim == 2 else moved @ speed
        return np.maximum.reduceat(fastest, self.first, axis=1)

    def only(self, which: Sequence[int] | NDArray[np.intp]) -> CollisionBodies:
        """Bounding volumes of selected pairs of bodies, given by indices in ascending order."""
        chosen = np.isin(self.groups, np.asarray(which, dtype=np.intp))
        kept, groups = np.unique(self.groups[chosen], return_inverse=True)
        return CollisionBodies(self.capsules, self.solids, self.pairs[chosen], groups, self.hulls.only(kept))


@dataclass(frozen=True, eq=False, slots=True)
class Clearance:
    """Constraint channel of the distances between the bodies of m pairs.

    Attributes:
        name: Name of the limited quantity.
        bodies: The bodies and their pairs.
        margin: Smallest allowed distance of each pair, shape (m,), or one number for all pairs [m].
        spare: Additional distance that a search keeps, shape (m,), or one number for all pairs [m].
    """

    name: str
    bodies: CollisionBodies
    margin: Array | float
    spare: Array | float = 0.0

    @property
    def labels(self) -> tuple[BodyPair, ...]:
        """Names of the two bodies of each pair."""
        return self.bodies.labels

    @property
    def margins(self) -> Array:
        """Smallest allowed distance of each pair, shape (m,) [m]."""
        return np.broadcast_to(self.margin, len(self.bodies))

    def near(self, states: States) -> Clearance:
        """Channel for motions near a given one; if there are many pairs, it has only those that come close."""
        if len(self.bodies) <= FEW:
            return self
        return self.only(np.flatnonzero(self._distances(states).min(axis=0) < self.margin + REACH))

    def only(self, which: NDArray[np.intp]) -> Clearance:
        """Channel of selected pairs, given by indices in ascending order."""
        spare = np.broadcast_to(self.spare, len(self.bodies))[which]
        return replace(self, bodies=self.bodies.only(which), margin=self.margins[which], spare=spare)

    def values(self, states: States) -> Array:
        """Utilisations (N, m): 1 - (distance - required distance) / `SCALE`.

        The required distance includes the additional distance of a search.
        """
        return 1.0 - (self._distances(states) - self.margin - self.spare) / SCALE

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m).

        The gradient of a distance follows from the motion of the two nearest points with their links.
        """
        _, first, second, normal = self._nearest(states)
        forces = -weights[:, :, None] * normal / SCALE
        by_q = np.zeros((*weights.shape, states.tree.n))
        for side, points, sign in ((0, first, 1.0), (1, second, -1.0)):
            mask = carried_by(states.tree, self.bodies.links(side))
            by_q += point_gradient(states.tree, states.poses, mask, points, sign * forces)
        return states.pullback_positions(by_q)

    def between(self, states: States, step: float) -> Array:
        """Upper bound (m,) of the rise of the utilisation of each pair between neighbouring points of a grid.

        The utilisation of a pair is 1 at the required distance, and 0 at a distance that is larger by `SCALE`. Two
        bodies approach each other at most at the speed at which the joints between them move their points. Any
        instant is at most half a step [s] from the nearest point of the grid. For pairs that are far apart a rougher
        bound is used: the size of the whole arm instead of the distances of points from the joint axes.
        """
        distance, speed = self._distances(states), states.speed_bound
        begin, along = self.bodies.axes(states.poses)
        places = (begin, begin + along, states.poses[1])
        spread = 2.0 * max(float(np.abs(points).max(initial=0.0)) for points in places) * 3.0**0.5
        size = max((float(capsule.size[:2].sum()) for capsule in self.bodies.capsules), default=0.0)
        reach = np.where(states.tree.prismatic.astype(np.bool_), 1.0, spread + size)
        total = np.full(len(self.bodies), step * float(speed @ reach))
        close = np.flatnonzero(distance.min(axis=0) - total < self.margin + SCALE)
        if len(close):
            nearer = distance[:, close] - self._approach(states, step, self.bodies.only(close), float(speed @ reach))
            total[close] = distance[:, close].min(axis=0) - nearer.min(axis=0)
        return total / SCALE

    def _approach(self, states: States, step: float, bodies: CollisionBodies, fastest: float) -> Array:
        """Upper bound (N, m) [m] of the approach of each pair of bodies within half a step from each point of a grid.

        Args:
            states: States of the motion on the grid.
            step: Step of the grid [s].
            bodies: Pairs of bodies.
            fastest: Upper bound of the speed of any point of the arm [m/s].
        """
        half = 0.5 * step
        speed = np.abs(states.derivatives[1]) + half * states.basis.peaks_between(states.x, 2)
        return half * bodies.approach(states.poses, states.tree, speed, half * fastest)

    def _hulls(self, states: States) -> Nearest | None:
        """Distances, nearest points and directions of the hulls; cached for the motion."""
        if not len(self.bodies.hulls):
            return None
        if id(self) not in states.hulls:
            states.hulls[id(self)] = self.bodies.hulls.nearest(states.poses)
        return states.hulls[id(self)]

    def _nearest(self, states: States) -> Nearest:
        """Distances, nearest points and directions of all pairs; cached for the motion."""
        if id(self) not in states.nearest:
            states.nearest[id(self)] = self.bodies.nearest(states.poses, self._hulls(states))
        return states.nearest[id(self)]

    def _distances(self, states: States) -> Array:
        """Distances of all pairs, shape (N, m) [m], without nearest points, in a third of the time of `_nearest`."""
        if id(self) in states.nearest:
            return states.nearest[id(self)][0]
        if id(self) not in states.distances:
            if states.rough:
                found = self.bodies.distances(states.poses, reach=self.margins + self.spare + SCALE)
            else:
                found = self.bodies.distances(states.poses, self._hulls(states))
            states.distances[id(self)] = found
        return states.distances[id(self)]


def floor(height: float = 0.0, gravity: ArrayLike = (0.0, 0.0, -1.0)) -> Shape:
    """Shape of the floor: the half-space below a height.

    Args:
        height: Height of the floor above the origin of the base frame [m]; negative below it.
        gravity: Direction of gravity in the base frame, shape (3,); if it is zero, -z is used.
    """
    up = -np.asarray(gravity, dtype=np.float64)
    up = up / np.linalg.norm(up) if up.any() else np.array([0.0, 0.0, 1.0])
    return Shape("floor", -1, "half-space", np.zeros(3), homogeneous(rotation_with_z(up), height * up))

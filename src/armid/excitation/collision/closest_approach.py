"""Closest approach of bodies along a motion, computed with Coal after a plan is finished.

The search and its certificate use capsules and hulls on their own grids. Here the distance of every pair is computed
again, pose by pose. Primitive shapes (sphere, box, capsule) are represented exactly. A cylinder is enclosed in a
prism. A mesh is cut into slices; it is replaced by the convex hulls of the slices, which together contain the mesh.
For the few pairs whose hulls overlap although the bodies do not, the triangles of the meshes are used. Preflight
pages and the exit code report these distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.excitation.collision.coal import distances, too_close, whole
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.convex_hulls import parts_of
from armid.robot.body_names import BodyPair
from armid.values import Array

RATE = 250.0
"""Rate of the poses in which distances are computed [Hz]."""

EVERY = 5
"""Stride of the poses in which distances are computed first. Then the poses next to the closest one are added. For
pairs that are measured by their triangles, all poses in which the required distance is not kept are added."""

FIRST = 8
"""Number of poses, those with the closest capsules, in which distances are computed before the others."""

NEAR = 0.05
"""Lower bound of a distance [m] up to which a pair is tested for a constant distance. Other pairs are not among the
closest of a list."""

CONSTANT = 3e-3
"""Largest change of a distance that counts as constant [m]. If the real distance of two neighbouring links is
constant, the distance of their hulls changes by up to 2.5 mm (measured at the wrist of the robot TIAGo)."""

MOMENTS = 24
"""Number of poses in which a pair is tested for a constant distance."""

ROUNDING = 1e-6
"""Tolerance [m] for the difference between the iterative distances of Coal and those of the certificate."""


@dataclass(frozen=True, slots=True)
class ClosestApproach:
    """Closest approach of two bodies.

    Attributes:
        pair: Names of the two bodies.
        distance: Distance between them, negative where they overlap [m].
        time: Time of the closest approach [s].
        asked: Required distance [m].
        measured: Representation with which the distance was computed: `bodies`, `hulls` or `triangles`.
        constant: Whether the distance is the same in all poses of the motion, as between neighbouring links that turn
            against each other across a narrow gap.
    """

    pair: BodyPair
    distance: float
    time: float
    asked: float
    measured: str = "bodies"
    constant: bool = False

    @property
    def kept(self) -> bool:
        """Tests whether the required distance is kept."""
        return self.distance >= self.asked - ROUNDING


def closest_approaches(
    collision: CollisionOptions, times: Array, poses: tuple[Array, Array]
) -> tuple[ClosestApproach, ...]:
    """Closest approach of every checked pair, nearest first; pairs with a constant distance come last.

    Args:
        collision: Pairs of bodies that must be kept apart.
        times: Times of the poses, shape (N,) [s].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links at these times.
    """
    found: list[ClosestApproach] = []
    bound = collision.every.bodies.distances(poses) if len(collision.pairs) else np.zeros((len(times), 0))
    constant = np.isfinite(constant_distances(collision, poses, bound)).tolist()
    if len(collision.pairs):
        margins = collision.every.margins
        for k, label in enumerate(collision.every.labels):
            distance, at = _least(collision, collision.pairs[k], bound[:, k], poses)
            meshes = any(collision.shapes[i].kind in ("mesh", "cylinder") for i in collision.pairs[k])
            by, asked = "hulls" if meshes else "bodies", float(margins[k])
            found.append(ClosestApproach(label, distance, float(times[at]), asked, by, constant[k]))
    for k, (pair, kept) in enumerate(zip(collision.measured, collision.kept, strict=True), len(collision.pairs)):
        distance, at = _by_triangles(collision, pair, float(kept), poses)
        label = BodyPair(*(collision.shapes[i].name for i in pair))
        found.append(ClosestApproach(label, distance, float(times[at]), float(kept), "triangles", constant[k]))
    return tuple(sorted(found, key=lambda each: (each.constant, each.distance)))


def constant_distances(collision: CollisionOptions, poses: tuple[Array, Array], bound: Array) -> Array:
    """Distances of pairs of links that are built close to each other and keep the same distance in all poses.

    Three cases are not counted as constant: distances below the required one, distances to the surroundings, and the
    case that all distances are constant because the arm hardly moves.

    Args:
        collision: Pairs of bodies that must be kept apart.
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        bound: Lower bounds of the distances of `collision.pairs` in these poses, shape (N, m) [m].

    Returns:
        Distances of the pairs of `collision.pairs` and then of `collision.measured`, shape (m + r,) [m]; NaN for
        pairs whose distance changes, and for all pairs if there is only one pose.
    """
    count = len(collision.pairs)
    result = np.full(count + len(collision.measured), np.nan)
    if len(poses[1]) < 2:
        return result
    moments = np.unique(np.linspace(0, len(poses[1]) - 1, MOMENTS).astype(np.intp))
    some = poses[0][moments], poses[1][moments]
    required = np.concatenate([collision.every.margins if count else [], collision.kept])
    near = np.flatnonzero(bound.min(axis=0) < NEAR).tolist()
    for k in (*near, *range(count, len(result))):
        pair = collision.pairs[[k]] if k < count else collision.measured[[k - count]]
        apart = distances(collision.shapes, pair, some, parts_of if k < count else whole)[:, 0]
        apart = np.maximum(apart, bound[moments, k]) if k < count else apart
        if np.ptp(apart) <= CONSTANT and apart.min() >= required[k] - ROUNDING and pair.max() < collision.own:
            result[k] = apart.min()
    return np.full(len(result), np.nan) if np.isfinite(result).all() else result


def _least(
    collision: CollisionOptions, pair: NDArray[np.intp], bound: Array, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Smallest distance of the convex parts of two bodies, and index of its pose; `bound` is a lower bound."""

    def measured(which: NDArray[np.intp]) -> Array:
        some = poses[0][which], poses[1][which]
        # Capsules and convex parts both contain the body, so the larger distance holds; a simplified hull may reach
        # beyond the capsules.
        return np.maximum(distances(collision.shapes, pair[None], some, parts_of)[:, 0], bound[which])

    coarse = np.arange(0, len(bound), EVERY)
    coarse = coarse[bound[coarse].argsort(kind="stable")]
    first = coarse[:FIRST]
    seen = measured(first)
    candidates = coarse[FIRST:][bound[coarse[FIRST:]] < seen.min()]
    where, distance = np.concatenate([first, candidates]), np.concatenate([seen, measured(candidates)])
    middle = int(where[distance.argmin()])
    neighbours = np.arange(max(middle - EVERY + 1, 0), min(middle + EVERY, len(bound)))
    where, distance = np.concatenate([where, neighbours]), np.concatenate([distance, measured(neighbours)])
    k = int(distance.argmin())
    return float(distance[k]), int(where[k])


def _by_triangles(
    collision: CollisionOptions, pair: NDArray[np.intp], kept: float, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Smallest distance of the bodies themselves over some of the poses and all poses in which they are too close."""
    wrong = np.flatnonzero(too_close(collision.shapes, pair, kept, poses))
    which = np.union1d(np.arange(0, len(poses[1]), EVERY * EVERY), wrong)
    some = poses[0][which], poses[1][which]
    apart = distances(collision.shapes, pair[None], some)[:, 0]
    k = int(apart.argmin())
    return float(apart[k]), int(which[k])

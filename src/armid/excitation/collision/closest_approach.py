"""Distances of bodies along a motion, measured anew when a plan is done.

The search and its certificate know bodies by capsules and hulls on a grid of their own; here every pair is looked at
once more, pose by pose, by Coal: primitives as they are, meshes as the convex hulls of their slabs, which contain
them, and the few pairs whose hulls overlap where bodies do not by their triangles. What is said of a plan, on its
pages and by the exit code, is what is found here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.excitation.collision.coal import distances, too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.convex_hulls import parts_of
from armid.values import Array

__all__ = ["RATE", "ClosestApproach", "closest_approaches"]

RATE = 250.0
"""Poses a second in which bodies are measured [Hz]."""

EVERY = 5
"""Of these poses one in so many is measured first, then those beside the closest; triangles that come closer than
they should are looked for in all."""

FIRST = 8
"""Poses, those in which capsules are closest, that are measured before the others are compared with them."""

ROUNDING = 1e-6
"""Metres by which iterations of Coal may differ from the distances that a certificate rests on."""


@dataclass(frozen=True, slots=True)
class ClosestApproach:
    """Closest approach of two bodies.

    Attributes:
        pair: Their names.
        distance: Between them, negative where they overlap [m].
        time: When [s].
        asked: Distance that they should keep [m].
    """

    pair: str
    distance: float
    time: float
    asked: float

    @property
    def kept(self) -> bool:
        """Tell whether they do."""
        return self.distance >= self.asked - ROUNDING


def closest_approaches(
    collision: CollisionOptions, times: Array, poses: tuple[Array, Array]
) -> tuple[ClosestApproach, ...]:
    """Closest approach of every pair that should stay apart, nearest first.

    Args:
        collision: The bodies.
        times: Shape (N,) [s].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links then.
    """
    found: list[ClosestApproach] = []
    if len(collision.pairs):
        bound = collision.every.bodies.distances(poses)
        for k, label in enumerate(collision.every.labels):
            distance, at = _least(collision, collision.pairs[k], bound[:, k], poses)
            found.append(ClosestApproach(label, distance, float(times[at]), float(collision.every.margins[k])))
    for pair, kept in zip(collision.measured, collision.kept, strict=True):
        distance, at = _by_triangles(collision, pair, float(kept), poses)
        label = " - ".join(collision.shapes[i].name for i in pair)
        found.append(ClosestApproach(label, distance, float(times[at]), float(kept)))
    return tuple(sorted(found, key=lambda each: each.distance))


def _least(
    collision: CollisionOptions, pair: NDArray[np.intp], bound: Array, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Least distance of two bodies by their convex parts, and in which pose; nothing is nearer than its bound."""

    def measured(which: NDArray[np.intp]) -> Array:
        some = poses[0][which], poses[1][which]
        # Bodies lie in their capsules and in their convex parts; a thinned hull may reach beyond capsules.
        return np.maximum(distances(collision.shapes, pair[None], some, parts_of)[:, 0], bound[which])

    coarse = np.arange(0, len(bound), EVERY)
    coarse = coarse[bound[coarse].argsort(kind="stable")]
    first = coarse[:FIRST]
    seen = measured(first)
    more = coarse[FIRST:][bound[coarse[FIRST:]] < seen.min()]
    where, apart = np.concatenate([first, more]), np.concatenate([seen, measured(more)])
    middle = int(where[apart.argmin()])
    beside = np.arange(max(middle - EVERY + 1, 0), min(middle + EVERY, len(bound)))
    where, apart = np.concatenate([where, beside]), np.concatenate([apart, measured(beside)])
    k = int(apart.argmin())
    return float(apart[k]), int(where[k])


def _by_triangles(
    collision: CollisionOptions, pair: NDArray[np.intp], kept: float, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Least distance of two bodies as they are in some poses, and in all in which they are too close."""
    wrong = np.flatnonzero(too_close(collision.shapes, pair, kept, poses))
    which = np.union1d(np.arange(0, len(poses[1]), EVERY * EVERY), wrong)
    some = poses[0][which], poses[1][which]
    apart = distances(collision.shapes, pair[None], some)[:, 0]
    k = int(apart.argmin())
    return float(apart[k]), int(which[k])

"""Required distance of each pair of bodies: the margin, less for bodies that are close by construction, or none.

Bodies two joints apart may be only a few millimetres apart by construction, in all or most poses. They cannot keep
the margin, but they can collide. Their required distance is therefore half of their usual distance. Pairs that
overlap in nearly all poses are not checked, as in MoveIt's setup assistant. The pair of the first link and the mount
is not checked either. Pairs two joints apart that overlap in more than two thirds of the poses are checked only if a
search can compute their distance and a start pose with enough free range remains. The reason is that no real joint is
free in less than a third of its range, so the bodies of such a pair are wider than the real links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.collision.coal import distances
from armid.excitation.collision.pairs import joints_between, stands
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

BY_CAPSULES, MEASURED, LEFT_OUT = 0, 1, 2
"""Ways to check a pair: with bounding volumes; with the bodies themselves, after the search; or not at all."""

NEIGHBOURS = 2
"""Largest number of joints between two links that may be close by construction."""

CONSTRUCTION = 0.5
"""Share of random poses with a distance below the margin, above which a pair may be close by construction."""

MOSTLY, ALWAYS, FAR = 2.0 / 3.0, 0.95, 0.99
"""Shares of random poses in which bodies overlap. Above the first share, a pair of neighbours may be excluded. Above
the second share, which is that of MoveIt's setup assistant, neighbours count as always touching. From the third share
on, links further apart are excluded: this happens if a description has, for instance, an elbow of two pieces."""

LEAST = 1e-3
"""Usual distance [m] up to which two bodies count as touching."""

HALF, QUARTER = 0.5, 0.25
"""Shares of the usual distance of a close pair: the required distance, and the additional distance that a search
keeps."""

OFTEN = 0.25
"""Share of poses that the hulls of neighbours may exclude. If they exclude more, and the triangles exclude less than
half of that, the distance of the pair is computed with its triangles."""

FREE = 0.75
"""Quantile of the distances: if it is above the margin, a pair is not close by construction."""

FEW = 100
"""Number of poses in which distances are computed with the triangles of bodies."""

USUAL, RARE = 0.9, 0.05
"""Quantiles of the distance of bodies whose hulls overlap in most poses. The first gives the usual distance. If this
is not above the margin, the second is used, over the poses in which the bodies do not touch. Such bodies turn against
each other across a narrow gap, which a search cannot represent. The required distance must therefore exclude few
poses in addition to those in which the bodies touch."""


@dataclass(frozen=True, eq=False, slots=True)
class RequiredDistances:
    """Required distances of m pairs of bodies.

    Attributes:
        margin: Smallest allowed distance, shape (m,) [m].
        spare: Additional distance that a search keeps, shape (m,) [m].
        kind: `BY_CAPSULES`, `MEASURED` or `LEFT_OUT`, shape (m,).
        touching: Share of random poses in which bodies overlap, or for the pair of first link and mount are closer
            than the margin, shape (m,); only for pairs that are or may be excluded, zero for others.
        close: Mask of the pairs that are close by construction, shape (m,).
    """

    margin: Array
    spare: Array
    kind: NDArray[np.intp]
    touching: Array
    close: NDArray[np.bool_]

    def of(self, kind: int) -> NDArray[np.bool_]:
        """Mask of the pairs that are checked in a given way (`kind`), shape (m,)."""
        return self.kind == kind

    @property
    def dispensable(self) -> NDArray[np.bool_]:
        """Mask of the checked pairs of neighbours that overlap in most poses, shape (m,)."""
        return (self.touching > MOSTLY) & ~self.of(LEFT_OUT)

    def lowered(self, distance: Array) -> RequiredDistances:
        """Required distances for a start pose with distances (m,) [m]; those of close pairs may be lowered."""
        lower = self.close & (distance > LEAST) & (distance < self.margin)
        return replace(self, margin=np.where(lower, HALF * distance, self.margin))


def uniform_distances(margin: float, spare: Array) -> RequiredDistances:
    """Required distances with the same margin [m] for all pairs, and additional distances (m,) [m] for a search."""
    count = len(spare)
    far = np.zeros(count, dtype=np.bool_)
    return RequiredDistances(np.full(count, margin), spare, np.full(count, BY_CAPSULES), np.zeros(count), far)


def adjusted_distances(
    required: RequiredDistances,
    robot: Robot,
    shapes: Sequence[Shape],
    pairs: NDArray[np.intp],
    tried: Array,
    around: Array,
    touching: Array,
) -> RequiredDistances:
    """Required distances adjusted for pairs that are close by construction.

    Args:
        required: Required distances before.
        robot: The arm.
        shapes: The bodies, the surroundings last.
        pairs: Indices of the two bodies of each pair, shape (m, 2).
        tried: Random poses, shape (k, n) [rad or m].
        around: Distances of the bounding volumes in these poses, shape (k, m) [m].
        touching: Share of random poses in which the distance of the bounding volumes is below the margin, shape (m,).
    """
    margin, spare, share = required.margin.copy(), required.spare.copy(), required.touching.copy()
    kind, close = required.kind.copy(), required.close.copy()
    poses = forward_kinematics(robot, tried[:FEW])
    for k in np.flatnonzero(touching > CONSTRUCTION).tolist():
        apart = joints_between(robot, *(shapes[i].link for i in pairs[k]))
        if stands(robot, shapes, int(pairs[k].max())):
            if apart == 1:
                kind[k], share[k] = LEFT_OUT, touching[k]
            continue
        close[k] = apart <= NEIGHBOURS
        usual = float(np.median(around[:, k]))
        distant = apart > NEIGHBOURS and usual > LEAST and touching[k] < FAR
        if distant or float(np.quantile(around[:, k], FREE)) > margin[k]:
            continue
        if usual <= LEAST:
            actual = distances(tuple(shapes), pairs[[k]], poses)[:, 0]
            overlap = float((actual <= 0.0).mean())
            if overlap > ALWAYS if apart <= NEIGHBOURS else overlap >= FAR:
                kind[k], share[k] = LEFT_OUT, overlap
                continue
            if apart > NEIGHBOURS:
                continue
            share[k] = overlap * (overlap > MOSTLY)
            usual = float(np.quantile(around[:, k], USUAL))
            if usual <= max(LEAST, HALF * float(np.quantile(actual, USUAL))):
                kind[k] = MEASURED
                usual = _usual_gap(actual, float(margin[k]))
        if kind[k] != MEASURED and apart <= NEIGHBOURS:
            usual, kind[k] = _of_neighbours(tuple(shapes), pairs[[k]], poses, around[:, k], (usual, float(margin[k])))
        margin[k] = min(margin[k], HALF * usual)
        spare[k] = min(spare[k], QUARTER * usual)
    kind[(kind == MEASURED) & (share > MOSTLY)] = LEFT_OUT  # a search does not see them, and would run into them
    return RequiredDistances(margin, spare, kind, share, close)


def _usual_gap(actual: Array, margin: float) -> float:
    """Usual distance [m] of bodies with distances (k,) in random poses; a small one if few are above a margin."""
    usual = max(float(np.quantile(actual, USUAL)), 0.0)
    if usual > margin or not (actual > 0.0).any():
        return usual
    return float(np.quantile(actual[actual > 0.0], RARE))


def _of_neighbours(
    shapes: tuple[Shape, ...],
    pair: NDArray[np.intp],
    poses: tuple[Array, Array],
    around: Array,
    kept: tuple[float, float],
) -> tuple[float, int]:
    """Usual distance of two neighbours [m], and the way in which the pair is checked.

    Args:
        shapes: The bodies.
        pair: Indices of the two bodies, shape (1, 2).
        poses: Rotations and origins of the links in some of the random poses.
        around: Distances of the bounding volumes of the two bodies in random poses, shape (k,) [m].
        kept: Usual distance of the bounding volumes, and margin [m].
    """
    usual, margin = kept
    excluded = float((around < min(margin, HALF * usual)).mean())
    if excluded > OFTEN:
        actual = distances(shapes, pair, poses)[:, 0]
        middle = max(float(np.median(actual)), 0.0)
        if float((actual <= min(margin, HALF * middle)).mean()) < HALF * excluded:
            return middle, MEASURED
    return usual, BY_CAPSULES

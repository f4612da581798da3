"""Required distance of each pair of bodies: the user's margin, or less if bodies are close by construction.

Bodies with two joints between them may be only a few millimetres apart by construction, in all or most poses. They
cannot keep the margin, but they can collide. Their required distance is therefore at most half of their usual
distance, or the largest of 20, 50 and 100 mm that they exceed in a quarter of the poses, whichever is larger. This
upper limit does not depend on the margin, so a larger margin never leads to a smaller required distance. Pairs that
overlap in nearly all poses are not checked, as in MoveIt's setup assistant. The pair of the first link and the mount
is not checked either, if the two are closer than the margin in most poses.

Some pairs with two joints between them overlap in more than two thirds of the poses. Every real joint can move in
more than a third of its range, so the bodies of such a pair are wider than the real links. These pairs are checked
only if a search can compute their distance and a start pose with enough free range remains.
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
"""Ways to check a pair: with bounding volumes; with the bodies themselves after the search; not at all."""

NEIGHBOURS = 2
"""Largest number of joints between two links that count as neighbours, which may be close by construction."""

CONSTRUCTION = 0.5
"""Share of random poses in which the distance of a pair is below the margin, above which the pair may be close by
construction."""

MOSTLY, ALWAYS, FAR = 2.0 / 3.0, 0.95, 0.99
"""Shares of random poses in which bodies overlap. Above the first share, a pair of neighbours may be excluded. Above
the second share, which MoveIt's setup assistant uses, too, neighbours count as always touching. At and above the
third share, pairs of links that are not neighbours are excluded; this happens if a description has, for instance, an
elbow of two pieces."""

LEAST = 1e-3
"""Largest usual distance of two bodies that count as touching [m]."""

HALF, QUARTER = 0.5, 0.25
"""Required distance of a pair that is close by construction, and additional distance that a search keeps, both
divided by the usual distance of the pair."""

OFTEN = 0.25
"""Share of poses that the hulls of neighbours exclude, above which the triangles of the bodies are tested, too. If
the triangles exclude less than half of this share, the distance of the pair is computed with the triangles."""

FREE = 0.75
"""Share of random poses that defines the distance that a pair can reach: in this share of the poses the pair is
closer, in the others (a quarter) it is further apart. For links with more than `NEIGHBOURS` joints between them, the
share `FAR` is used instead, because such links can move away from each other."""

LEVELS = (0.02, 0.05, 0.1)
"""Distances [m] of which a pair must keep the largest one that is below the quantile `FREE` of its distance, even if
half of its usual distance is less. The values do not depend on the margin, because a larger margin must not lead to
smaller required distances. The first one is the margin by default: pairs that exceed it too seldom are close by
construction."""

FEW = 100
"""Number of random poses in which distances are computed with the triangles of bodies."""

USUAL, RARE = 0.9, 0.05
"""Probabilities of two quantiles of the distance of bodies whose hulls overlap in most poses. The first quantile
gives the usual distance. If this distance is at most the first of `LEVELS`, the second quantile is used, over the
poses in which the bodies do not touch. Such bodies turn against each other across a narrow gap, which a search cannot
represent. The required distance must therefore exclude few poses in addition to those in which the bodies touch."""


@dataclass(frozen=True, eq=False, slots=True)
class RequiredDistances:
    """Required distances of m pairs of bodies, and the ways in which the pairs are checked.

    Attributes:
        margin: Required distance, shape (m,) [m].
        spare: Additional distance that a search keeps, shape (m,) [m].
        kind: Way in which each pair is checked: `BY_CAPSULES`, `MEASURED` or `LEFT_OUT`, shape (m,).
        touching: Share of random poses in which the bodies overlap, shape (m,). For the pair of first link and mount,
            it is the share of poses in which they are closer than the margin. It is computed only for pairs that are
            or may be excluded, and zero for others.
        close: Mask of the pairs that are close by construction, shape (m,).
    """

    margin: Array
    spare: Array
    kind: NDArray[np.intp]
    touching: Array
    close: NDArray[np.bool_]

    def of(self, kind: int) -> NDArray[np.bool_]:
        """Mask of the pairs that are checked in the way `kind`, shape (m,)."""
        return self.kind == kind

    @property
    def dispensable(self) -> NDArray[np.bool_]:
        """Mask of the checked pairs of neighbours that overlap in most poses, shape (m,)."""
        return (self.touching > MOSTLY) & ~self.of(LEFT_OUT)

    def lowered(self, distance: Array) -> RequiredDistances:
        """Required distances, lowered for close pairs that cannot keep them in a start pose.

        `distance` contains the distances in the start pose, shape (m,) [m].
        """
        lower = self.close & (distance > LEAST) & (distance < self.margin)
        least = np.array([largest_required(d, d) for d in distance.tolist()])
        return replace(self, margin=np.where(lower, least, self.margin))


def uniform_distances(margin: float, spare: Array) -> RequiredDistances:
    """Required distances with the same margin [m] for all pairs, and additional distances `spare` (m,) [m]."""
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
        required: Required distances before the adjustment.
        robot: The arm.
        shapes: The bodies, the surroundings last.
        pairs: Indices of the two bodies of each pair, shape (m, 2).
        tried: Random poses, shape (k, n) [rad or m].
        around: Distances of the bounding volumes in the poses `tried`, shape (k, m) [m].
        touching: Share of random poses in which the distance of the bounding volumes is below the margin, shape (m,);
            NaN for pairs that the user has excluded.
    """
    margin, spare, share = required.margin.copy(), required.spare.copy(), required.touching.copy()
    kind, close = required.kind.copy(), required.close.copy()
    poses = forward_kinematics(robot, tried[:FEW])
    for k in np.flatnonzero(np.isfinite(touching)).tolist():
        apart = joints_between(robot, *(shapes[i].link for i in pairs[k]))
        if stands(robot, shapes, int(pairs[k].max())):
            if apart == 1 and touching[k] > CONSTRUCTION:
                kind[k], share[k] = LEFT_OUT, touching[k]
            continue
        neighbours = apart <= NEIGHBOURS
        close[k] = neighbours and float((around[:, k] < max(margin[k], LEVELS[0])).mean()) > CONSTRUCTION
        usual = float(np.median(around[:, k]))
        often = float(np.quantile(around[:, k], FREE if neighbours or usual <= LEAST else FAR))
        if often > LEVELS[0]:
            if neighbours or (LEAST < usual and often <= LEVELS[-1]):
                _lower(k, (margin, spare), usual, often)
            continue
        if usual <= LEAST:
            usual, kind[k], share[k] = _of_overlapping(tuple(shapes), pairs[[k]], poses, around[:, k], neighbours)
            if kind[k] == LEFT_OUT or not neighbours:
                continue
        if kind[k] != MEASURED and neighbours:
            usual, kind[k] = _of_neighbours(tuple(shapes), pairs[[k]], poses, around[:, k], usual)
        _lower(k, (margin, spare), usual, often)
    kind[(kind == MEASURED) & (share > MOSTLY)] = LEFT_OUT  # a search does not see them, and would run into them
    return RequiredDistances(margin, spare, kind, share, close)


def often_near(
    margin: float, robot: Robot, shapes: Sequence[Shape], pairs: NDArray[np.intp], distance: Array
) -> NDArray[np.bool_]:
    """Mask of the pairs whose required distance must be determined with tight bounding volumes, shape (m,).

    The mask selects the pairs that are closer than the margin in most poses, and the pairs of neighbours (links with
    at most two joints between them) that cannot keep the margin.

    Args:
        margin: The margin [m].
        robot: The arm.
        shapes: The bodies, the surroundings last.
        pairs: Indices of the two bodies of each pair, shape (m, 2).
        distance: Distances of the bounding volumes in random poses, shape (k, m) [m].
    """
    result = (distance < max(margin, LEVELS[0])).mean(axis=0) > CONSTRUCTION
    if margin <= LEVELS[0] or not len(pairs):
        return result
    usual, often = np.quantile(distance, [0.5, FREE], axis=0)
    for k, pair in enumerate(pairs):
        neighbours = joints_between(robot, *(shapes[i].link for i in pair)) <= NEIGHBOURS
        result[k] |= neighbours and largest_required(float(usual[k]), float(often[k])) < margin
    return result


def largest_required(usual: float, often: float) -> float:
    """Largest distance [m] that can be required of a pair that is close by construction, for any margin.

    The result depends on the bodies alone, so the required distance never decreases when the user requires a larger
    margin.

    Args:
        usual: Usual distance of the bodies [m].
        often: Distance that the bodies exceed in a quarter of random poses [m].
    """
    return max(HALF * usual, 0.0, *(level for level in LEVELS if level < often))


def _lower(k: int, kept: tuple[Array, Array], usual: float, often: float) -> None:
    """Lowers the required distance and the additional distance of pair k, if its bodies cannot keep them.

    `kept` contains both distances of all pairs, shape (m,) each [m]; it is changed in place. The other arguments are
    those of `largest_required`.
    """
    margin, spare = kept
    most = largest_required(usual, often)
    if often <= LEVELS[0] or most < margin[k]:
        margin[k] = min(margin[k], most)
        spare[k] = min(spare[k], QUARTER * usual)


def _of_overlapping(
    shapes: tuple[Shape, ...], pair: NDArray[np.intp], poses: tuple[Array, Array], around: Array, neighbours: bool
) -> tuple[float, int, float]:
    """Usual distance [m] of bodies whose bounding volumes overlap in most poses, way to check them, share of overlap.

    Args:
        shapes: The bodies.
        pair: Indices of the two bodies, shape (1, 2).
        poses: Rotations and origins of the links in some of the random poses.
        around: Distances of the bounding volumes in random poses, shape (k,) [m].
        neighbours: True if at most two joints are between the links of the bodies.
    """
    actual = distances(shapes, pair, poses)[:, 0]
    overlap = float((actual <= 0.0).mean())
    if overlap > ALWAYS if neighbours else overlap >= FAR:
        return 0.0, LEFT_OUT, overlap
    if not neighbours:
        return 0.0, BY_CAPSULES, 0.0
    share = overlap * (overlap > MOSTLY)
    usual = float(np.quantile(around, USUAL))
    if usual > max(LEAST, HALF * float(np.quantile(actual, USUAL))):
        return usual, BY_CAPSULES, share
    return _usual_gap(actual), MEASURED, share


def _usual_gap(actual: Array) -> float:
    """Usual distance [m] of two bodies, a quantile of their distances (k,) in random poses.

    If the bodies seldom exceed 20 mm, it is a low quantile of the positive distances.
    """
    usual = max(float(np.quantile(actual, USUAL)), 0.0)
    if usual > LEVELS[0] or not (actual > 0.0).any():
        return usual
    return float(np.quantile(actual[actual > 0.0], RARE))


def _of_neighbours(
    shapes: tuple[Shape, ...],
    pair: NDArray[np.intp],
    poses: tuple[Array, Array],
    around: Array,
    usual: float,
) -> tuple[float, int]:
    """Usual distance of two neighbours [m], and the way in which the pair is checked.

    Args:
        shapes: The bodies.
        pair: Indices of the two bodies, shape (1, 2).
        poses: Rotations and origins of the links in some of the random poses.
        around: Distances of the bounding volumes of the two bodies in random poses, shape (k,) [m].
        usual: Usual distance of the bounding volumes [m].
    """
    excluded = float((around < HALF * usual).mean())
    if excluded > OFTEN:
        actual = distances(shapes, pair, poses)[:, 0]
        middle = max(float(np.median(actual)), 0.0)
        if float((actual <= HALF * middle).mean()) < HALF * excluded:
            return middle, MEASURED
    return usual, BY_CAPSULES

"""Distance that each pair of bodies keeps: that asked for, less where the arm is built closer, or nothing at all.

Bodies two joints apart may be a few millimetres apart by construction, in every pose or in most; they cannot keep the
distance that is asked of others, but they can collide. They keep half of what is usually between them. Only what
overlaps in all poses but a few is left out, as by MoveIt's setup assistant, and so is the first link above what the
arm is mounted on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.excitation.collision.coal import distances
from armid.excitation.collision.pairs import joints_between, stands
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.values import Array

__all__ = ["BY_CAPSULES", "CONSTRUCTION", "LEFT_OUT", "MEASURED", "RequiredDistances", "everything", "settled"]

BY_CAPSULES, MEASURED, LEFT_OUT = 0, 1, 2
"""How a pair is looked at: by what goes around the bodies, as they are and at the end alone, or not at all."""

NEIGHBOURS = 2
"""Links so many joints apart may be close by construction."""

CONSTRUCTION = 0.5
"""Such links are so if they are closer than what is asked in more than this share of random poses."""

ALWAYS, FAR = 0.95, 0.99
"""Bodies that overlap in this share of random poses are not looked at; links further apart than neighbours need more,
as a description with an elbow of two pieces has it. MoveIt's setup assistant has 0.95."""

LEAST = 1e-3
"""Distance [m] below which bodies count as touching in most poses."""

HALF, QUARTER = 0.5, 0.25
"""Shares of the usual distance of a close pair that it keeps, and that a search keeps beyond."""

FREE = 0.75
"""A pair that keeps what is asked in a quarter of the poses goes on keeping it."""

FEW = 100
"""Poses in which bodies are measured by their triangles."""


@dataclass(frozen=True, eq=False, slots=True)
class RequiredDistances:
    """Distances kept by each of m pairs of bodies.

    Attributes:
        margin: Least distance, shape (m,) [m].
        spare: What a search keeps beyond it, shape (m,) [m].
        kind: `BY_CAPSULES`, `MEASURED` or `LEFT_OUT`, shape (m,).
        touching: Share of random poses in which bodies that are left out overlap, or are closer than the margin to
            what the arm is mounted on, shape (m,).
        close: Which pairs are close by construction, shape (m,).
    """

    margin: Array
    spare: Array
    kind: NDArray[np.intp]
    touching: Array
    close: NDArray[np.bool_]

    def of(self, kind: int) -> NDArray[np.bool_]:
        """Tell which pairs are looked at in a way, shape (m,)."""
        return self.kind == kind

    def lowered(self, distance: Array) -> RequiredDistances:
        """The same where close pairs are closer yet in the start pose, at distances (m,) [m]: half of these."""
        lower = self.close & (distance > LEAST) & (distance < self.margin)
        return replace(self, margin=np.where(lower, HALF * distance, self.margin))


def everything(margin: float, spare: Array) -> RequiredDistances:
    """All pairs keep the same margin [m], and a search so much beyond it, shape (m,) [m]."""
    count = len(spare)
    far = np.zeros(count, dtype=np.bool_)
    return RequiredDistances(np.full(count, margin), spare, np.full(count, BY_CAPSULES), np.zeros(count), far)


def settled(
    keeping: RequiredDistances,
    robot: Robot,
    shapes: Sequence[Shape],
    pairs: NDArray[np.intp],
    tried: Array,
    around: Array,
    touching: Array,
) -> RequiredDistances:
    """Return what pairs keep that are close by construction.

    Args:
        keeping: What all keep otherwise.
        robot: The arm.
        shapes: The bodies, the surroundings last.
        pairs: Indices of two bodies each, shape (m, 2).
        tried: Random poses, shape (k, n) [rad or m].
        around: Distances of what is around the bodies in these poses, shape (k, m) [m].
        touching: Share of random poses in which that is closer than what is asked, shape (m,).
    """
    margin, spare, share = keeping.margin.copy(), keeping.spare.copy(), keeping.touching.copy()
    kind, close = keeping.kind.copy(), keeping.close.copy()
    poses = forward_kinematics(robot, tried[:FEW])
    for k in np.flatnonzero(touching > CONSTRUCTION).tolist():
        apart = joints_between(robot, *(shapes[i].link for i in pairs[k]))
        if stands(robot, shapes, int(pairs[k].max())):
            if apart == 1:
                kind[k], share[k] = LEFT_OUT, touching[k]
            continue
        close[k] = apart <= NEIGHBOURS
        usual = float(np.median(around[:, k]))
        if apart > NEIGHBOURS and usual > LEAST and touching[k] < FAR:
            continue
        if float(np.quantile(around[:, k], FREE)) > margin[k]:
            continue
        if usual <= LEAST:
            actual = distances(tuple(shapes), pairs[[k]], poses)[:, 0]
            overlap = float((actual <= 0.0).mean())
            if overlap >= (ALWAYS if apart <= NEIGHBOURS else FAR):
                kind[k], share[k] = LEFT_OUT, overlap
                continue
            if apart > NEIGHBOURS:
                continue
            usual = float(np.quantile(around[:, k], 0.9))
            if usual <= max(LEAST, HALF * float(np.quantile(actual, 0.9))):
                kind[k] = MEASURED
                usual = max(float(np.quantile(actual, 0.9)), 0.0)
        margin[k] = min(margin[k], HALF * usual)
        spare[k] = min(spare[k], QUARTER * usual)
    return RequiredDistances(margin, spare, kind, share, close)

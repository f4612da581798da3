"""Which bodies of an arm are nearest each other, or nearest the surroundings, at each moment of a motion.

Capsules around the bodies, in NumPy and for all moments at once, say which pairs can be the nearest; Coal measures
those as they are, one after the other, until no capsule is left that is nearer than the nearest body found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.excitation.coal import between
from armid.excitation.collision import NEIGHBOURS, joints_between, pairs_of_bodies
from armid.report.preview.clip import Clip
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.values import Array

__all__ = ["Approach", "closest", "watched"]

MOMENTS = 600
"""Moments of a motion that are measured at most; between two of them the page interpolates."""

TOUCHING = 0.02
"""Distance [m] below which neighbours of neighbours count as touching by construction where the motion begins, as in
designed plans. Such neighbours whose distance does not even change by as much are held apart by construction."""


@dataclass(frozen=True, eq=False, slots=True)
class Approach:
    """The nearest two bodies over time, M moments.

    Attributes:
        time: Shape (M,) [s].
        distance: Shape (M,) [m]; negative where bodies overlap.
        pair: Index of the pair in `pairs`, shape (M,).
        points: Nearest points of the two in the base frame, shape (M, 2, 3) [m].
        pairs: Names of all pairs that are looked at.
    """

    time: Array
    distance: Array
    pair: NDArray[np.intp]
    points: Array
    pairs: tuple[str, ...]


def closest(
    robot: Robot, clip: Clip, surroundings: tuple[Shape, ...] = (), pairs: NDArray[np.intp] | None = None
) -> Approach | None:
    """The nearest bodies along a motion; `None` where the description has no bodies to measure.

    Args:
        robot: The arm, with shapes.
        clip: The motion.
        surroundings: Bodies that do not move.
        pairs: Those that are looked at, indices into the arm's shapes and then the surroundings, shape (m, 2); all
            that should stay apart if left out.
    """
    shapes = (*robot.shapes, *surroundings)
    bodies, every_pair = pairs_of_bodies(robot, shapes)
    if not len(every_pair):
        return None
    moments = np.unique(np.linspace(0, len(clip.time) - 1, MOMENTS).astype(np.intp))
    turned, placed = forward_kinematics(robot, clip.q[moments])
    bound = bodies.nearest((turned, placed))[0]
    measure = between(shapes)
    begin = np.array([measure(int(a), int(b), (turned[0], placed[0]))[0] for a, b in every_pair])
    kept = watched(robot, shapes, every_pair, begin, bound)
    if pairs is not None:
        kept &= _among(every_pair, pairs)
    if not kept.any():
        return None
    pairs, bound = every_pair[kept], bound[:, kept]
    samples = len(moments)
    distance, pair, points = np.full(samples, np.inf), np.zeros(samples, np.intp), np.zeros((samples, 2, 3))
    for k, order in enumerate(bound.argsort(axis=1)):
        for m in order:
            if bound[k, m] >= distance[k]:
                break
            found, places = measure(int(pairs[m, 0]), int(pairs[m, 1]), (turned[k], placed[k]))
            if found < distance[k]:
                distance[k], pair[k], points[k] = found, m, places
    names = tuple(f"{shapes[a].name} – {shapes[b].name}" for a, b in pairs)
    return Approach(clip.time[moments], distance, pair, points, names)


def watched(
    robot: Robot, shapes: tuple[Shape, ...], pairs: NDArray[np.intp], begin: Array, bound: Array
) -> NDArray[np.bool_]:
    """Which pairs of bodies (m,) should stay apart, and move against each other.

    Neighbours of neighbours that touch where the motion begins are left out, and so is what the arm stands on, and
    such neighbours that are held at a distance.

    Args:
        robot: The arm.
        shapes: Its bodies, the surroundings last.
        pairs: Indices of two bodies each, those next to each other left out, shape (m, 2).
        begin: Their distances where the motion begins, shape (m,) [m].
        bound: Distances of capsules around them along the motion, shape (N, m) [m].
    """
    links = np.array([[shapes[k].link for k in pair] for pair in pairs])
    near = np.array([joints_between(robot, int(a), int(b)) <= NEIGHBOURS for a, b in links])
    stands = (pairs.max(axis=1) >= len(robot.shapes)) & (links.max(axis=1) <= 0)
    touching = (near | stands) & (begin <= TOUCHING)
    held = near & (np.ptp(bound, axis=0) <= TOUCHING) & (len(bound) > 1)
    return ~(touching | held) if (~(touching | held)).any() else ~touching


def _among(every: NDArray[np.intp], wanted: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which of the pairs (m, 2) are among others."""
    known = {tuple(sorted(map(int, pair))) for pair in wanted}
    return np.array([tuple(sorted(map(int, pair))) in known for pair in every])

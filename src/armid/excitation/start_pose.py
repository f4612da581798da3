"""Start of a series if nobody says: a pose with room around it.

A series swings about its start pose, so what counts is how far the joints can go from there, all at once and either
way, before one meets a limit, a body another, or gravity asks for more torque than there is. That is measured along
straight lines in a few random directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.excitation.collision.collision_model import CollisionModel, kept_apart
from armid.excitation.limits.joint_limits import Limits
from armid.values import Array

__all__ = ["Holds", "Start", "any_pose", "choose_start", "free_range", "usual_pose"]

INSIDE = 0.05
"""Share of a joint's range that a pose keeps from its ends where it is chosen here."""

SWING = 1.5
"""How far a joint would like to swing either way [rad]; a sliding one by half its range."""

WANDER = 2.0
"""How far from the usual pose a turning joint is looked for [rad]."""

LOOKED = 1500
"""Random poses that are looked at."""

SHORT = 40
"""How many of them, those furthest from all bodies, are looked at more closely."""

DIRECTIONS = 24
"""Lines through a pose."""

STEPS = np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
"""Places along a line, in shares of the swing."""

ROOMY = 0.85
"""Share of the greatest room found at which the usual pose is kept: people know it."""

PLAIN = 0.98
"""Share of its room that a pose may lose where a joint goes to its usual place or a round number."""


Holds = Callable[[Array], NDArray[np.bool_]]
"""Whether the joints can hold poses (N, n) with the torque they have, shape (N,)."""


def any_pose(q: Array) -> NDArray[np.bool_]:
    """Every pose can be held, as far as is known, shape (N,)."""
    return np.ones(len(q), dtype=np.bool_)


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """A pose to begin from.

    Attributes:
        pose: Shape (n,) [rad or m].
        room: Share of the wanted swing that is free around it, 0 to 1.
        usual: Whether it is the usual one.
    """

    pose: Array
    room: float
    usual: bool


def usual_pose(limits: Limits) -> Array:
    """Zero where a joint can be there, else the middle of its range, shape (n,) [rad or m]."""
    bounded = np.isfinite(limits.upper - limits.lower)
    low, high = np.where(bounded, limits.lower, -1.0), np.where(bounded, limits.upper, 1.0)
    ends = INSIDE * (high - low)
    return np.where((low + ends > 0.0) | (high - ends < 0.0), 0.5 * (low + high), 0.0)


def choose_start(cell: CollisionModel, limits: Limits, holds: Holds = any_pose) -> Start:
    """The pose with most room of many random ones, or the usual one where that has hardly less.

    Args:
        cell: The arm and its surroundings.
        limits: Of its joints.
        holds: Which poses the joints can hold.

    Raises:
        ArmidError: In none of the poses do all bodies keep apart, or none can be held.
    """
    usual = usual_pose(limits)
    low, high = _ends(limits)
    wander = np.where(cell.robot.tree.prismatic.astype(np.bool_), np.inf, WANDER)
    rng = np.random.default_rng(0)
    between = np.maximum(low, usual - wander), np.minimum(high, usual + wander)
    poses = np.vstack([usual, rng.uniform(*between, (LOOKED, len(usual)))])
    distance = cell.clear(poses)
    order = np.concatenate([[0], 1 + np.argsort(-distance[1:], kind="stable")])
    order = order[distance[order] >= 0.0]
    if not len(order):
        kept_apart(cell, usual)
        raise ArmidError(
            f"No pose of {cell.robot.name} was found in which all bodies keep apart.",
            remedy="give a pose with --start, or less --clearance.",
        )
    order = order[holds(poses[order])][:SHORT]
    order = order[cell.apart(poses[order])]
    if not len(order):
        raise ArmidError(
            f"No pose of {cell.robot.name} was found in which all bodies keep apart and which its torques can hold.",
            remedy="relax the effort limits with --limit, the --torque-margin or the --clearance, or give --start.",
        )
    rooms = np.array([free_range(cell, limits, poses[k], holds) for k in order])
    if order[0] == 0 and rooms[0] >= ROOMY * rooms.max():
        return Start(usual, float(rooms[0]), usual=True)
    best = int(rooms.argmax())
    pose = _plain(cell, limits, holds, poses[order[best]], usual, PLAIN * float(rooms[best]))
    return Start(pose, free_range(cell, limits, pose, holds), usual=False)


def _plain(cell: CollisionModel, limits: Limits, holds: Holds, pose: Array, usual: Array, enough: float) -> Array:
    """A pose with as many joints at their usual places, or at round numbers, as leave room enough."""
    for j in range(len(pose)):
        for value in (usual[j], *(round(pose[j] * parts) / parts for parts in (2, 10, 100))):
            trial = pose.copy()
            trial[j] = value
            free = cell.clear(trial[None])[0] >= 0.0 and bool(cell.apart(trial[None])[0])
            free = free and limits.lower[j] < value < limits.upper[j] and bool(holds(trial[None])[0])
            if free and free_range(cell, limits, trial, holds) >= enough:
                pose = trial
                break
    return pose


def _ends(limits: Limits) -> tuple[Array, Array]:
    """Tell how far a pose may be from the middle of each joint's range."""
    ends = np.where(np.isfinite(limits.upper - limits.lower), INSIDE * (limits.upper - limits.lower), 0.0)
    return np.maximum(limits.lower + ends, -1e3), np.minimum(limits.upper - ends, 1e3)


def free_range(cell: CollisionModel, limits: Limits, pose: Array, holds: Holds = any_pose) -> float:
    """Share of the wanted swing that is free around a pose, the mean over lines through it.

    Args:
        cell: The arm and its surroundings.
        limits: Of its joints.
        pose: Shape (n,) [rad or m].
        holds: Which poses the joints can hold.
    """
    half = 0.5 * (limits.upper - limits.lower)
    swing = np.where(cell.robot.tree.prismatic.astype(np.bool_), half, np.minimum(half, SWING))
    lines = np.random.default_rng(1).uniform(-1.0, 1.0, (DIRECTIONS, len(pose))) * swing
    q = pose + (STEPS[:, None, None] * lines).reshape(-1, len(pose))
    inside = ((q > limits.lower) & (q < limits.upper)).all(axis=1)
    apart = cell.room(q) >= 0.0
    free = (inside & apart & holds(q)).reshape(len(STEPS), DIRECTIONS)
    middle = len(STEPS) // 2
    after = np.logical_and.accumulate(free[middle:], axis=0).mean()
    before = np.logical_and.accumulate(free[middle - 1 :: -1], axis=0).mean()
    return float(0.5 * (after + before))

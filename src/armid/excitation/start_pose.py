"""Choice of the start pose of a series where the user gives none: a pose with much free range around it.

A series swings about its start pose. Its amplitude ends where a joint meets a limit, bodies collide, or gravity needs
more torque than the joints have. The free range of a pose is therefore measured along straight lines through it in
random directions of the joint space.
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
"""Share of a joint's range by which a chosen pose stays away from either end."""

SWING = 1.5
"""Wanted swing of a revolute joint to either side [rad]; that of a prismatic joint is half its range."""

WANDER = 2.0
"""Largest distance of a revolute joint from the usual pose in a random pose [rad]."""

LOOKED = 1500
"""Random poses whose distances are computed."""

SHORT = 40
"""Number of these, with the largest distances, whose free range is computed."""

DIRECTIONS = 24
"""Random lines through a pose."""

STEPS = np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
"""Positions along a line, as shares of the wanted swing."""

ROOMY = 0.85
"""Share of the largest free range from which the usual pose is preferred, because users know it."""

PLAIN = 0.98
"""Share of its free range that a pose keeps where a joint is moved to its usual position or a round number."""


Holds = Callable[[Array], NDArray[np.bool_]]
"""Test, shape (N,), whether the joint torques suffice to hold poses (N, n) against gravity."""


def any_pose(q: Array) -> NDArray[np.bool_]:
    """Test that accepts every pose (N, n), for arms whose torques are not known; shape (N,)."""
    return np.ones(len(q), dtype=np.bool_)


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """Start pose of a series.

    Attributes:
        pose: Shape (n,) [rad or m].
        free_share: Share of the wanted swing that is free around it, 0 to 1.
        usual: Whether it is the usual pose.
    """

    pose: Array
    free_share: float
    usual: bool


def usual_pose(limits: Limits) -> Array:
    """Pose with zero for each joint whose range contains it, else the middle of the range, shape (n,) [rad or m]."""
    bounded = np.isfinite(limits.upper - limits.lower)
    low, high = np.where(bounded, limits.lower, -1.0), np.where(bounded, limits.upper, 1.0)
    ends = INSIDE * (high - low)
    return np.where((low + ends > 0.0) | (high - ends < 0.0), 0.5 * (low + high), 0.0)


def choose_start(cell: CollisionModel, limits: Limits, holds: Holds = any_pose) -> Start:
    """Pose with the largest free range of many random ones, or the usual pose where its free range is similar.

    Args:
        cell: Arm and surroundings.
        limits: Limits of the joints.
        holds: Test whether the joints can hold poses.

    Raises:
        ArmidError: Bodies are too close in all of the poses, or the joints can hold none.
    """
    usual = usual_pose(limits)
    low, high = _ends(limits)
    wander = np.where(cell.robot.tree.prismatic.astype(np.bool_), np.inf, WANDER)
    rng = np.random.default_rng(0)
    between = np.maximum(low, usual - wander), np.minimum(high, usual + wander)
    poses = np.vstack([usual, rng.uniform(*between, (LOOKED, len(usual)))])
    distance = cell.search_excess_distance(poses)
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
    ranges = np.array([free_range(cell, limits, poses[k], holds) for k in order])
    if order[0] == 0 and ranges[0] >= ROOMY * ranges.max():
        return Start(usual, float(ranges[0]), usual=True)
    best = int(ranges.argmax())
    pose = _rounded(cell, limits, holds, poses[order[best]], usual, PLAIN * float(ranges[best]))
    return Start(pose, free_range(cell, limits, pose, holds), usual=False)


def _rounded(cell: CollisionModel, limits: Limits, holds: Holds, pose: Array, usual: Array, enough: float) -> Array:
    """Pose with joints moved to usual positions or round numbers while its free range stays large enough."""
    for j in range(len(pose)):
        for value in (usual[j], *(round(pose[j] * parts) / parts for parts in (2, 10, 100))):
            trial = pose.copy()
            trial[j] = value
            free = cell.search_excess_distance(trial[None])[0] >= 0.0 and bool(cell.apart(trial[None])[0])
            free = free and limits.lower[j] < value < limits.upper[j] and bool(holds(trial[None])[0])
            if free and free_range(cell, limits, trial, holds) >= enough:
                pose = trial
                break
    return pose


def _ends(limits: Limits) -> tuple[Array, Array]:
    """Lowest and highest positions of a chosen pose, shape (n,) each [rad or m]."""
    ends = np.where(np.isfinite(limits.upper - limits.lower), INSIDE * (limits.upper - limits.lower), 0.0)
    return np.maximum(limits.lower + ends, -1e3), np.minimum(limits.upper - ends, 1e3)


def free_range(cell: CollisionModel, limits: Limits, pose: Array, holds: Holds = any_pose) -> float:
    """Share of the wanted swing that is free around a pose, as the mean over random lines through it.

    Args:
        cell: Arm and surroundings.
        limits: Limits of the joints.
        pose: Shape (n,) [rad or m].
        holds: Test whether the joints can hold poses.
    """
    half = 0.5 * (limits.upper - limits.lower)
    swing = np.where(cell.robot.tree.prismatic.astype(np.bool_), half, np.minimum(half, SWING))
    lines = np.random.default_rng(1).uniform(-1.0, 1.0, (DIRECTIONS, len(pose))) * swing
    q = pose + (STEPS[:, None, None] * lines).reshape(-1, len(pose))
    inside = ((q > limits.lower) & (q < limits.upper)).all(axis=1)
    apart = cell.excess_distance(q) >= 0.0
    free = (inside & apart & holds(q)).reshape(len(STEPS), DIRECTIONS)
    middle = len(STEPS) // 2
    after = np.logical_and.accumulate(free[middle:], axis=0).mean()
    before = np.logical_and.accumulate(free[middle - 1 :: -1], axis=0).mean()
    return float(0.5 * (after + before))

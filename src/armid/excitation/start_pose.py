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
from armid.excitation.collision.collision_model import CollisionModel
from armid.excitation.limits.joint_limits import Limits
from armid.values import Array

INSIDE = 0.05
"""Share of a joint's range by which a chosen pose stays away from either end."""

SWING = 1.5
"""Wanted swing of a revolute joint to either side [rad]; that of a prismatic joint is half its range."""

WANDER = 2.0
"""Largest distance of a revolute joint from the usual pose in a random pose [rad]."""

LOOKED = 1500
"""Random poses whose distances are computed."""

WIDER = 6000
"""Random poses in the whole range of each joint, where none of the first ones is good."""

SHORT = 40
"""Number of them, those furthest from all bodies, that are checked exactly in one batch."""

COUNTED, NAMED = 1000, 4
"""Random poses of which an error tells what excludes them, and joints and pairs that it names."""

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


@dataclass(frozen=True, eq=False, slots=True)
class TorqueHolds:
    """Test of poses by the torque that holds them.

    Attributes:
        joints: Names of the k joints whose torque is limited.
        shares: Share (N, k) of its limit that each needs in poses (N, n).
        highest: Share that it may need.
    """

    joints: tuple[str, ...]
    shares: Callable[[Array], Array]
    highest: float

    def __call__(self, q: Array) -> NDArray[np.bool_]:
        """Tell which poses (N, n) the joints can hold, shape (N,)."""
        return np.asarray((self.shares(q) <= self.highest).all(axis=1), dtype=np.bool_)


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
    found = find_start(cell, limits, holds)
    if found is None:
        raise _no_start(cell, _good(cell, limits, usual_pose(limits), holds)[0][1:], holds)
    return found


def find_start(cell: CollisionModel, limits: Limits, holds: Holds = any_pose) -> Start | None:
    """Pose as of `choose_start`; `None` where there is none."""
    usual = usual_pose(limits)
    poses, order = _good(cell, limits, usual, holds)
    if not len(order):
        return None
    rooms = np.array([free_range(cell, limits, poses[k], holds) for k in order])
    if order[0] == 0 and rooms[0] >= ROOMY * rooms.max():
        return Start(usual, float(rooms[0]), usual=True)
    best = int(rooms.argmax())
    pose = _rounded(cell, limits, holds, poses[order[best]], usual, PLAIN * float(rooms[best]))
    return Start(pose, free_range(cell, limits, pose, holds), usual=False)


def _good(cell: CollisionModel, limits: Limits, usual: Array, holds: Holds) -> tuple[Array, NDArray[np.intp]]:
    """Random poses (N, n), the usual one first, and the best of those that are good, furthest from all bodies first.

    First those about the usual pose, then those in the whole range of each joint.
    """
    low, high = _ends(limits)
    wander = np.where(cell.robot.tree.prismatic.astype(np.bool_), np.inf, WANDER)
    near = np.maximum(low, usual - wander), np.minimum(high, usual + wander)
    unbounded = ~np.isfinite(limits.upper - limits.lower)
    whole = np.where(unbounded, -np.pi, low), np.where(unbounded, np.pi, high)
    rng = np.random.default_rng(0)
    poses, order = usual[None], np.zeros(0, dtype=np.intp)
    for (lowest, highest), count in ((near, LOOKED), (whole, WIDER)):
        poses = np.vstack([usual, rng.uniform(lowest, highest, (count, len(usual)))])
        held = np.flatnonzero(holds(poses))
        distance = np.full(len(poses), -np.inf)
        distance[held] = cell.search_excess_distance(poses[held])
        order = np.concatenate([[0], 1 + np.argsort(-distance[1:], kind="stable")])
        order = _apart(cell, poses, order[distance[order] >= 0.0])
        if len(order):
            break
    return poses, order


def _apart(cell: CollisionModel, poses: Array, order: NDArray[np.intp]) -> NDArray[np.intp]:
    """The first of some poses in which the pairs that are measured as they are keep apart, a few at a time."""
    for k in range(0, len(order), SHORT):
        few = order[k : k + SHORT]
        few = few[cell.apart(poses[few])]
        if len(few):
            return few
    return order[:0]


def _no_start(cell: CollisionModel, poses: Array, holds: Holds) -> ArmidError:
    """That no pose was found, with what excludes random poses (N, n), and what helps."""
    poses = poses[:COUNTED]
    excluded, remedies = [], ["give a pose with --start"]
    held = holds(poses)
    wanted = "in which all bodies keep apart"
    if not held.all():
        wanted += " and which its torques can hold" if len(cell.pairs) else ""
        each = ""
        if isinstance(holds, TorqueHolds):
            share = (holds.shares(poses) > holds.highest).mean(axis=0)
            each = f" ({_most(dict(zip(holds.joints, share.tolist(), strict=True)))})"
        excluded.append(f"torque excludes {100.0 * (1.0 - held.mean()):.0f} % of them{each}")
        remedies.append("relax effort limits with --limit JOINT.effort=VALUE or --torque-margin")
    close = cell.too_close(poses)
    if close.any():
        each = _most(dict(zip(cell.bodies.labels, close.mean(axis=0).tolist(), strict=True)))
        excluded.append(f"bodies that are too close exclude {100.0 * close.any(axis=1).mean():.0f} % ({each})")
        remedies.append(
            "leave out pairs whose bodies are drawn too wide with --ignore-pair A,B or --srdf FILE, or lower the "
            "--clearance"
        )
    found = f": of {len(poses)} random poses in the range of the joints, " + "; ".join(excluded) if excluded else ""
    return ArmidError(f"No pose of {cell.robot.name} was found {wanted}{found}.", remedy="; ".join(remedies) + ".")


def _most(shares: dict[str, float]) -> str:
    """The largest of some shares, by name."""
    order = sorted(shares, key=lambda name: -shares[name])[:NAMED]
    return ", ".join(f"{name} {100.0 * shares[name]:.0f} %" for name in order if shares[name] > 0.0)


def _rounded(cell: CollisionModel, limits: Limits, holds: Holds, pose: Array, usual: Array, enough: float) -> Array:
    """A pose with as many joints at their usual places, or at round numbers, as leave room enough."""
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
    some = np.flatnonzero(inside)
    some = some[holds(q[some])]
    free = np.zeros(len(q), dtype=np.bool_)
    free[some] = cell.excess_distance(q[some]) >= 0.0
    free = free.reshape(len(STEPS), DIRECTIONS)
    middle = len(STEPS) // 2
    after = np.logical_and.accumulate(free[middle:], axis=0).mean()
    before = np.logical_and.accumulate(free[middle - 1 :: -1], axis=0).mean()
    return float(0.5 * (after + before))

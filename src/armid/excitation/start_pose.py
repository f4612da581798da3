"""Choice of the start pose of a series, if the user gives none: a pose with a large free range around it.

A series moves around its start pose. Its amplitude is limited by the joint limits, by collisions, and by poses in
which gravity needs more torque than the joints have. The free range of a pose is therefore measured along straight
lines through the pose, in random directions of the joint space.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.coal import distances
from armid.excitation.collision.collision_model import CollisionModel
from armid.excitation.collision.required_distances import ALWAYS
from armid.excitation.limits.joint_limits import Limits
from armid.robot.kinematics import forward_kinematics

INSIDE = 0.05
"""Smallest distance of a chosen pose from each end of a joint's range, divided by the width of the range."""

SWING = 1.5
"""Wanted amplitude of a revolute joint to each side of the start pose [rad]; the wanted amplitude of a prismatic
joint is half its range."""

WANDER = 2.0
"""Largest difference between the position of a revolute joint in a random pose and in the usual pose [rad], if poses
near the usual pose are tried."""

LOOKED = 1500
"""Number of random poses near the usual pose for which distances are computed."""

WIDER = 6000
"""Number of random poses in the whole range of each joint, which are used if no pose near the usual pose is
suitable."""

SHORT = 40
"""Number of poses in one batch that is checked with the bodies themselves; the first batch contains the poses with
the largest excess distance."""

COUNTED, NAMED = 1000, 4
"""Number of random poses for which an error message counts the reasons that exclude them; and largest number of
joints, and of pairs of bodies, that the message names."""

MEASURED_IN = 200
"""Number of random poses from which an error message gives the range of the distances of pairs of bodies."""

DIRECTIONS = 24
"""Number of random straight lines through a pose, along which its free range is measured."""

STEPS = np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
"""Positions along a line at which limits and distances are tested, divided by the wanted amplitude."""

ROOMY = 0.85
"""Smallest free range of the usual pose, divided by the largest free range of all poses, with which the usual pose is
preferred, because users are familiar with it."""

PLAIN = 0.98
"""Smallest share of its free range that a pose must retain if a joint is moved to its usual position or to a round
number."""


Holds = Callable[[Array], NDArray[np.bool_]]
"""Function that returns the mask (N,) of the poses (N, n) that the joint torques suffice to hold against gravity."""


@dataclass(frozen=True, eq=False, slots=True)
class TorqueHolds:
    """Test of poses: the joint torques must suffice to hold the arm against gravity.

    Attributes:
        joints: Names of the k joints whose torque is limited.
        shares: Function that returns, for poses (N, n), the absolute torque of these joints divided by its limit,
            shape (N, k).
        highest: Largest allowed share of the torque limit.
    """

    joints: tuple[str, ...]
    shares: Callable[[Array], Array]
    highest: float

    def __call__(self, q: Array) -> NDArray[np.bool_]:
        """Mask (N,) of the poses (N, n) that the joints can hold."""
        return np.asarray((self.shares(q) <= self.highest).all(axis=1), dtype=np.bool_)


def any_pose(q: Array) -> NDArray[np.bool_]:
    """Accepts every pose (N, n), for arms whose torques are unknown: returns a mask (N,) that is true everywhere."""
    return np.ones(len(q), dtype=np.bool_)


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """Start pose of a series.

    Attributes:
        pose: Joint positions, shape (n,) [rad or m].
        free_share: Share of the wanted amplitude that is free around the pose, from 0 to 1.
        usual: True if the pose is the usual pose (`usual_pose`).
    """

    pose: Array
    free_share: float
    usual: bool


def usual_pose(limits: Limits) -> Array:
    """Pose with each joint at zero, or in the middle of its range if zero is outside, shape (n,) [rad or m]."""
    bounded = np.isfinite(limits.upper - limits.lower)
    low, high = np.where(bounded, limits.lower, -1.0), np.where(bounded, limits.upper, 1.0)
    ends = INSIDE * (high - low)
    return np.where((low + ends > 0.0) | (high - ends < 0.0), 0.5 * (low + high), 0.0)


def choose_start(cell: CollisionModel, limits: Limits, holds: Holds = any_pose) -> Start:
    """Chooses the random pose with the largest free range, or the usual pose if its free range is similar.

    Args:
        cell: Arm and surroundings.
        limits: Limits of the joints.
        holds: Function that returns the mask of the poses that the joints can hold.

    Raises:
        ArmidError: No suitable pose was found: in each pose bodies are too close, or the joints cannot hold the arm.
    """
    found = find_start(cell, limits, holds)
    if found is None:
        raise _no_start(cell, _good(cell, limits, usual_pose(limits), holds)[0][1:], holds)
    return found


def find_start(cell: CollisionModel, limits: Limits, holds: Holds = any_pose) -> Start | None:
    """Chooses the start pose as `choose_start` does; `None` if no pose is suitable."""
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
    """Usual pose and random poses (N, n), and indices of the suitable ones.

    The usual pose comes first, if suitable, then the other poses with decreasing excess distance. Poses near the
    usual pose are tried first. If none is suitable, poses in the whole range of each joint are tried.
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
    """Indices of the first suitable poses of `order`, at most `SHORT`.

    A pose is suitable if all pairs of kind `MEASURED` keep their required distance.
    """
    for k in range(0, len(order), SHORT):
        few = order[k : k + SHORT]
        few = few[cell.apart(poses[few])]
        if len(few):
            return few
    return order[:0]


def _no_start(cell: CollisionModel, poses: Array, holds: Holds) -> ArmidError:
    """Error that no pose was found; its message states why random poses (N, n) are excluded, and the remedies."""
    poses = poses[:COUNTED]
    excluded, remedies = [], ["give a pose with --start"]
    held = holds(poses)
    wanted = "in which all bodies keep their required distances"
    if not held.all():
        wanted += " and which its torques can hold" if len(cell.pairs) else ""
        each = ""
        if isinstance(holds, TorqueHolds):
            share = (holds.shares(poses) > holds.highest).mean(axis=0)
            each = f" ({_most(dict(zip(holds.joints, share.tolist(), strict=True)))})"
        excluded.append(f"{100.0 * (1.0 - held.mean()):.0f} % need too much torque{each}")
        remedies.append("raise torque limits with --limit JOINT.effort=VALUE, or give a smaller --torque-margin")
    close = cell.too_close(poses)
    if close.any():
        share = close.mean(axis=0)
        worst = [k for k in np.argsort(-share, kind="stable")[:NAMED].tolist() if share[k] > 0.0]
        apart = distances(cell.shapes, cell.pairs[worst], forward_kinematics(cell.robot, poses[:MEASURED_IN]))
        ranges = [(max(float(each.min()), 0.0), max(float(each.max()), 0.0)) for each in apart.T]
        texts = [
            f"{cell.bodies.labels[k]} {100.0 * share[k]:.0f} %: {1000.0 * cell.required.margin[k]:.1f} mm required, "
            f"{1000.0 * low:.1f} to {1000.0 * high:.1f} mm there"
            for k, (low, high) in zip(worst, ranges, strict=True)
        ]
        excluded.append(f"in {100.0 * close.any(axis=1).mean():.0f} % bodies are too close ({'; '.join(texts)})")
        remedies += _ways_apart(cell, worst, [low for low, _ in ranges], share)
    found = f": of {len(poses)} random poses in the range of the joints, " + "; ".join(excluded) if excluded else ""
    return ArmidError(f"No pose of {cell.robot.name} was found {wanted}{found}.", remedy="; ".join(remedies) + ".")


def _most(shares: dict[str, float]) -> str:
    """Text that lists the `NAMED` names with the largest shares, and these shares in percent."""
    order = sorted(shares, key=lambda name: -shares[name])[:NAMED]
    return ", ".join(f"{name} {100.0 * shares[name]:.0f} %" for name in order if shares[name] > 0.0)


def _ways_apart(cell: CollisionModel, pairs: Sequence[int], least: Sequence[float], share: Array) -> list[str]:
    """Remedies for pairs of bodies that are too close: options that exclude pairs, and a clearance that can be kept.

    Args:
        cell: Arm and surroundings.
        pairs: Indices of the pairs.
        least: Smallest distance of each of these pairs in random poses [m].
        share: Share of random poses in which each pair of the model is too close, shape (m,).
    """
    always = [(k, low) for k, low in zip(pairs, least, strict=True) if share[k] >= ALWAYS]
    named = [cell.bodies.labels[k].links for k, _ in always]
    options = " ".join(f"--ignore-pair {pair.first},{pair.second}" for pair in named) or "--ignore-pair A,B"
    ways = [f"exclude pairs whose bodies are larger in the description than in reality with {options} or --srdf FILE"]
    clearance = math.floor(1000.0 * min((low for _, low in always), default=0.0)) / 1000.0
    value = f"--clearance {clearance:g} (in metres)" if clearance > 0.0 else "a smaller --clearance"
    return [*ways, f"or give {value}" if not always or clearance > 0.0 else "or correct their geometry"]


def _rounded(cell: CollisionModel, limits: Limits, holds: Holds, pose: Array, usual: Array, enough: float) -> Array:
    """Moves joints of a pose to usual positions or round numbers, if the free range remains at least `enough`."""
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
    """Lowest and highest joint positions that a chosen pose may have, shape (n,) each [rad or m]."""
    ends = np.where(np.isfinite(limits.upper - limits.lower), INSIDE * (limits.upper - limits.lower), 0.0)
    return np.maximum(limits.lower + ends, -1e3), np.minimum(limits.upper - ends, 1e3)


def free_range(cell: CollisionModel, limits: Limits, pose: Array, holds: Holds = any_pose) -> float:
    """Share of the wanted amplitude that is free around a pose; mean over random straight lines through the pose.

    Args:
        cell: Arm and surroundings.
        limits: Limits of the joints.
        pose: Joint positions, shape (n,) [rad or m].
        holds: Function that returns the mask of the poses that the joints can hold.
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

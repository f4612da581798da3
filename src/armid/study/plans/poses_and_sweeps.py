"""Design of static poses or sweeps for a robot: chooses the start pose and the moves, and checks all limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, Finding, did_you_mean
from armid.excitation.certification import UNITS, Margin
from armid.excitation.collision.closest_approach import ClosestApproach, closest_approaches
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.ignored_pairs import IgnoredPair
from armid.excitation.collision.unchecked_contacts import LeftOutContact, left_out_contacts
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import Limits, limits_wider_than_described, soft_limits_used
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.poses_and_sweeps import (
    Moves,
    choose_poses,
    free_ranges,
    poses_plan,
    straight_way,
    sweeps_plan,
)
from armid.excitation.preflight import Preflight
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.study.plans.design_options import DesignConstraints, constrained_limits
from armid.study.plans.start_pose_and_bodies import place_motion
from armid.study.plans.torque_constraint import judged_torque, pose_holds, torque_lacks

CHECK_RATE, APPROACH_RATE = 1000.0, 100.0
"""Rate of the check of the limits, and rate of the check of the distances between bodies, along the moves [Hz]."""

CHUNK = 2000
"""Number of samples of a motion for which torque is computed at a time, to save memory."""


@dataclass(frozen=True, eq=False, slots=True)
class MovesGoal:
    """Goal of static poses or sweeps.

    Attributes:
        kind: `poses` or `sweeps`.
        poses: Number of static poses.
        rest: Time at rest in each static pose [s].
        start: Start pose, shape (n,) [rad or m]; armid chooses one if it is not given.
        seed: Seed of the random poses.
    """

    kind: str
    poses: int = 30
    rest: float = 2.0
    start: Array | None = None
    seed: int = 1


@dataclass(frozen=True, eq=False, slots=True)
class DesignedMoves:
    """Designed static poses or sweeps, and their check against all limits.

    Attributes:
        kind: `poses` or `sweeps`.
        plan: The moves.
        model: Arm and torque terms.
        limits: Limits of the joints.
        torque: Constraint channel of the torque limits; `None` if torque is not checked.
        preflight: Check of the moves against all limits.
        findings: Findings of the design.
        collision: Pairs of bodies that must keep a distance; `None` if collisions are not checked.
    """

    kind: str
    plan: Moves
    model: DynamicsModel
    limits: Limits
    torque: Torque | None
    preflight: Preflight
    findings: tuple[Finding, ...]
    collision: CollisionOptions | None = None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.model.robot

    @property
    def start(self) -> Array:
        """First pose of the moves, shape (n,) [rad or m]."""
        return self.plan.poses[0]

    @property
    def heading(self) -> str:
        """Text with the number of segments of each kind (way, rest or sweep) and the duration of the whole plan."""
        kinds = self.plan.kinds
        counts = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in dict.fromkeys(kinds))
        return f"{counts} in {self.plan.duration:.0f} s"

    def spread(self, margin: Margin) -> tuple[float, float, float, float] | None:
        """Lowest and highest position [rad or m] of the joint of a position limit, then its lower and upper limit.

        The result is `None` if the margin belongs to another kind of limit.
        """
        if margin.limit != "position":
            return None
        j = self.limits.joints.index(margin.label)
        q = self.plan.poses[:, j]  # a joint is nowhere beyond the ends of its moves
        return float(q.min()), float(q.max()), float(self.limits.lower[j]), float(self.limits.upper[j])


def design_moves(model: DynamicsModel, goal: MovesGoal, constraints: DesignConstraints) -> DesignedMoves:
    """Designs static poses or sweeps, and checks them against all limits.

    Args:
        model: Arm and torque terms.
        goal: Kind, number and start of the moves.
        constraints: Limits that the moves must keep.

    Raises:
        ArmidError: The kind is unknown, a workspace is given, or bodies come too close to each other during the
            moves.
    """
    robot, base = model.robot, find_base_parameters(model)
    if goal.kind not in ("poses", "sweeps"):
        raise ArmidError(
            f"Unknown kind of motion {goal.kind!r}.",
            possible="series, poses, sweeps",
            remedy=did_you_mean(goal.kind, ("series", "poses", "sweeps")),
        )
    if constraints.workspace is not None:
        raise ArmidError(
            f"A box for the tip is possible only with the experiment `series` (Fourier series), not `{goal.kind}`.",
            remedy="leave --tip-box out, and give narrower position limits with --limit JOINT.position=LOW:HIGH.",
        )
    limits = constrained_limits(robot, constraints)
    criterion = CriterionGoal(model, base, "d-optimal", np.ones(robot.n), APPROACH_RATE, 1)
    torque, torque_findings = judged_torque(criterion, limits, constraints)
    holds = pose_holds(criterion, torque)
    placed = place_motion(robot, limits, constraints, goal.start, holds)
    start, collision, limits = placed.start, placed.collision, placed.limits

    def collision_free(q: Array) -> NDArray[np.bool_]:
        return np.ones(len(q), dtype=np.bool_) if collision is None else collision.clear(robot, q)

    def reachable(q: Array) -> NDArray[np.bool_]:
        paths = np.concatenate([straight_way(start, pose) for pose in q])
        return np.asarray(collision_free(paths).reshape(len(q), -1).all(axis=1) & holds(q), dtype=np.bool_)

    if goal.kind == "poses":
        poses = choose_poses(model, base, limits, goal.poses, seed=goal.seed, allowed=reachable)
        moves = poses_plan(poses, limits, rest=goal.rest, via=start, free=collision_free)
    else:
        moves = sweeps_plan(start, free_ranges(start, limits, collision_free))
    motion = moves.sample(APPROACH_RATE)
    colliding = np.flatnonzero(~collision_free(motion.q))
    if len(colliding):
        raise ArmidError(
            f"Bodies come too close to each other {motion.time[colliding[0]]:.1f} s after the start of the "
            f"{goal.kind}.",
            remedy="give narrower position limits with --limit JOINT.position=LOW:HIGH, or choose another --start "
            "or --seed.",
        )
    approaches, touching, skipped = _distances(collision, robot, motion)
    found = _margins(moves.sample(CHECK_RATE), robot, limits, torque, criterion)
    wider = limits_wider_than_described(robot, limits)
    lacks, asked = torque_lacks(robot, constraints, torque), collision.clearance if collision else 0.0
    report = Preflight(found, approaches, skipped, None, placed.unchecked, None, wider, touching, lacks, asked)
    remarks = (wider, *report.remarks, soft_limits_used(robot, limits))
    findings = (*placed.findings, *torque_findings, *filter(None, remarks))
    return DesignedMoves(goal.kind, moves, model, limits, torque, report, findings, collision)


def _distances(
    collision: CollisionOptions | None, robot: Robot, motion: Motion
) -> tuple[tuple[ClosestApproach, ...], tuple[LeftOutContact, ...], tuple[IgnoredPair, ...]]:
    """Closest approaches of checked pairs of bodies along a motion, contacts of unchecked pairs, and these pairs."""
    if collision is None:
        return (), (), ()
    approaches = closest_approaches(collision, robot, motion.time, motion.q)
    return approaches, left_out_contacts(collision, robot, motion.time, motion.q), collision.unchecked


def _margins(
    motion: Motion, robot: Robot, limits: Limits, torque: Torque | None, goal: CriterionGoal
) -> tuple[Margin, ...]:
    """Margins of a motion to every limit.

    A certified share is the largest share of the limit at the samples plus the largest change of the share from one
    sample to the next, because the motion between the samples is not computed.
    """
    middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
    jerk = np.diff(motion.ddq, axis=0, append=motion.ddq[-1:]) * CHECK_RATE
    result: list[Margin] = []

    def add(name: str, j: int, values: Array, shares: Array, bounds: tuple[float, float], unit: str) -> None:
        k = int(shares.argmax())
        rise = float(np.abs(np.diff(shares)).max(initial=0.0))
        value, share, bound = float(values[k]), float(shares[k]), bounds[1 if values[k] >= sum(bounds) / 2 else 0]
        result.append(
            Margin(name, robot.joint_names[j], value, bound, unit, float(motion.time[k]), share, share + rise)
        )

    for order, (name, values, limit) in enumerate(
        (
            ("position", motion.q, half),
            ("velocity", motion.dq, limits.velocity),
            ("acceleration", motion.ddq, limits.acceleration),
            ("jerk", jerk, limits.jerk),
        )
    ):
        for j in np.flatnonzero(np.isfinite(limit)).tolist():
            unit = UNITS[order][robot.joints[j].is_prismatic]
            if order == 0:
                shares, bounds = np.abs(values[:, j] - middle[j]) / half[j], (limits.lower[j], limits.upper[j])
                add(name, j, values[:, j], shares, (float(bounds[0]), float(bounds[1])), unit)
            else:
                size, bound = np.abs(values[:, j]), float(limit[j])
                add(name, j, size, size / bound, (bound, bound), unit)
    if torque is not None:
        shares = _torque_shares(motion, torque, goal)
        for k, j in enumerate(torque.joints):
            bound = float(torque.limit[k])
            add("torque", j, shares[:, k] * bound, shares[:, k], (bound, bound), robot.joints[j].effort_unit)
    return tuple(result)


def _torque_shares(motion: Motion, torque: Torque, goal: CriterionGoal) -> Array:
    """Absolute torques of the limited joints along a motion, divided by their limits, shape (N, m)."""
    parts = [slice(k, k + CHUNK) for k in range(0, motion.samples, CHUNK)]
    return np.vstack([torque.along(goal, motion.q[part], motion.dq[part], motion.ddq[part]) for part in parts])

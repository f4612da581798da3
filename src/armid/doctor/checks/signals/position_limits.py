"""Check for joints outside their limits in the whole motion, as in a log of another arm or of motor positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.position_unit import of_motors, turns_too_far
from armid.errors import Finding
from armid.robot import Robot

CODE = "position-limits"

NEARLY_ALL = 0.95
"""Share of the samples outside the limits from which a joint is outside in all of its motion."""

FAR = 0.1
"""Largest distance from the limits, divided by the span of the limits, from which they contradict the positions of a
joint. Limits of descriptions are approximate: on ten recorded arms a joint exceeds them by up to 0.03 for some
time."""

MOVES = 0.02
"""Range of the positions, divided by the span of the limits, from which a joint counts as moving."""

NAMED = 3
"""Largest number of joints that a message describes."""

REMEDY = (
    "check whether the log belongs to this arm, and not to the other arm of a pair. If the log belongs to this arm, "
    "check the zeros (joint_offset), signs (position_sign), units and order of the channels (joints), and the "
    "limits of the description"
)


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints that are outside their limits in their whole motion, unless another fault explains this."""
    if evidence.recording is None:
        return []
    robot, q = evidence.robot, evidence.recording.q
    outside = always_outside(robot, q)
    if outside.any() and evidence.explanations and evidence.corrected is not None:
        runs = evidence.corrected.log.runs
        outside &= always_outside(robot, np.concatenate([run.motion.q[run.rows] for run in runs]))
    if not outside.any():
        return []
    joints = np.flatnonzero(outside)
    told = [outside_limits(robot, q, j) for j in joints[:NAMED]]
    more = f"; {len(joints) - NAMED} more" if len(joints) > NAMED else ""
    mirrored = not always_outside(robot, -q)[outside].any()
    why = (
        " With the opposite sign the positions would be inside, as for the other arm of a mirrored pair."
        if mirrored
        else ""
    )
    evident = f"In the whole motion, joints are outside their limits: {'; '.join(told)}{more}.{why}"
    if turns_too_far(evidence):
        return [of_motors(f"{evident} Most joints move over several times the range of their limits")]
    return [Finding(CODE, "error", ", ".join(robot.joint_names[j] for j in joints), evident, REMEDY)]


def always_outside(robot: Robot, q: Array) -> NDArray[np.bool_]:
    """Mask (n,) of moving joints that are outside their limits in nearly all samples, even if whole turns are added.

    Args:
        robot: The arm.
        q: Positions, shape (N, n).
    """
    low, high = np.array([joint.position_limits for joint in robot.joints]).reshape(-1, 2).T
    known = np.isfinite(low) & np.isfinite(high) & (low < high)
    low, high = np.where(known, low, -1.0), np.where(known, high, 1.0)
    span = high - low
    turn = np.array([0.0 if joint.is_prismatic else 2.0 * np.pi for joint in robot.joints])
    turns = np.round((q.min(axis=0) + q.max(axis=0) - low - high) / (4.0 * np.pi))
    result = known & (np.ptp(q, axis=0) > MOVES * span)
    for shifted in (q, q - turns * turn):
        beyond = np.maximum(low - shifted, shifted - high)
        result &= ((beyond > 0.0).mean(axis=0) >= NEARLY_ALL) & (beyond.max(axis=0) > FAR * span)
    return result


def outside_limits(robot: Robot, q: Array, j: np.intp | int) -> str:
    """Text that states the range of the positions of joint j and its limits.

    Args:
        robot: The arm.
        q: Positions, shape (N, n) [rad or m].
        j: Index of the joint.
    """
    low, high = robot.joints[j].position_limits
    return (
        f"{robot.joint_names[j]} goes from {q[:, j].min():.4g} to {q[:, j].max():.4g} {robot.joints[j].unit}, "
        f"its limits are [{low:.4g}, {high:.4g}]"
    )


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        CODE: "The log belongs to another arm, or its angles are misread; the estimate may fit and still be wrong."
    },
    follows=("degrees", "motor-side"),
    needs_torque=False,
)

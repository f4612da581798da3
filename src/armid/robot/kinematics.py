"""Forward kinematics of links and frames for an array of joint positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.robot.robot import Frame, Robot


def forward_kinematics(robot: Robot, q: ArrayLike) -> tuple[Array, Array]:
    """Poses of all link frames in the base frame.

    Args:
        robot: The robot.
        q: Joint positions, shape (N, n) [rad or m].

    Returns:
        Rotations (N, n, 3, 3) and origins (N, n, 3) [m].
    """
    q = array(q, (None, robot.n), "q")
    R = np.empty((len(q), robot.n, 3, 3))
    p = np.empty((len(q), robot.n, 3))
    for i, joint in enumerate(robot.joints):
        R_local, p_local = joint.motion(q[:, i])
        if joint.parent < 0:
            R[:, i], p[:, i] = R_local, p_local
        else:
            R_parent = R[:, joint.parent]
            R[:, i] = R_parent @ R_local
            p[:, i] = p[:, joint.parent] + (R_parent @ p_local[..., None])[..., 0]
    return R, p


def longest_reach(robot: Robot) -> float:
    """Length of the longest chain from the base to a link or the tip, with the travel of prismatic joints [m]."""
    reach = [0.0] * robot.n
    for k, joint in enumerate(robot.joints):
        travel = float(np.ptp(joint.position_limits)) if joint.is_prismatic else 0.0
        below = reach[joint.parent] if joint.parent >= 0 else 0.0
        length = float(np.linalg.norm(joint.placement[:3, 3]))
        reach[k] = below + length + (travel if np.isfinite(travel) else 0.0)
    tip = robot.tip
    below = reach[tip.parent] if tip.parent >= 0 else 0.0
    return max([*reach, below + float(np.linalg.norm(tip.placement[:3, 3]))])


def frame_pose(robot: Robot, q: ArrayLike, frame: Frame | None = None) -> tuple[Array, Array]:
    """Pose of a frame in the base frame.

    Args:
        robot: The robot.
        q: Joint positions, shape (N, n) [rad or m].
        frame: The frame; `None` for the tip of the robot.

    Returns:
        Rotations (N, 3, 3) and origins (N, 3) [m].
    """
    frame = robot.tip if frame is None else frame
    R, p = forward_kinematics(robot, q)
    R_frame, p_frame = frame.placement[:3, :3], frame.placement[:3, 3]
    if frame.parent < 0:
        return np.tile(R_frame, (len(R), 1, 1)), np.tile(p_frame, (len(R), 1))
    R_link, p_link = R[:, frame.parent], p[:, frame.parent]
    return R_link @ R_frame, p_link + R_link @ p_frame

"""ROS 2 `trajectory_msgs/msg/JointTrajectory` as YAML, as `ros2 topic pub` accepts it."""

from __future__ import annotations

import json
import re

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.formats.sampled_motion import DECIMALS, PLAN_MARK, SampledMotion, plan_in_comments
from armid.input_boundary import boundary
from armid.model.motion import Motion

SUFFIX = ".trajectory.yaml"
RATE = 100.0

POINT = re.compile(
    r"- positions: (\[.*?\])\n +velocities: (\[.*?\])\n +accelerations: (\[.*?\])\n"
    r" +time_from_start: \{sec: (\d+), nanosec: (\d+)\}"
)


def problem(track: SampledMotion) -> str:
    """Reason why a motion cannot be written in this format; always empty, because any motion can be written."""
    del track
    return ""


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{x:.12g}" for x in np.round(values, DECIMALS)) + "]"


def write(track: SampledMotion) -> bytes:
    """Writes the positions, velocities and accelerations of every point, and the plan as a comment."""
    lines = [f"# {PLAN_MARK}{track.plan}"] if track.plan else []
    lines += ["joint_names:", *(f"- {json.dumps(name)}" for name in track.joints), "points:"]
    motion = track.motion
    for t, q, dq, ddq in zip(motion.time - motion.time[0], motion.q, motion.dq, motion.ddq, strict=True):
        nanoseconds = round(float(t) * 1e9)
        lines += [
            f"- positions: {_list(q)}",
            f"  velocities: {_list(dq)}",
            f"  accelerations: {_list(ddq)}",
            f"  time_from_start: {{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}",
        ]
    return ("\n".join(lines) + "\n").encode()


def read(content: bytes) -> SampledMotion:
    """Reads the points of a trajectory, and the plan from its comments.

    Raises:
        ArmidError: The text is not a trajectory that `write` has written.
    """
    text = content.decode(errors="replace")
    names, _, points = text.partition("points:")
    remedy = "give a file that armid excite has written."
    with boundary("a ROS 2 trajectory", "The file", remedy=remedy):
        joints = [str(json.loads(line[2:])) for line in names.splitlines() if line.startswith("- ")]
        found = POINT.findall(points)
    if not joints or not found:
        raise ArmidError(
            "The file is not a ROS 2 trajectory: joint_names or points are missing.",
            remedy=remedy,
        )
    with boundary("a ROS 2 trajectory", "The file", remedy=remedy):
        states = (np.array([json.loads(point[k]) for point in found], dtype=np.float64) for k in range(3))
        time = np.array([int(point[3]) + 1e-9 * int(point[4]) for point in found])
        plan = plan_in_comments(text, "#")
        return SampledMotion("", tuple(joints), (False,) * len(joints), Motion(time, *states), plan)

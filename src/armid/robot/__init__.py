"""Robot descriptions: data structures, readers, and built-in arms."""

from armid.robot.kinematics import forward_kinematics, frame_pose
from armid.robot.loading import builtin_arms, load_robot
from armid.robot.robot import EARTH_GRAVITY, Frame, InertialParameters, Joint, Link, Robot

__all__ = [
    "EARTH_GRAVITY",
    "Frame",
    "InertialParameters",
    "Joint",
    "Link",
    "Robot",
    "builtin_arms",
    "forward_kinematics",
    "frame_pose",
    "load_robot",
]

"""Correction of rounded angles in a description.

If a description writes π/2 as 1.5708, its axes are almost, but not exactly, parallel or at right angles. Each such
joint adds columns to the regressor that the real arm does not have, with coefficients of about 1e-5. Roll, pitch and
yaw angles that are close to multiples of 15° are therefore set to these multiples.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.robot import Robot

STEP = math.pi / 12.0
"""Step of the multiples of 15° with which angles are compared [rad]."""

ROUNDING = 1e-4
"""Largest difference from a multiple of 15° that is treated as rounding [rad]: angles printed with four digits."""

NOISE = 1e-8
"""Changes below this value [rad] are not reported. They come from π with nine or more digits, or from the arithmetic
of a reader."""


def rounded(robot: Robot, locked: Collection[str] = ()) -> tuple[Robot, Finding | None]:
    """Corrects rounded angles of a robot.

    Args:
        robot: The robot.
        locked: Names of the joints that will be locked. All joints are corrected, but the finding counts a locked
            joint only if it carries a joint that moves.

    Returns:
        The robot with corrected placements and axes, and a finding `description-rounded` with the largest change;
        `None` in place of the finding if every counted change is below `NOISE`.
    """
    changes: list[tuple[float, str]] = []

    def snap_pose(pose: Array, name: str) -> Array:
        rotation = snapped_rotation(pose[:3, :3])
        # The chord gives a small angle accurately, where the arc cosine of the trace loses digits.
        chord = float(np.linalg.norm(rotation - pose[:3, :3])) / math.sqrt(8.0)
        changes.append((2.0 * math.asin(min(1.0, chord)), name))
        return homogeneous(rotation, pose[:3, 3])

    def snap_axis(axis: Array, name: str) -> Array:
        result = snapped_axis(axis)
        changes.append((float(np.linalg.norm(result - axis)), name))
        return result

    joints = tuple(
        replace(j, placement=snap_pose(j.placement, j.name), axis=snap_axis(j.axis, j.name)) for j in robot.joints
    )
    tip = replace(robot.tip, placement=snap_pose(robot.tip.placement, robot.tip.name))
    robot = replace(robot, joints=joints, tip=tip)
    counted = {*_carriers(robot, locked), robot.tip.name}
    seen = sorted(((change, name) for change, name in changes if change > NOISE and name in counted), reverse=True)
    if not seen:
        return robot, None
    largest, name = seen[0]
    finding = Finding(
        "description-rounded",
        "info",
        "",
        f"{len(seen)} orientations or axes differed from multiples of 15° by rounding only and were set to these "
        f"multiples; the largest change is {largest:.2g} rad, at {name}",
    )
    return replace(robot, findings=(*robot.findings, finding)), finding


def _carriers(robot: Robot, locked: Collection[str]) -> set[str]:
    """Names of the joints that move, and of those that carry them."""
    carriers: set[str] = set()
    for index in (k for k, name in enumerate(robot.joint_names) if name not in locked):
        while index >= 0:
            carriers.add(robot.joint_names[index])
            index = robot.joints[index].parent
    return carriers


def snapped_rotation(rotation: Array) -> Array:
    """Rotation (3, 3) with roll, pitch and yaw set to multiples of 15° if they are close to them.

    At least two of the three angles must be close to a multiple: a single one may be close by chance, and a tilt
    about one axis may be intended. At a pitch of ±90°, roll and yaw are not unique; the roll is then set to zero.
    """
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if abs(abs(pitch) - 0.5 * math.pi) < ROUNDING:
        angles = np.array([0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])])
    else:
        roll = math.atan2(rotation[2, 1], rotation[2, 2])
        angles = np.array([roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])])
    snapped = _snapped(angles, at_least=2)
    return rotation if (snapped == angles).all() else rpy_rotation(snapped) + 0.0


def snapped_axis(axis: Array) -> Array:
    """Unit axis (3,) with azimuth and elevation set to multiples of 15° if both are close to them."""
    elevation = math.atan2(axis[2], math.hypot(axis[0], axis[1]))
    at_pole = abs(abs(elevation) - 0.5 * math.pi) < ROUNDING
    angles = np.array([-elevation, 0.0 if at_pole else math.atan2(axis[1], axis[0])])
    snapped = _snapped(angles, at_least=2)
    if (snapped == angles).all() and not at_pole:
        return axis
    return rpy_rotation([0.0, *snapped])[:, 0] + 0.0


def _snapped(angles: Array, at_least: int) -> Array:
    """Angles [rad] within `ROUNDING` of multiples of 15° set to these multiples, if there are enough such angles."""
    multiples = np.round(angles / STEP) * STEP
    close = np.abs(angles - multiples) < ROUNDING
    return np.where(close, multiples, angles) if close.sum() >= at_least else angles

"""Correction of angles that a description states with rounding.

A description that writes π/2 as 1.5708 has axes that are almost, but not quite, parallel or at right angles. Each
such joint adds columns to the regressor that the real arm does not have, with coefficients of 1e-5. So roll, pitch
and yaw angles close to multiples of 15° are set to those multiples.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.maths.spatial import homogeneous, rpy_rotation
from armid.robot.robot import Robot
from armid.values import Array

STEP = math.pi / 12.0
"""Step of the multiples with which angles are compared [rad]."""

ROUNDING = 1e-4
"""Largest distance to a multiple of 15° that counts as rounding [rad]: angles printed with four digits."""

NOISE = 1e-8
"""Changes below this [rad] are not reported: π with nine digits or more, and the arithmetic of a reader."""


def rounded(robot: Robot) -> tuple[Robot, Finding | None]:
    """Robot with rounded angles corrected, and a finding about the largest change.

    Returns:
        The robot with corrected placements and axes, and a finding `description-rounded` with the largest change;
        `None` where every change is below `NOISE`.
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
    seen = sorted((change for change in changes if change[0] > NOISE), reverse=True)
    if not seen:
        return robot, None
    largest, name = seen[0]
    finding = Finding(
        "description-rounded",
        "info",
        "",
        f"{len(seen)} orientations or axes are close to multiples of 15° and were set to them; "
        f"the largest change is {largest:.2g} rad, at {name}",
    )
    return replace(robot, findings=(*robot.findings, finding)), finding


def snapped_rotation(rotation: Array) -> Array:
    """Rotation (3, 3) whose roll, pitch and yaw are set to multiples of 15° where they are close to them.

    At least two of the three must be close: one alone may be chance, and a tilt about one axis may be intended. At a
    pitch of ±90° only one combination of roll and yaw is defined; the roll is then set to zero.
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
    """Unit axis (3,) set to exact multiples of 15° where azimuth and elevation are both close to them."""
    elevation = math.atan2(axis[2], math.hypot(axis[0], axis[1]))
    at_pole = abs(abs(elevation) - 0.5 * math.pi) < ROUNDING
    angles = np.array([-elevation, 0.0 if at_pole else math.atan2(axis[1], axis[0])])
    snapped = _snapped(angles, at_least=2)
    if (snapped == angles).all() and not at_pole:
        return axis
    return rpy_rotation([0.0, *snapped])[:, 0] + 0.0


def _snapped(angles: Array, at_least: int) -> Array:
    """Angles [rad] with those within `ROUNDING` of a multiple of 15° replaced by it, if there are enough."""
    multiples = np.round(angles / STEP) * STEP
    close = np.abs(angles - multiples) < ROUNDING
    return np.where(close, multiples, angles) if close.sum() >= at_least else angles

"""Correction of rounded angles in a description.

If a description writes π/2 as 1.5708, its axes are almost, but not exactly, parallel or at right angles. Each such
joint adds columns to the regressor that the real arm does not have, with coefficients of about 1e-5. Roll, pitch and
yaw angles that are close to multiples of 15° are therefore set to these multiples.

Only the relations between the axes of neighbouring joints, and between gravity and the first axis, have this effect:
the angle between two axes, and whether they intersect. A description with exact numbers can have such a relation
although the angles of its frames are only near multiples of 15°, for instance if an axis and the frame behind it are
tilted by the same small angle. In this case the correction would destroy an exact relation, so it is undone for both
joints.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.robot import Joint, Robot

STEP = math.pi / 12.0
"""Step of the multiples of 15° with which angles are compared [rad]."""

ROUNDING = 1e-4
"""Largest difference from a multiple of 15° that is treated as rounding [rad]: angles printed with four digits."""

EXACT = 1e-9
"""Largest deviation of two axes from an angle of a multiple of 15° [rad], or from an intersection [m], that counts as
rounding of the arithmetic. The base parameters are computed with the same tolerance."""

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
    corrected = tuple(
        replace(
            j,
            placement=homogeneous(snapped_rotation(j.placement[:3, :3]), j.placement[:3, 3]),
            axis=snapped_axis(j.axis),
        )
        for j in robot.joints
    )
    joints = _without_broken_relations(robot, corrected)
    pose = robot.tip.placement
    tip = replace(robot.tip, placement=homogeneous(snapped_rotation(pose[:3, :3]), pose[:3, 3]))
    changes = [
        *(
            (_angle_between(old.placement, new.placement), new.name)
            for old, new in zip(robot.joints, joints, strict=True)
        ),
        *(
            (float(np.linalg.norm(new.axis - old.axis)), new.name)
            for old, new in zip(robot.joints, joints, strict=True)
        ),
        (_angle_between(pose, tip.placement), tip.name),
    ]
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
        f"Number of orientations and axes that differed from multiples of 15° only by rounding and were set to "
        f"these multiples: {len(seen)}; the largest change is {largest:.2g} rad, at {name}",
    )
    return replace(robot, findings=(*robot.findings, finding)), finding


def _angle_between(old: Array, new: Array) -> float:
    """Angle of the rotation from one pose to another pose, shape (4, 4) each [rad]."""
    # The chord gives a small angle accurately, where the arc cosine of the trace loses digits.
    chord = float(np.linalg.norm(new[:3, :3] - old[:3, :3])) / math.sqrt(8.0)
    return 2.0 * math.asin(min(1.0, chord))


def _without_broken_relations(robot: Robot, corrected: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Undoes the correction of joints if it would break an exact relation of neighbouring axes.

    If the correction of a joint is undone, the relation to its next neighbour may be broken, so the test is repeated
    until no relation is broken.
    """
    joints = list(corrected)
    while True:
        broken = [
            k
            for k, (old, new) in enumerate(zip(robot.joints, joints, strict=True))
            if any(
                before <= EXACT < after
                for before, after in zip(
                    _deviations(robot, robot.joints, old), _deviations(robot, joints, new), strict=True
                )
            )
        ]
        kept = {each for k in broken for each in (k, robot.joints[k].parent) if each >= 0}
        if all(joints[k] is robot.joints[k] for k in kept):
            return tuple(joints)
        for k in kept:
            joints[k] = robot.joints[k]


def _deviations(robot: Robot, joints: Sequence[Joint], joint: Joint) -> tuple[float, float]:
    """Deviations of a joint's axis in relation to the axis of its parent, or to gravity for a joint of the base.

    Returns:
        Difference of the angle between the axes from the nearest multiple of 15° [rad], and distance of the axes [m];
        the distance is zero if the axes are parallel or if there is no parent.
    """
    other = joints[joint.parent].axis if joint.parent >= 0 else np.array(robot.gravity)
    size = float(np.linalg.norm(other))
    if not size:
        return 0.0, 0.0
    axis, other = joint.placement[:3, :3] @ joint.axis, other / size
    normal = np.cross(other, axis)
    sine = float(np.linalg.norm(normal))
    angle = math.atan2(sine, float(other @ axis))
    distance = abs(float(normal @ joint.placement[:3, 3])) / sine if sine > ROUNDING and joint.parent >= 0 else 0.0
    return abs(angle - round(angle / STEP) * STEP), distance


def _carriers(robot: Robot, locked: Collection[str]) -> set[str]:
    """Names of the joints that are not locked, and of the joints that carry them."""
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
    """Sets angles [rad] that are close to multiples of 15° to these multiples, if at least `at_least` are close."""
    multiples = np.round(angles / STEP) * STEP
    close = np.abs(angles - multiples) < ROUNDING
    return np.where(close, multiples, angles) if close.sum() >= at_least else angles

"""Comparison of positions with the limits of the joints, to detect angles in degrees and wrong offsets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording, recording_error
from armid.measurement.remedy_builders import lines
from armid.robot.robot import Robot

FAR = 0.5
"""Largest distance by which positions may exceed the limits of a joint, divided by the range between the limits, if
only the limits are inaccurate; positions beyond this distance have another cause, such as a wrong unit."""

OVERSHOOT = 0.1
"""Largest distance by which positions may exceed the limits of a joint, divided by the range between the limits, at
which they count as inside. In recordings of ten arms this ratio is at most 0.03."""

WIDEST = 7.0
"""Largest plausible absolute angle of a joint, about one turn [rad]."""

COMPARABLE = 0.25
"""Share of its range that a joint uses if its angles are taken as degrees, divided by the share that the other joints
use in radians; smallest value at which degrees are plausible. Angles in radians that are wrongly taken as degrees use
only some hundredths of the share of the others."""


def check_limits(recording: Recording, log_format: LogFormat, robot: Robot) -> tuple[Finding, ...]:
    """Raises an error if degrees were read as radians; returns a finding about joints far outside their limits.

    Args:
        recording: Recording in the robot's convention.
        log_format: Log format with which the recording was read.
        robot: The arm that was recorded.

    Raises:
        RecordingError: Angles are in degrees instead of radians.
    """
    beyond, span = _beyond(robot, recording.q)
    far = beyond > FAR * span
    if not far.any():
        return ()
    worst = int(np.argmax(np.where(far, beyond, -np.inf)))
    joint, q = robot.joints[worst], recording.q[:, worst]
    low, high = joint.position_limits
    evidence = (
        f"joint {joint.name} moves from {q.min():.4g} to {q.max():.4g} {joint.unit}, far outside its limits "
        f"[{low:.4g}, {high:.4g}]"
    )
    read_so = log_format.degrees(robot.n)
    degrees = in_degrees(robot, recording.q, read_so)
    if degrees.any():
        turns = np.array([not joint.is_prismatic for joint in robot.joints])
        everywhere = bool(degrees[turns].all())
        units = "deg" if everywhere else ["deg" if each else "rad" for each in degrees | read_so]
        inside = "all joints" if everywhere else _listed(robot, degrees)
        raise recording_error(
            "degrees",
            recording,
            f"{evidence}; if the angles were in degrees, {inside} would be inside the limits.",
            lines("or transmission and joint_offset, if the log is on the motor side", units=units),
        )
    return (
        Finding(
            "position-offset",
            "warning",
            robot.joint_names[worst],
            f"J{evidence[1:]}.",
            "check the keys `units`, `joint_offset` and `transmission`, the order of the channels and the position "
            "limits.",
        ),
    )


def in_degrees(robot: Robot, q: Array, read_so: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (n,) of joints that are far outside their limits in radians, but inside them if angles are in degrees.

    Usually all revolute joints of a log have the same unit. Only some joints are taken as degrees if their angles are
    larger than a turn and if, in degrees, these joints use as much of their range as the other joints do in radians.

    Args:
        robot: The arm.
        q: Positions as read, shape (N, n) [rad or m].
        read_so: Mask of the joints whose angles are already read as degrees, shape (n,).
    """
    nobody = np.zeros(robot.n, dtype=np.bool_)
    turns = np.array([not joint.is_prismatic for joint in robot.joints])
    beyond, span = _beyond(robot, q)
    far, known = beyond > FAR * span, np.isfinite(span)
    as_degrees = np.where(turns, np.radians(q), q)
    fits = turns & (_beyond(robot, as_degrees)[0] <= OVERSHOOT * span)
    if not far.any() or not (fits & ~read_so)[far].all():
        return nobody
    large = np.abs(q).max(axis=0) > WIDEST
    if 2 * far.sum() > turns.sum() and not read_so.any() and fits[turns & known].all() and large.any():
        return turns
    share = np.ptp(np.where(far, as_degrees, q), axis=0) / span
    others = known & ~far
    usual = float(median(share[others])) if others.any() else 0.0
    return far if (large & (share >= COMPARABLE * usual))[far].all() else nobody


def _beyond(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Largest distance by which positions (N, n) exceed the limits, and range of the limits, (n,) each.

    Both are in rad or m. For unknown limits, the distance is -∞ and the range ∞.
    """
    low, high = np.array([joint.position_limits for joint in robot.joints]).reshape(-1, 2).T
    known = np.isfinite(low) & np.isfinite(high) & (high > low)
    beyond = np.maximum(low - q.min(axis=0), q.max(axis=0) - high)
    return np.where(known, beyond, -np.inf), np.where(known, high - low, np.inf)


def _listed(robot: Robot, which: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, one in zip(robot.joint_names, which, strict=True) if one)

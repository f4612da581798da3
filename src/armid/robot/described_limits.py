"""Limits of a joint that a description contains, and the placeholders among them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armid.checked_array import Array
from armid.errors import Finding, RobotError

NO_STOP = 100.0
"""Position limit [rad] from which a revolute joint counts as unlimited, because no real arm turns 16 times between
its limits."""

NO_SPEED = 100.0
"""Velocity limit [rad/s or m/s] from which the limit counts as unknown: ten times the velocity of the fastest arms.
Descriptions for simulators contain limits of 100 to 50 000 if the real limits were not known."""

NO_EFFORT = 1000.0
"""Effort limit [N·m or N] from which the limit counts as unknown if the velocity limit of the joint is unknown, too.
Strong arms have such effort limits, but their velocity limits are known."""


@dataclass(frozen=True, slots=True)
class DescribedLimits:
    """Limits of one joint; infinite if the description does not contain a limit.

    Attributes:
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        velocity: Largest speed [rad/s or m/s].
        effort: Largest effort [N·m or N].
        soft: Lowest and highest position [rad or m] that the controller of the robot allows.
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    soft: tuple[float, float] = (-math.inf, math.inf)


def refuse_impossible_limits(joint: str, position: Array, velocity: float, effort: float) -> None:
    """Raises an error if no joint can have these limits, as in a damaged file.

    Args:
        joint: Name of the joint.
        position: Lower and upper limit, shape (2,) [rad or m].
        velocity: Velocity limit [rad/s or m/s].
        effort: Effort limit [N·m or N].

    Raises:
        RobotError: The lower limit is larger than the upper limit, or a limit is NaN.
    """
    low, high = map(float, position)
    if low <= high and not math.isnan(velocity) and not math.isnan(effort):
        return
    raise RobotError(
        f"Joint {joint!r} has the position limits {low:g} and {high:g}, the velocity limit {velocity:g} and the "
        f"effort limit {effort:g}; no joint can have them.",
        remedy="give a lower and an upper limit, and numbers.",
    )


def limits_of(
    joint: str, *, position: tuple[float, float] | None, velocity: float, effort: float, turns: bool
) -> tuple[DescribedLimits, Finding | None]:
    """Limits of a joint from its description; placeholder values are treated as unknown limits.

    Placeholders are a velocity or effort limit of zero, a position range of zero width, a position range of a
    rotating joint that is wider than that of any real joint, and a velocity limit that no arm reaches. If the
    velocity limit is one that no arm reaches, the effort limit also counts as a placeholder if it is the same number
    or 1000 or more. All placeholders except zeros are reported in a finding.

    Args:
        joint: Name of the joint.
        position: Lower and upper limit [rad or m]; `None` if not given.
        velocity: Velocity limit [rad/s or m/s]; 0 if not given.
        effort: Effort limit [N·m or N]; 0 if not given.
        turns: True if the joint rotates.

    Raises:
        RobotError: The lower limit is larger than the upper limit.
    """
    lower, upper = position or (-math.inf, math.inf)
    unit, effort_unit = ("rad", "N·m") if turns else ("m", "N")
    finding = None
    if lower > upper:
        raise RobotError(
            f"The lower position limit {lower:g} {unit} of joint {joint!r} is above the upper limit "
            f"{upper:g} {unit}.",
            remedy="exchange the two limits.",
        )
    if lower == upper or (turns and position is not None and min(-lower, upper) > NO_STOP):
        finding = Finding(
            "limits-unknown",
            "info",
            joint,
            f"position limits {lower:g} to {upper:g} {unit} are implausible; the joint is treated as unlimited",
            "write the real limits of the joint into the description if they are needed",
        )
        lower, upper = -math.inf, math.inf
    velocity, effort = abs(velocity) or math.inf, abs(effort) or math.inf
    if NO_SPEED <= velocity < math.inf:
        both = effort == velocity or NO_EFFORT <= effort < math.inf
        effort_too = f" and effort limit {effort:g} {effort_unit}" if both else ""
        stated = f"velocity limit {velocity:g} {unit}/s{effort_too}"
        position_too = f"{finding.evidence}; " if finding is not None else ""
        finding = Finding(
            "limits-unknown",
            "info",
            joint,
            f"{position_too}{stated}: no arm reaches this, so the limit counts as unknown",
            "write the real limits of the joint into the description if they are needed",
        )
        velocity, effort = math.inf, math.inf if both else effort
    return DescribedLimits(lower, upper, velocity, effort), finding

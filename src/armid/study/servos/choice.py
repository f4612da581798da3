"""Options of the servos of a study: the table `[servo]` of a `study.toml`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import StudyError, did_you_mean
from armid.model.terms import TERMS, Coulomb, Viscous
from armid.robot import Robot
from armid.servo.options import BODIES, ServoOptions

PerJoint = float | Sequence[float] | None
"""One value for all joints, one for each joint in the order of the robot, or none."""


@dataclass(frozen=True, slots=True)
class ServoChoice:
    """Prior knowledge of position servos whose commands a log contains.

    A servo gives the torque K (c - q - b) - D q̇ for the command c; it is limited. Lists have one value for each
    joint.

    Attributes:
        stiffness: K [N·m/rad or N/m]; that of the description, or estimated, if not given.
        stiffness_deviation: Relative standard deviation of a given stiffness; 0 if it is exact.
        damping: D [N·m·s/rad or N·s/m]; part of the viscous friction if not given.
        limit: Largest torque [N·m or N]; the effort limit of the description if not given.
        delay: Expected delay of the command [s].
        link_deviation: Relative standard deviation of the links of the description; 0 if they are exact.
        terms: Friction terms of all joints.
    """

    stiffness: PerJoint = None
    stiffness_deviation: float = 0.0
    damping: PerJoint = None
    limit: PerJoint = None
    delay: float = 0.0
    link_deviation: float = BODIES
    terms: tuple[str, ...] = (Viscous.name, Coulomb.name)

    def __post_init__(self) -> None:
        if isinstance(self.terms, str) or not self.terms or any(name not in TERMS for name in self.terms):
            unknown = next((name for name in self.terms if name not in TERMS), self.terms)
            raise StudyError(
                f"`terms` must be a list of torque terms; found {self.terms!r}.",
                possible=", ".join(TERMS),
                remedy=did_you_mean(unknown, TERMS) or f'write for instance terms = ["{Viscous.name}"].',
            )
        object.__setattr__(self, "terms", tuple(dict.fromkeys(self.terms)))
        for key in ("stiffness", "damping", "limit"):
            value = getattr(self, key)
            given = [] if value is None else np.ravel(value).tolist()
            least = 0.0 if key == "damping" else math.ulp(0.0)
            if not all(_is_number(each) and each >= least for each in given):
                raise StudyError(
                    f"`{key}` must be {'0 or more' if key == 'damping' else 'above 0'}; found {value!r}.",
                    remedy="give one number for all joints, or a list with one for each joint.",
                )
        for key in ("stiffness_deviation", "link_deviation"):
            if not (_is_number(getattr(self, key)) and getattr(self, key) >= 0.0):
                raise StudyError(
                    f"`{key}` must be 0 or more; found {getattr(self, key)!r}.", remedy="0.1 means 10 %."
                )
        if not (_is_number(self.delay) and abs(self.delay) <= 1.0):
            raise StudyError(
                f"`delay` must be a time of at most 1 s; found {self.delay!r}.", remedy="give it in seconds."
            )
        if self.stiffness_deviation > 0.0 and self.stiffness is None:
            raise StudyError(
                "has `stiffness_deviation` but no `stiffness`.",
                remedy="give `stiffness`, too, or leave `stiffness_deviation` out.",
            )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def servo_options(choice: ServoChoice, robot: Robot) -> ServoOptions:
    """Options of the identification, with one value for each joint of the arm.

    Raises:
        StudyError: A list has another number of values than the arm has joints.
    """

    def each(key: str) -> Array | None:
        value = getattr(choice, key)
        if value is None:
            return None
        given = np.ravel(np.asarray(value, dtype=np.float64))
        if given.size not in (1, robot.n):
            raise StudyError(
                f"[servo] `{key}` has {given.size} values, but {robot.name} has {robot.n} joints.",
                remedy=f"give one value, or one for each of {', '.join(robot.joint_names)}.",
            )
        return np.broadcast_to(given, (robot.n,)).copy()

    return ServoOptions(
        each("stiffness"),
        float(choice.stiffness_deviation),
        each("damping"),
        each("limit"),
        float(choice.delay),
        float(choice.link_deviation),
    )

"""Rigid links: the ten inertial parameters of every link, M MX MY MZ XX XY YY XZ YZ ZZ.

The kernel computes their regressor columns by the Newton-Euler recursion; this term only includes them in the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.term import Law
from armid.robot.robot import Robot

RIGID_BODY_SYMBOLS = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
"""Symbols of the ten inertial parameters of a link, in the order in which armid stores the parameters."""


def rigid_body_units() -> tuple[str, ...]:
    """Units of the ten inertial parameters of a link, in the order of `RIGID_BODY_SYMBOLS`."""
    return ("kg", *("kg·m",) * 3, *("kg·m²",) * 6)


@dataclass(frozen=True, slots=True)
class RigidBody:
    """Torque term of the inertia and weight of the links."""

    name: ClassVar[str] = "rigid-body"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Empty tuple, because the kernel computes the columns of the rigid bodies."""
        del robot
        return ()

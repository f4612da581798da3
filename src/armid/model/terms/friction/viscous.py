"""Viscous friction: τ = FV · q̇."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Viscous:
    """Friction proportional to the velocity.

    Attributes:
        joints: Names of the joints with this term; `None` for all joints.
    """

    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "viscous"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FV · dq of each joint."""
        units = ("N·m·s/rad", "N·s/m")
        return single_joint_laws(robot, self.joints, "FV", symbol("dq"), units=units, nonnegative=True)

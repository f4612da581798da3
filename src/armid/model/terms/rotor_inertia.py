"""Inertia of rotor and transmission, reflected to the joint: τ = IA · q̈."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.expression import symbol
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class RotorInertia:
    """Reflected inertia of the drive; gyroscopic effects of the rotor are neglected.

    Attributes:
        joints: Names of the joints that have it; `None` for all.
    """

    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "rotor-inertia"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """IA · ddq on each joint."""
        units = ("kg·m²", "kg")
        return single_joint_laws(robot, self.joints, "IA", symbol("ddq"), units=units, nonnegative=True)

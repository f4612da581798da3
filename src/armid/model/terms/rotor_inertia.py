"""Inertia of rotor and transmission, referred to the joint: τ = IA · q̈."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from armid.model.terms.term import Law, select_joints, single_joint_laws
from armid.model.torque_law_expression import symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class RotorInertia:
    """Inertia of the drive, referred to the joint; gyroscopic effects of the rotor are neglected.

    Attributes:
        joints: Names of the joints with this term; `None` for all joints.
        signed: Names of the joints whose parameter may be negative, because the joint torques of some controllers
            contain less inertia than the links have.
    """

    joints: tuple[str, ...] | None = None
    signed: tuple[str, ...] = ()
    name: ClassVar[str] = "rotor-inertia"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law IA · ddq of each joint."""
        units, signed = ("kg·m²", "kg"), select_joints(robot, self.signed)
        laws = single_joint_laws(robot, self.joints, "IA", symbol("ddq"), units=units, nonnegative=True)
        return tuple(replace(law, nonnegative=law.joint not in signed) for law in laws)

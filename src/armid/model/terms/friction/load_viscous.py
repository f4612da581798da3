"""Viscous friction that grows with the load of the joint: τ = FVL · |load| · q̇.

The load is defined as for `load-coulomb`: the torque of the rigid bodies with the parameters of an earlier estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import magnitude, symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class LoadViscous:
    """Friction proportional to the velocity and to the torque that the gear transmits.

    Attributes:
        joints: Names of the joints with this term; `None` for all joints.
    """

    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "load-viscous"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FVL · |load| · dq of each joint; `load` is the torque of the rigid bodies at this joint."""
        law = magnitude(symbol("load")) * symbol("dq")
        return single_joint_laws(robot, self.joints, "FVL", law, units=("s/rad", "s/m"), nonnegative=True)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return "viscous, grows with the load"

"""Constant torque offset τ = FO, such as the bias of a sensor or an asymmetry of Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import number
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Offset:
    """Constant torque of a joint.

    Attributes:
        joints: Names of the joints with this term; `None` for all joints.
    """

    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "offset"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FO of each joint."""
        return single_joint_laws(robot, self.joints, "FO", number(1.0), units=("N·m", "N"), nonnegative=False)

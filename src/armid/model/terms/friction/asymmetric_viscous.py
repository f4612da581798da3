"""Viscous friction that differs with the direction: τ = FVA · |q̇|, beside FV · q̇ of `viscous`.

In the positive direction it is FV + FVA, in the negative FV - FVA. Physics requires |FVA| ≤ FV, not a sign of FVA.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.expression import magnitude, symbol
from armid.model.terms.automatic import ASYMMETRY, AutomaticChoice, Candidate, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class AsymmetricViscous:
    """Excess of viscous friction in the positive direction over the mean of both.

    Attributes:
        joints: Names of the joints that have it; `None` for all.
    """

    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "asymmetric-viscous"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: AsymmetricViscous(joints),
        options=(
            *one_by_one(ASYMMETRY, "asymmetric-viscous"),
            (ASYMMETRY, (Candidate("asymmetric-coulomb"), Candidate("asymmetric-viscous"))),
        ),
    )

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """FVA · |dq| on each joint."""
        law, units = magnitude(symbol("dq")), ("N·m·s/rad", "N·s/m")
        return single_joint_laws(robot, self.joints, "FVA", law, units=units, nonnegative=False)

    def describe(self, length: str) -> str:
        """The term with its shapes in words, with the unit of length of its joints."""
        del length
        return "viscous, depends on direction"

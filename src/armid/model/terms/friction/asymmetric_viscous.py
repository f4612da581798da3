"""Viscous friction that depends on the direction: τ = FVA · |q̇|, in addition to FV · q̇ of `viscous`.

The coefficient is FV + FVA in the positive direction and FV - FVA in the negative direction. It is physically
possible if |FVA| ≤ FV; FVA may have either sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.selection_candidates import ASYMMETRY, AutomaticChoice, Candidate, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import magnitude, symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class AsymmetricViscous:
    """Torque term for viscous friction that depends on the direction of motion.

    Its parameter is the coefficient in the positive direction minus the mean of both directions.

    Attributes:
        joints: Names of the joints with this term; `None` for all joints.
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
        """Law FVA · |dq| of each joint."""
        law, units = magnitude(symbol("dq")), ("N·m·s/rad", "N·s/m")
        return single_joint_laws(robot, self.joints, "FVA", law, units=units, nonnegative=False)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return "viscous, depends on direction"

"""Coulomb friction that grows with the load of the joint: τ = FSL · |load| · sgn(q̇).

The load is the torque of the rigid bodies that is computed with the inertial parameters of an earlier estimate
(`DynamicsModel.load_parameters`). It is never the measured torque, because the regressor would then contain the
quantity that it must predict.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.checks import require_width
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.selection_candidates import AutomaticChoice, CandidateFamily, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import magnitude, symbol
from armid.robot.robot import Robot

FAMILY = CandidateFamily("load", order=20)


@dataclass(frozen=True, slots=True)
class LoadCoulomb:
    """Coulomb friction proportional to the torque that the gear transmits.

    Attributes:
        width: Velocity over which the sign changes [rad/s or m/s]; 0 for the exact sign function.
        joints: Names of the joints with this term; `None` for all joints.
    """

    width: float = 0.0
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "load-coulomb"
    smooths_sign: ClassVar[bool] = True
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: LoadCoulomb(width, joints),
        options=one_by_one(FAMILY, "load-coulomb"),
    )

    def __post_init__(self) -> None:
        require_width("The width of load-dependent Coulomb friction", self.width)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FSL · |load| · sgn(dq) of each joint; `load` is the torque of the rigid bodies at this joint."""
        law = magnitude(symbol("load")) * coulomb_law(self.width)
        return single_joint_laws(robot, self.joints, "FSL", law, units=("1", "1"), nonnegative=True)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return "Coulomb, grows with the load"

"""Coulomb friction that depends on the direction: τ = FSA · |sgn(q̇)|, in addition to FS · sgn(q̇) of `coulomb`.

The friction is FS + FSA in the positive direction and FS - FSA in the negative direction. It is physically possible
if |FSA| ≤ FS; FSA may have either sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.checks import require_width
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.selection_candidates import ASYMMETRY, AutomaticChoice, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import magnitude
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class AsymmetricCoulomb:
    """Torque term for Coulomb friction that depends on the direction of motion.

    Its parameter is the friction in the positive direction minus the mean of both directions.

    The torque is constant while the joint moves, so it can be distinguished from an offset only with data near
    standstill.

    Attributes:
        width: Velocity over which the sign changes [rad/s or m/s]; 0 for the exact sign function. The width of
            `coulomb` is recommended.
        joints: Names of the joints with this term; `None` for all joints.
    """

    width: float = 0.0
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "asymmetric-coulomb"
    smooths_sign: ClassVar[bool] = True
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: AsymmetricCoulomb(width, joints),
        options=one_by_one(ASYMMETRY, "asymmetric-coulomb"),
    )

    def __post_init__(self) -> None:
        require_width("The width of asymmetric Coulomb friction", self.width)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FSA · |sgn(dq)| of each joint."""
        law = magnitude(coulomb_law(self.width))
        return single_joint_laws(robot, self.joints, "FSA", law, units=("N·m", "N"), nonnegative=False)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return "Coulomb, depends on direction"

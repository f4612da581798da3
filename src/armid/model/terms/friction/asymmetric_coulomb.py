"""Coulomb friction that differs with the direction: τ = FSA · |sgn(q̇)|, beside FS · sgn(q̇) of `coulomb`.

In the positive direction it is FS + FSA, in the negative FS - FSA. Physics requires |FSA| ≤ FS, not a sign of FSA.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.expression import magnitude
from armid.model.terms.automatic import ASYMMETRY, AutomaticChoice, one_by_one
from armid.model.terms.checks import require_width
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class AsymmetricCoulomb:
    """Excess of Coulomb friction in the positive direction over the mean of both.

    It is constant while the joint moves, so only data near standstill distinguish it from an offset.

    Attributes:
        width: Velocity over which the sign changes [rad/s or m/s], best that of `coulomb`; 0 for a true sign.
        joints: Names of the joints that have it; `None` for all.
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
        """FSA · |sgn(dq)| on each joint."""
        law = magnitude(coulomb_law(self.width))
        return single_joint_laws(robot, self.joints, "FSA", law, units=("N·m", "N"), nonnegative=False)

    def describe(self, length: str) -> str:
        """The term with its shapes in words, with the unit of length of its joints."""
        del length
        return "Coulomb, depends on direction"

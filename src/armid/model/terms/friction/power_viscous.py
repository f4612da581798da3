"""Viscous friction by a power law: τ = FW · q̇ (q̇² + width²)^((exponent - 1) / 2).

At speeds well above the width, the law is sgn(q̇) |q̇|^exponent. Below the width it is linear, because a power with
an exponent below 1 has an infinite slope at zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.checks import require_positive
from armid.model.terms.selection_candidates import VELOCITY, AutomaticChoice, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class PowerViscous:
    """Friction proportional to a power of the speed, for instance below 1 for cold grease or above 1 for churned oil.

    The law is physically possible if its sum with FV · q̇ opposes the motion at every velocity; FW and FV may have
    either sign.

    Attributes:
        exponent: Exponent of the velocity.
        width: Velocity below which the law is linear [rad/s or m/s].
        joints: Names of the joints with this term; `None` for all joints.
    """

    exponent: float = 0.5
    width: float = 0.02
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "power-viscous"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: PowerViscous(shapes[0], max(width, 0.02), joints),
        options=one_by_one(VELOCITY, "power-viscous", (0.5,)),
        one_shape=True,
    )

    def __post_init__(self) -> None:
        require_positive("The exponent of power-law friction", self.exponent)
        require_positive("The width of power-law friction", self.width)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FW · dq (dq² + width²)^((exponent - 1) / 2) of each joint."""
        velocity = symbol("dq")
        law = velocity * (velocity**2.0 + self.width**2.0) ** (0.5 * (self.exponent - 1.0))
        units = (f"N·m·(s/rad)^{self.exponent:g}", f"N·(s/m)^{self.exponent:g}")
        return single_joint_laws(robot, self.joints, "FW", law, units=units, nonnegative=False)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return f"viscous, velocity to the power {self.exponent:.3g}"

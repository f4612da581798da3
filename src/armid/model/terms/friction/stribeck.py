"""Stribeck effect: τ = FT · exp(-(|q̇| / velocity)^shape) · sgn(q̇), friction that vanishes as the speed grows.

With FS · sgn(q̇) the breakaway friction is FS + FT, which physics requires not to be negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.expression import exponential, magnitude, symbol
from armid.model.terms.checks import require_positive, require_width
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Stribeck:
    """Friction near standstill in addition to Coulomb friction [ArmstrongHelouvry1994].

    Attributes:
        velocity: Velocity at which it has fallen to 1/e [rad/s or m/s].
        shape: Exponent of the fall with speed, at least 1; 2 is a Gaussian.
        width: Velocity over which the sign changes [rad/s or m/s], well below `velocity`; 0 for a true sign.
        joints: Names of the joints that have it; `None` for all.
    """

    velocity: float = 0.1
    shape: float = 2.0
    width: float = 0.0
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "stribeck"

    def __post_init__(self) -> None:
        require_positive("The Stribeck velocity", self.velocity)
        require_positive("The shape of the Stribeck effect", self.shape, least=1.0)
        require_width("The width of the Stribeck effect", self.width)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """FT · exp(-(|dq| / velocity)^shape) · sgn(dq) on each joint."""
        fallen = exponential(-((magnitude(symbol("dq")) * (1.0 / self.velocity)) ** self.shape))
        law = fallen * coulomb_law(self.width)
        return single_joint_laws(robot, self.joints, "FT", law, units=("N·m", "N"), nonnegative=False)

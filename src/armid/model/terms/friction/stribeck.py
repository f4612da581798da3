"""Stribeck effect: τ = FT · exp(-(|q̇| / velocity)^shape) · sgn(q̇), friction that decreases with the speed.

Together with FS · sgn(q̇), the breakaway friction is FS + FT. The law is physically possible if this sum is not
negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.checks import require_positive, require_width
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.selection_candidates import VELOCITY, AutomaticChoice, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import exponential, magnitude, symbol
from armid.robot.robot import Robot

VELOCITIES = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Stribeck velocities that the automatic selection tries [rad/s or m/s], each about twice the one before. Finer steps
are not needed, because the residual depends little on this velocity."""


@dataclass(frozen=True, slots=True)
class Stribeck:
    """Friction near standstill that is added to Coulomb friction and decreases with speed [ArmstrongHelouvry1994].

    Attributes:
        velocity: Velocity at which the friction of this term has decreased to 1/e [rad/s or m/s].
        shape: Exponent of the decrease with speed, at least 1; with 2, the decrease is Gaussian.
        width: Velocity over which the sign changes [rad/s or m/s], well below `velocity`; 0 for the exact sign
            function.
        joints: Names of the joints with this term; `None` for all joints.
    """

    velocity: float = 0.1
    shape: float = 2.0
    width: float = 0.0
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "stribeck"
    smooths_sign: ClassVar[bool] = True
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: Stribeck(shapes[0], 2.0, width, joints),
        options=one_by_one(VELOCITY, "stribeck", VELOCITIES),
        saturation=2.0,
        one_shape=True,
        resolution="height",
        # exp(-(dq / shape)²); the width of the sign does not depend on the shape
        log_slope=lambda law, shape: 2.0 * (symbol("dq") * (1.0 / shape)) ** 2.0 * law,
    )

    def __post_init__(self) -> None:
        require_positive("The Stribeck velocity", self.velocity)
        require_positive("The shape of the Stribeck effect", self.shape, least=1.0)
        require_width("The width of the Stribeck effect", self.width)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FT · exp(-(|dq| / velocity)^shape) · sgn(dq) of each joint."""
        fallen = exponential(-((magnitude(symbol("dq")) * (1.0 / self.velocity)) ** self.shape))
        law = fallen * coulomb_law(self.width)
        return single_joint_laws(robot, self.joints, "FT", law, units=("N·m", "N"), nonnegative=False)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        return f"Stribeck effect at {self.velocity:.3g} {length}/s"

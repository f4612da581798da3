"""Coulomb friction: τ = FS · sgn(q̇), or FS · tanh(q̇ / width) if the width is not zero.

If the arm rests, the sign of the velocity is the sign of the encoder noise, which doubles the torque error; a width
prevents this. If the friction of the arm really follows the exact sign, a width causes an error of about a newton
metre. The width can therefore be chosen; width 0 gives the exact sign with sgn(0) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.errors import ModelError
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import Expression, sign, symbol, tanh
from armid.robot.robot import Robot


def coulomb_law(width: float) -> Expression:
    """Expression sgn(dq) for a width of zero, otherwise tanh(dq / width)."""
    velocity = symbol("dq")
    return sign(velocity) if width == 0.0 else tanh(velocity * (1.0 / width))


@dataclass(frozen=True, slots=True)
class Coulomb:
    """Friction of constant size against the direction of motion.

    Attributes:
        width: Velocity over which the sign changes [rad/s or m/s]; 0 for the exact sign function.
        joints: Names of the joints with this term; `None` for all joints.
    """

    width: float = 0.0
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "coulomb"
    smooths_sign: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.width < float("inf"):
            raise ModelError(
                "The width of Coulomb friction, the velocity over which its sign changes, must be finite and not "
                f"negative; found {self.width}."
            )

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FS · sgn(dq) of each joint."""
        law = coulomb_law(self.width)
        return single_joint_laws(robot, self.joints, "FS", law, units=("N·m", "N"), nonnegative=True)

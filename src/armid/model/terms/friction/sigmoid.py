"""Friction as a sigmoid of the velocity, which replaces Coulomb, Stribeck and offset on the Panda [Gaz2019].

τ = FG · (1 / (1 + exp(-slope (q̇ + shift))) - 1 / (1 + exp(-slope shift))), zero at rest. It is computed by tanh,
which never overflows: 1 / (1 + exp(-x)) = (1 + tanh(x / 2)) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tanh as tanh_of
from typing import ClassVar

from armid.errors import ModelError
from armid.model.expression import symbol, tanh
from armid.model.terms.checks import require_positive
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Sigmoid:
    """Coulomb friction with a smooth sign; with a shift it is larger in one direction.

    Attributes:
        slope: Slope of the exponent [s/rad or s/m]; without a shift the law is half of tanh(slope q̇ / 2).
        shift: Distance of the sigmoid's centre below zero velocity [rad/s or m/s].
        joints: Names of the joints that have it; `None` for all.
    """

    slope: float = 20.0
    shift: float = 0.05
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "sigmoid"

    def __post_init__(self) -> None:
        require_positive("The slope of a sigmoid", self.slope)
        if not abs(self.shift) < float("inf"):
            raise ModelError(f"The shift of a sigmoid must be a number; found {self.shift}.")

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """FG · (σ(slope (dq + shift)) - σ(slope shift)) on each joint."""
        half = 0.5 * self.slope
        law = 0.5 * (tanh(half * (symbol("dq") + self.shift)) - tanh_of(half * self.shift))
        return single_joint_laws(robot, self.joints, "FG", law, units=("N·m", "N"), nonnegative=True)

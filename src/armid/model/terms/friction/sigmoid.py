"""Friction as a sigmoid of the velocity, used on the Panda in place of Coulomb, Stribeck and offset [Gaz2019].

τ = FG · (1 / (1 + exp(-slope (q̇ + shift))) - 1 / (1 + exp(-slope shift))), which is zero at rest. It is computed
with tanh, which never overflows: 1 / (1 + exp(-x)) = (1 + tanh(x / 2)) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tanh as tanh_of
from typing import ClassVar

from armid.errors import ModelError
from armid.model.terms.checks import require_positive
from armid.model.terms.selection_candidates import VELOCITY, AutomaticChoice, one_by_one
from armid.model.terms.term import Law, single_joint_laws
from armid.model.torque_law_expression import derivative, symbol, tanh
from armid.robot.robot import Robot

SCALES = (0.05, 0.2, 0.5)
"""Velocity scales, 2 / slope, that the automatic selection tries [rad/s or m/s]."""


@dataclass(frozen=True, slots=True)
class Sigmoid:
    """Coulomb friction with a smooth sign function; with a shift, the friction is larger in one direction.

    Attributes:
        slope: Factor on the velocity in the exponent [s/rad or s/m]; without a shift the law is ½ FG · tanh(slope q̇
            / 2).
        shift: Distance by which the centre of the sigmoid is shifted to negative velocity [rad/s or m/s].
        joints: Names of the joints with this term; `None` for all joints.
    """

    slope: float = 20.0
    shift: float = 0.05
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "sigmoid"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: Sigmoid(2.0 / shapes[0], 0.0, joints),
        options=one_by_one(VELOCITY, "sigmoid", SCALES),
        saturation=2.0,
        one_shape=True,
        resolution="height",
        log_slope=lambda law, shape: -symbol("dq") * derivative(law, "dq"),  # it is a function of dq / shape
    )

    def __post_init__(self) -> None:
        require_positive("The slope of a sigmoid", self.slope)
        if not abs(self.shift) < float("inf"):
            raise ModelError(f"The shift of a sigmoid must be a number; found {self.shift}.")

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Law FG · (σ(slope (dq + shift)) - σ(slope shift)) of each joint, with the sigmoid σ."""
        half = 0.5 * self.slope
        law = 0.5 * (tanh(half * (symbol("dq") + self.shift)) - tanh_of(half * self.shift))
        return single_joint_laws(robot, self.joints, "FG", law, units=("N·m", "N"), nonnegative=True)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        return f"sigmoid of velocity over {2.0 / self.slope:.3g} {length}/s"

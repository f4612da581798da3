"""Viscous friction whose slope changes at knots v_k: τ = Σ FP_k · sgn(q̇) max(|q̇| - v_k, 0).

It acts in addition to the viscous friction FV · q̇. Above knot k the slope is FV + FP1 + … + FPk. The law is
physically possible if the total friction opposes the motion at every speed; a single FP may have either sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.terms.checks import require_rising
from armid.model.terms.selection_candidates import VELOCITY, AutomaticChoice, Candidate
from armid.model.terms.term import Law, listed, single_joint_laws
from armid.model.torque_law_expression import maximum, symbol
from armid.robot.robot import Robot

KNOTS = (0.1, 0.3, 0.6)
"""Speeds at which the slope can change in the laws that the automatic selection tries [rad/s or m/s]."""


@dataclass(frozen=True, slots=True)
class PiecewiseViscous:
    """Friction that is piecewise linear in the speed, added to viscous friction; zero below the first knot.

    Attributes:
        knots: Speeds at which the slope changes, ascending [rad/s or m/s].
        joints: Names of the joints with this term; `None` for all joints.
    """

    knots: tuple[float, ...] = (0.1, 0.3, 1.0)
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "piecewise-viscous"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: PiecewiseViscous(shapes, joints),
        options=((VELOCITY, tuple(Candidate("piecewise-viscous", knot) for knot in KNOTS)),),
        saturation=1.5,
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "knots", require_rising("The knots of piecewise viscous friction", self.knots))

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws FP_k · (max(dq - v_k, 0) - max(-dq - v_k, 0)) of each joint, one for each knot v_k."""
        velocity, units = symbol("dq"), ("N·m·s/rad", "N·s/m")
        laws: list[Law] = []
        for k, knot in enumerate(self.knots, 1):
            law = maximum(velocity - knot, 0.0) - maximum(-velocity - knot, 0.0)
            laws += single_joint_laws(robot, self.joints, f"FP{k}", law, units=units, nonnegative=False)
        return tuple(laws)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        return f"viscous, slope changes at {listed(self.knots)} {length}/s"

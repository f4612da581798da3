"""Hysteresis at reversals by the Maxwell-slip model: τ = Σ FH_k · (q - z_k) / r_k, springs that slip at r_k.

Each element is a spring whose other end z_k is dragged along once its deflection is r_k: a play operator in q. After
a reversal its torque changes from one limit to the other over 2 r_k, independent of the velocity [AlBender2005].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.model.hysteresis_memory import Play
from armid.model.terms.checks import require_rising
from armid.model.terms.term import Law, single_joint_laws
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Friction with hysteresis in the position: a sum of elasto-slip elements.

    Attributes:
        widths: Deflections at which the elements slip, ascending [rad or m].
        joints: Names of the joints that have it; `None` for all.
    """

    widths: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1)
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "hysteresis"

    def __post_init__(self) -> None:
        object.__setattr__(self, "widths", require_rising("The widths of hysteresis", self.widths))

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """FH1, FH2, …, one for each width, on each joint: (q - z) / r, from -1 to 1."""
        laws: list[Law] = []
        for k, width in enumerate(self.widths, 1):
            play = Play(width)
            laws += single_joint_laws(
                robot, self.joints, f"FH{k}", play.deflection, units=("N·m", "N"), nonnegative=True, memory=play
            )
        return tuple(laws)

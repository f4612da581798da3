"""Torque that is periodic in the angle of the joint or of its motor: τ = Σ RS_k sin(k q) + RC_k cos(k q).

RS_k and RC_k are the parameters of harmonic k. Sensors, gears and motors cause such torques. If gravity acts on a
joint, the first harmonic cannot be distinguished from the first moments of the links. With few poses, the same is
true for other low harmonics. Harmonics should be chosen by cross-validation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from armid.errors import ModelError
from armid.model.terms.checks import require_positive, require_rising
from armid.model.terms.selection_candidates import AutomaticChoice, CandidateFamily, one_by_one
from armid.model.terms.term import Law, listed, single_joint_laws
from armid.model.torque_law_expression import Expression, cosine, sine, symbol
from armid.robot.robot import Robot

FAMILY = CandidateFamily("ripple", order=40, position=True, rounds=3, margin=3.0, min_gain=0.05)

HARMONICS = (2.0, 3.0, 4.0, 5.0, 6.0)
"""Harmonics of the joint angle that the automatic selection tries. The first harmonic is not tried, because gravity
causes it, too. Harmonics above the sixth were found in no recording."""


@dataclass(frozen=True, slots=True)
class Ripple:
    """Torque that is periodic in the position of the joint or motor.

    Attributes:
        harmonics: Multiples of the angle of the joint, ascending; for a prismatic joint, multiples of its position in
            rad/m.
        motor_harmonics: Multiples of the angle of the motor, ascending.
        gear_ratio: Angle of the motor divided by the angle of the joint; required for `motor_harmonics`.
        joints: Names of the joints with this term; `None` for all joints.
    """

    harmonics: tuple[float, ...] = (2.0, 3.0, 4.0)
    motor_harmonics: tuple[float, ...] = ()
    gear_ratio: float | None = None
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "ripple"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: Ripple(shapes, joints=joints),
        options=one_by_one(FAMILY, "ripple", HARMONICS),
        periodic=True,
    )

    def __post_init__(self) -> None:
        for which in ("harmonics", "motor_harmonics"):
            if getattr(self, which) != ():
                object.__setattr__(self, which, require_rising(f"The {which} of ripple", getattr(self, which)))
        if not self.harmonics and not self.motor_harmonics:
            raise ModelError(
                "The torque term ripple needs at least one harmonic.",
                remedy="give harmonics, for instance harmonics = [2.0, 3.0].",
            )
        if self.motor_harmonics and self.gear_ratio is None:
            raise ModelError(
                "The option `motor_harmonics` of ripple needs the gear ratio, which is not given.",
                remedy="give the option `gear_ratio`, the angle of the motor divided by the angle of the joint.",
            )
        if self.gear_ratio is not None:
            require_positive("The gear ratio of ripple", self.gear_ratio)

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws of each joint: RS2, RC2, … for harmonics of the joint, RSM1, RCM1, … for harmonics of the motor."""
        angle = symbol("q")
        waves = [(f"{k:g}", angle * float(k)) for k in self.harmonics]
        waves += [(f"M{k:g}", angle * (float(k) * float(self.gear_ratio or 1.0))) for k in self.motor_harmonics]
        laws: list[Law] = []
        for number, phase in waves:
            laws += self._law(robot, f"RS{number}", sine(phase)) + self._law(robot, f"RC{number}", cosine(phase))
        return tuple(laws)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        del length
        return f"ripple, harmonics {listed(self.harmonics)}"

    def _law(self, robot: Robot, symbol: str, wave: Expression) -> tuple[Law, ...]:
        return single_joint_laws(robot, self.joints, symbol, wave, units=("N·m", "N"), nonnegative=False)

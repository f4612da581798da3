"""Drive that moves several joints; its inertia and friction act on a combination of joint coordinates.

With the motor coordinate c = Σ w_j q_j, the torque of the drive is IAM · c̈ + FVM · ċ + FSM · sgn(ċ). It acts on
joint j with the weight w_j. An example is the wrist of the Stäubli TX40, whose motor 6 turns with q̇_5 + q̇_6
[Janot2014].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from armid.errors import ModelError
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.term import Law
from armid.model.torque_law_expression import symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Coupling:
    """Inertia, viscous and Coulomb friction of a drive that moves several joints.

    Attributes:
        joints: Weights of at least two joints, by the name of the joint.
        width: Velocity of the motor coordinate over which the sign of the friction changes [rad/s or m/s]; 0 for the
            exact sign function.
    """

    joints: Mapping[str, float] = field(default_factory=dict[str, float])
    width: float = 0.0
    name: ClassVar[str] = "coupling"

    def __post_init__(self) -> None:
        if len(self.joints) < 2 or not all(self.joints.values()):
            raise ModelError(
                f"A coupling needs at least two joints with nonzero weights; found {dict(self.joints)}.",
                remedy="give weights, for instance coupling = { joints = { joint_5 = 1.0, joint_6 = 1.0 } }.",
            )
        if not 0.0 <= self.width < float("inf"):
            raise ModelError(
                "The width of a coupling, the velocity over which the sign of its Coulomb friction changes, must be "
                f"finite and not negative; found {self.width}."
            )

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws IAM · ddc, FVM · dc and FSM · sgn(dc) of the motor coordinate c = Σ w_j q_j.

        The names of their parameters contain the number of the last of the coupled joints.
        """
        coordinate = tuple(sorted((robot.joint_index(name), float(w)) for name, w in self.joints.items()))
        kinds = {robot.joints[j].kind == "prismatic" for j, _ in coordinate}
        if len(kinds) > 1:
            raise ModelError(
                "The joints of a coupling must be either all revolute or all prismatic.",
                remedy="give separate couplings for revolute and for prismatic joints.",
            )
        prismatic = kinds == {True}
        units = ("kg", "N·s/m", "N") if prismatic else ("kg·m²", "N·m·s/rad", "N·m")
        expressions = (symbol("ddq"), symbol("dq"), coulomb_law(self.width))
        last = coordinate[-1][0]
        return tuple(
            Law(name, last, unit, coordinate, expression, nonnegative=True)
            for name, unit, expression in zip(("IAM", "FVM", "FSM"), units, expressions, strict=True)
        )

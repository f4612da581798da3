"""Drive that moves several joints: its inertia and friction act on a combination of joint coordinates.

With the motor coordinate c = Σ w_j q_j, the drive's torque IAM · c̈ + FVM · ċ + FSM · sgn(ċ) acts on joint j with
its weight w_j. Example: the wrist of the Stäubli TX40, where motor 6 turns with q̇_5 + q̇_6 [Janot2014].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from armid.errors import ModelError
from armid.model.expression import symbol
from armid.model.terms.friction.coulomb import coulomb_law
from armid.model.terms.term import Law
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Coupling:
    """Inertia, viscous and Coulomb friction of a drive shared by joints.

    Attributes:
        joints: Weight of each joint by name, for at least two joints.
        width: Velocity over which the sign of the friction changes [rad/s]; 0 for a true sign.
    """

    joints: Mapping[str, float] = field(default_factory=dict[str, float])
    width: float = 0.0
    name: ClassVar[str] = "coupling"

    def __post_init__(self) -> None:
        if len(self.joints) < 2 or not all(self.joints.values()):
            raise ModelError(
                f"A coupling needs at least two joints with weights that are not zero; found {dict(self.joints)}.",
                remedy="give weights, for instance coupling = { joints = { joint_5 = 1.0, joint_6 = 1.0 } }.",
            )
        if not 0.0 <= self.width < float("inf"):
            raise ModelError(f"The width of Coulomb friction must be zero or positive; found {self.width}.")

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """IAM · ddc, FVM · dc and FSM · sgn(dc), numbered by the last joint of the combination."""
        coordinate = tuple(sorted((robot.joint_index(name), float(w)) for name, w in self.joints.items()))
        kinds = {robot.joints[j].kind == "prismatic" for j, _ in coordinate}
        if len(kinds) > 1:
            raise ModelError(
                "A coupling joins either revolute or prismatic joints, not both.",
                remedy="give revolute and prismatic joints couplings of their own.",
            )
        prismatic = kinds == {True}
        units = ("kg", "N·s/m", "N") if prismatic else ("kg·m²", "N·m·s/rad", "N·m")
        expressions = (symbol("ddq"), symbol("dq"), coulomb_law(self.width))
        last = coordinate[-1][0]
        return tuple(
            Law(name, last, unit, coordinate, expression, nonnegative=True)
            for name, unit, expression in zip(("IAM", "FVM", "FSM"), units, expressions, strict=True)
        )

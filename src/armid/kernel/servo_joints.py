"""Servos, torque laws and parameters in the form of the roll-out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.kernel.joint_column_layout import ColumnLayout

OPERATIONS = (
    "number", "q", "dq", "add", "mul", "pow", "sign", "tanh", "abs", "exp", "sin", "cos", "max", "min",
)  # fmt: skip
"""Operations of a law's program, in the order of the compiled kernel: the first three put a number, the position or
the velocity on the stack; `pow` has its exponent in `constant`."""

STEEP = 1e-5
"""Velocity up to which a joint with dry friction sticks [rad/s or m/s]. In a minute, a stuck joint moves by at most
0.6 mrad."""


@dataclass(frozen=True, eq=False, slots=True)
class LawPrograms:
    """Torque laws of l coordinates as programs on a stack.

    Attributes:
        first: Number of the first operation of each law, and of all operations, shape (l + 1,).
        operation: Index in `OPERATIONS` of each operation.
        constant: Number of each operation that has one, otherwise 0.
        link: Number of the first joint of each law's coordinate, and of all joints, shape (l + 1,).
        joint: Index of each of these joints.
        weight: Weight of each of these joints in the coordinate.
    """

    first: NDArray[np.int32]
    operation: NDArray[np.int32]
    constant: Array
    link: NDArray[np.int32]
    joint: NDArray[np.int32]
    weight: Array

    def __post_init__(self) -> None:
        for name in ("first", "operation", "link", "joint"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.int32))
        for name in ("constant", "weight"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))

    @property
    def count(self) -> int:
        """Number of laws l."""
        return len(self.first) - 1


@dataclass(frozen=True, eq=False, slots=True)
class ServoJoints:
    """Servos that hold n joints to commands, and the torque laws of these joints.

    Attributes:
        stiffness: Torque for a unit of position error, shape (n,) [N·m/rad or N/m].
        damping: Torque for a unit of velocity, shape (n,) [N·m·s/rad or N·s/m].
        limit: Largest torque of the servo, infinite if it has none, shape (n,) [N·m or N].
        armature: Rotor inertia, shape (n,) [kg·m² or kg].
        laws: Torque laws, such as friction.
        values: Parameter of each law, shape (l,).
        step: Step of the integration [s].
        steep: Velocity up to which a joint with dry friction sticks [rad/s or m/s].
    """

    stiffness: Array
    damping: Array
    limit: Array
    armature: Array
    laws: LawPrograms
    values: Array
    step: float
    steep: float = STEEP

    def __post_init__(self) -> None:
        n = len(self.stiffness)
        for name in ("stiffness", "damping", "limit", "armature"):
            finite = name != "limit"
            object.__setattr__(self, name, array(getattr(self, name), (n,), name, finite=finite))
        object.__setattr__(self, "values", array(self.values, (self.laws.count,), "values"))
        if not (self.step > 0.0 and self.steep > 0.0):
            raise ArmidError(f"The step of a roll-out must be above zero; found {self.step:g} s.")
        if not (self.limit > 0.0).all():
            raise ArmidError(
                "The largest torque of a servo must be above zero.", remedy="leave it infinite if unknown."
            )
        if (self.stiffness < 0.0).any() or (self.damping < 0.0).any() or (self.armature < 0.0).any():
            raise ArmidError(
                "Stiffness, damping and rotor inertia of a servo must not be negative.",
                remedy="check the signs of these values.",
            )


@dataclass(frozen=True, eq=False, slots=True)
class RollOutParameters:
    """Parameters by which a roll-out is differentiated, numbered 0 … count - 1.

    Attributes:
        count: Number of parameters.
        links: Layout of the regressor columns of the inertial parameters among them (`make_layout`).
        law: Number of the parameter of each law, -1 if it is not among them, shape (l,).
        joint: Numbers of rotor inertia, stiffness, damping and largest torque of each joint, -1 if not among them,
            shape (4, n).
        input_joint: Joint of each input, shape (e,). An input is a torque of a servo for a unit of a parameter.
        input_parameter: Number of the parameter of each input, shape (e,).
    """

    count: int
    links: ColumnLayout
    law: NDArray[np.integer]
    joint: NDArray[np.integer]
    input_joint: NDArray[np.integer]
    input_parameter: NDArray[np.integer]

    def __post_init__(self) -> None:
        for name in ("law", "joint", "input_joint", "input_parameter"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.int32))

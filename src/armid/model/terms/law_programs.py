"""Torque laws of a model as programs of the roll-out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.errors import ModelError
from armid.kernel.servo_joints import OPERATIONS, LawPrograms
from armid.model.terms.term import Law
from armid.model.torque_law_expression import Expression, symbols


def law_programs(laws: Sequence[Law]) -> LawPrograms:
    """Programs of torque laws that depend on the position and velocity of their coordinate only.

    Raises:
        ModelError: A law depends on the acceleration, the load or a hysteresis state.
    """
    first, link, joint, weight = [0], [0], list[int](), list[float]()
    program: list[tuple[int, float]] = []
    for law in laws:
        if unknown := sorted(symbols(law.expression) - {"q", "dq"}):
            raise ModelError(
                f"The law of {law.symbol}_{law.joint + 1} depends on {', '.join(unknown)}, but a roll-out "
                "has laws of position and velocity only.",
                remedy="leave this term out.",
            )
        program += _operations(law.expression)
        first.append(len(program))
        joint += [j for j, _ in law.coordinate]
        weight += [w for _, w in law.coordinate]
        link.append(len(joint))
    operations = np.array([operation for operation, _ in program], dtype=np.int32)
    constants = np.array([constant for _, constant in program], dtype=np.float64)
    of_joints = np.array(joint, dtype=np.int32), np.array(weight, dtype=np.float64)
    return LawPrograms(
        np.array(first, dtype=np.int32), operations, constants, np.array(link, dtype=np.int32), *of_joints
    )


def _operations(expression: Expression) -> list[tuple[int, float]]:
    """Operations of an expression in the order in which a stack needs them, each with its constant."""
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str):
        return [(OPERATIONS.index("number"), head)]
    if head == "pow":
        exponent = arguments[1].head
        if isinstance(exponent, str):
            raise ModelError(f"The exponent of a law must be a number; found {exponent!r}.")
        return [*_operations(arguments[0]), (OPERATIONS.index("pow"), exponent)]
    return [each for argument in arguments for each in _operations(argument)] + [(OPERATIONS.index(head), 0.0)]

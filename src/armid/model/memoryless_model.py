"""Model without hysteresis states, in which all hysteresis elements slip in the direction of motion.

Hysteresis depends on the earlier motion. As soon as a coordinate has moved by twice the width of an element, however,
the deflection of the element is at its limit, like Coulomb friction. The torques with hysteresis and with slipping
elements are therefore equal, except within this distance after a reversal, where the friction of slipping elements is
larger.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Term
from armid.model.terms.term import Law
from armid.model.torque_law_expression import Expression, sign, symbol
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class _Slipping:
    """Torque term whose hysteresis elements slip; it has the parameters of the original term.

    Attributes:
        original: The term with hysteresis.
    """

    original: Term
    name: ClassVar[str] = "slipping"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws of the original term, without hysteresis states."""
        return tuple(_slipping(law) for law in self.original.laws(robot))


def slipping(model: DynamicsModel) -> DynamicsModel:
    """Replaces all hysteresis elements of a model by elements that always slip.

    A model without hysteresis is returned unchanged.

    Args:
        model: Arm and torque terms.
    """
    if not model.nodes:
        return model
    terms = tuple(
        _Slipping(term) if any(law.memory is not None for law in term.laws(model.robot)) else term
        for term in model.terms
    )
    return replace(model, terms=terms)


def _slipping(law: Law) -> Law:
    """Law in which the state of the play operator is always one half-width behind the coordinate.

    A law without hysteresis is returned unchanged.
    """
    if law.memory is None:
        return law
    trailing = symbol("q") - law.memory.width * sign(symbol("dq"))
    return replace(law, expression=_replaced(law.expression, trailing), memory=None)


def _replaced(expression: Expression, state: Expression) -> Expression:
    """Replaces the symbol `state` in an expression by another expression."""
    if not expression.arguments:
        return state if expression.head == "state" else expression
    return Expression(expression.head, tuple(_replaced(each, state) for each in expression.arguments))

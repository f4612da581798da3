"""Laws with corners, made smooth for a search.

A design by derivatives sees nothing of sign(q̇): its derivative is zero wherever it exists, so friction columns
would have no say in where the joints reverse. During a search every sign is therefore a tanh of some width [rad/s or
m/s], which a search makes narrower step by step; a tanh in a law is made as wide where it is narrower. What a design
reports is always computed with the laws as they are.
"""

from __future__ import annotations

from functools import lru_cache

from armid.model.expression import Expression, derivative, number, tanh

__all__ = ["softened"]


@lru_cache(maxsize=256)
def softened(expression: Expression, width: float) -> Expression:
    """The law with every sign and steep tanh spread over a width; the law itself where the width is zero."""
    if width == 0.0 or not expression.arguments:
        return expression
    arguments = tuple(softened(argument, width) for argument in expression.arguments)
    if expression.head == "sign":
        return tanh(arguments[0] / width)
    if expression.head == "abs":  # |x| = x sign(x)
        return arguments[0] * tanh(arguments[0] / width)
    if expression.head == "tanh":
        slope = derivative(arguments[0], "dq")
        steepness = slope.head if not isinstance(slope.head, str) else 0.0
        if abs(steepness) * width > 1.0:
            return tanh(arguments[0] * number(1.0 / (abs(steepness) * width)))
    return Expression(expression.head, arguments)

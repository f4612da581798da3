"""Smooth approximations of friction laws with corners, for a gradient-based search.

The derivative of sign(q̇) is zero wherever it exists. Without smoothing, the gradient would therefore not contain the
effect of the times of the reversals on the friction columns. A search replaces every sign by a tanh with a width
[rad/s or m/s] that is reduced from stage to stage. A narrower tanh in a law is replaced by a tanh with this width.
Reported values are computed with the laws that are not smoothed.
"""

from __future__ import annotations

from functools import lru_cache

from armid.model.torque_law_expression import Expression, derivative, number, tanh


@lru_cache(maxsize=256)
def smoothed(expression: Expression, width: float) -> Expression:
    """Law with every sign and steep tanh smoothed over a width [rad/s or m/s]; unchanged if the width is zero."""
    if width == 0.0 or not expression.arguments:
        return expression
    arguments = tuple(smoothed(argument, width) for argument in expression.arguments)
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

"""Expressions of torque laws, as trees of numbers, symbols and functions.

From an expression, the values of a regressor column (`evaluate`), derivatives with respect to a symbol (`derivative`)
and printed forms of the law (`text`, `latex`) are computed. `FUNCTIONS` lists the functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ModelError, did_you_mean


@dataclass(frozen=True, slots=True)
class Expression:
    """Expression: a number, a symbol, or a function of other expressions.

    `head` is a float for a number, or the name of the symbol or function. `arguments` are the arguments of a
    function.
    """

    head: float | str
    arguments: tuple[Expression, ...] = ()

    def __add__(self, other: Expression | float) -> Expression:
        return _sum(self, number(other))

    def __radd__(self, other: float) -> Expression:
        return _sum(number(other), self)

    def __sub__(self, other: Expression | float) -> Expression:
        return _sum(self, _product(number(-1.0), number(other)))

    def __neg__(self) -> Expression:
        return _product(number(-1.0), self)

    def __mul__(self, other: Expression | float) -> Expression:
        return _product(self, number(other))

    def __rmul__(self, other: float) -> Expression:
        return _product(number(other), self)

    def __truediv__(self, other: Expression | float) -> Expression:
        return _product(self, _power(number(other), number(-1.0)))

    def __pow__(self, exponent: Expression | float) -> Expression:
        return _power(self, number(exponent))

    def __str__(self) -> str:
        return text(self)


def number(value: Expression | float) -> Expression:
    """Converts a float to a constant expression; an expression is returned unchanged."""
    return value if isinstance(value, Expression) else Expression(float(value))


def symbol(name: str) -> Expression:
    """Expression of one variable: `q`, `dq`, `ddq`, `load` or `state` of the coordinate of a law."""
    return Expression(name)


def sign(x: Expression) -> Expression:
    """Sign of an expression: -1 below zero, 0 at zero, 1 above zero."""
    return Expression("sign", (x,))


def tanh(x: Expression) -> Expression:
    """Hyperbolic tangent of an expression."""
    return Expression("tanh", (x,))


def magnitude(x: Expression) -> Expression:
    """Absolute value of an expression."""
    return Expression("abs", (x,))


def exponential(x: Expression) -> Expression:
    """Exponential function of an expression."""
    return Expression("exp", (x,))


def sine(x: Expression) -> Expression:
    """Sine of an expression whose values are angles [rad]."""
    return Expression("sin", (x,))


def cosine(x: Expression) -> Expression:
    """Cosine of an expression whose values are angles [rad]."""
    return Expression("cos", (x,))


def maximum(x: Expression, y: Expression | float) -> Expression:
    """Larger of two expressions."""
    return Expression("max", (x, number(y)))


def minimum(x: Expression, y: Expression | float) -> Expression:
    """Smaller of two expressions."""
    return Expression("min", (x, number(y)))


def _is(x: Expression, value: float) -> bool:
    return not x.arguments and x.head == value


def _constant(x: Expression) -> float | None:
    return None if isinstance(x.head, str) else x.head


def _sum(a: Expression, b: Expression) -> Expression:
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    return Expression("add", (a, b))


def _product(a: Expression, b: Expression) -> Expression:
    """Product of two expressions; a number comes before other factors."""
    x, y = _constant(a), _constant(b)
    if x is None and y is not None:
        return _product(b, a)
    if x == 0.0 or y == 0.0:
        return _ZERO
    if x == 1.0:
        return b
    if x is not None and y is not None:
        return number(x * y)
    inner = _constant(b.arguments[0]) if b.head == "mul" else None
    if x is not None and inner is not None:
        return _product(number(x * inner), b.arguments[1])
    return Expression("mul", (a, b))


def _power(a: Expression, b: Expression) -> Expression:
    if _is(b, 1.0):
        return a
    if _is(b, 0.0):
        return number(1.0)
    x, y = _constant(a), _constant(b)
    if x is not None and y is not None and x > 0.0:
        return number(x**y)
    return Expression("pow", (a, b))


@dataclass(frozen=True, slots=True)
class Function:
    """Function that an expression may use.

    Attributes:
        value: Function that computes the values for arrays of the arguments.
        partials: For each argument, a function that takes the tuple of all arguments and returns the partial
            derivative with respect to this argument.
        text: Format string of the form in plain text.
        latex: Format string of the LaTeX form.
    """

    value: Callable[..., Any]
    partials: tuple[Callable[[tuple[Expression, ...]], Expression], ...]
    text: str
    latex: str


def _step(x: Expression) -> Expression:
    """Step function of an expression: 0 below zero, ½ at zero, 1 above zero."""
    return 0.5 * (1.0 + sign(x))


_ZERO = Expression(0.0)
_ONE = Expression(1.0)

FUNCTIONS: dict[str, Function] = {
    "add": Function(np.add, (lambda x: _ONE, lambda x: _ONE), "({} + {})", "({} + {})"),
    "mul": Function(np.multiply, (lambda x: x[1], lambda x: x[0]), "{} {}", r"{} \, {}"),
    "pow": Function(
        np.power,
        (lambda x: x[1] * x[0] ** (x[1] - 1.0), lambda x: _ZERO),
        "{}^{}",
        "{{{}}}^{{{}}}",
    ),
    "sign": Function(np.sign, (lambda x: _ZERO,), "sign({})", r"\operatorname{{sgn}}({})"),
    "tanh": Function(np.tanh, (lambda x: _ONE - tanh(x[0]) ** 2.0,), "tanh({})", r"\tanh({})"),
    "abs": Function(np.abs, (lambda x: sign(x[0]),), "|{}|", r"|{}|"),
    "exp": Function(np.exp, (lambda x: exponential(x[0]),), "exp({})", r"\exp({})"),
    "sin": Function(np.sin, (lambda x: cosine(x[0]),), "sin({})", r"\sin({})"),
    "cos": Function(np.cos, (lambda x: -sine(x[0]),), "cos({})", r"\cos({})"),
    "max": Function(
        np.maximum, (lambda x: _step(x[0] - x[1]), lambda x: _step(x[1] - x[0])), "max({}, {})", r"\max({}, {})"
    ),
    "min": Function(
        np.minimum, (lambda x: _step(x[1] - x[0]), lambda x: _step(x[0] - x[1])), "min({}, {})", r"\min({}, {})"
    ),
}
"""Functions of expressions, by name. The exponent of `pow` must not depend on the symbol with respect to which the
derivative is taken."""

LATEX_SYMBOLS = {"q": "q", "dq": r"\dot{q}", "ddq": r"\ddot{q}", "load": r"\tau_{\mathrm{load}}", "state": "z"}


def evaluate(expression: Expression, environment: Mapping[str, Array | float]) -> Array:
    """Values of an expression for given values of its symbols; arrays are broadcast.

    Raises:
        ModelError: A symbol has no value in `environment`.
    """
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str):
        return np.asarray(head)
    if not arguments:
        if head not in environment:
            raise ModelError(
                f"No value is given for the symbol {head!r} of the expression.",
                possible=", ".join(sorted(environment)),
                remedy=did_you_mean(head, environment) or "give a value for it.",
            )
        return np.asarray(environment[head])
    return np.asarray(FUNCTIONS[head].value(*(evaluate(a, environment) for a in arguments)))


def derivative(expression: Expression, by: str) -> Expression:
    """Derivative of an expression with respect to the symbol `by`.

    The derivative of `sign` is zero everywhere. At a kink, the derivative is the mean of the derivatives on both
    sides.
    """
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str) or not arguments:
        return _ONE if head == by else _ZERO
    result = _ZERO
    for argument, partial in zip(arguments, FUNCTIONS[head].partials, strict=True):
        inner = derivative(argument, by)
        if not _is(inner, 0.0):
            result = _sum(result, _product(partial(arguments), inner))
    return result


@lru_cache(maxsize=1024)
def symbols(expression: Expression) -> frozenset[str]:
    """Names of the symbols in an expression."""
    if isinstance(expression.head, str) and not expression.arguments:
        return frozenset({expression.head})
    return frozenset().union(*(symbols(a) for a in expression.arguments))


def functions(expression: Expression) -> frozenset[str]:
    """Names of the functions in an expression, as in `FUNCTIONS`."""
    if not isinstance(expression.head, str) or not expression.arguments:
        return frozenset()
    return frozenset({expression.head}).union(*(functions(a) for a in expression.arguments))


def text(expression: Expression) -> str:
    """Expression in plain text, for instance `tanh(50 dq)` for tanh(dq / 0.02)."""
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str):
        return f"{head:g}"
    return FUNCTIONS[head].text.format(*_operands(expression, text, "({})")) if arguments else head


def latex(expression: Expression) -> str:
    """Expression in LaTeX."""
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str):
        return f"{head:g}"
    if not arguments:
        return LATEX_SYMBOLS.get(head, rf"\mathrm{{{head}}}")
    return FUNCTIONS[head].latex.format(*_operands(expression, latex, r"\left({}\right)"))


def _operands(expression: Expression, write: Callable[[Expression], str], brackets: str) -> list[str]:
    """Arguments of an expression, written as text or LaTeX by the function `write`.

    The base of a power is put in brackets if the exponent would seem to apply only to a part of it.
    """
    written = [write(argument) for argument in expression.arguments]
    base = expression.arguments[0]
    if expression.head == "pow" and (base.head in ("mul", "pow") or (_constant(base) or 0.0) < 0.0):
        written[0] = brackets.format(written[0])
    return written

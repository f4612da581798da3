"""Laws as expressions: value, derivative and printed form from one statement."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armid.errors import ModelError
from armid.model.torque_law_expression import (
    FUNCTIONS,
    cosine,
    derivative,
    evaluate,
    exponential,
    functions,
    latex,
    magnitude,
    maximum,
    minimum,
    number,
    sign,
    sine,
    symbol,
    symbols,
    tanh,
    text,
)

Q, DQ, LOAD = symbol("q"), symbol("dq"), symbol("load")
POINT = {"q": 0.7, "dq": -1.3, "load": 2.1}

STEP = 1e-6
SLOPE = 1e-7
"""A central difference with that step: curvature 1e-12, rounding 1e-10 of values up to a hundred, with room."""

EXPRESSIONS = [
    DQ,
    number(3.0),
    Q + DQ,
    Q - 2.0 * DQ + 1.5,
    Q * DQ * LOAD,
    Q / LOAD,
    1.0 / 3.0 * Q**3.0 - DQ**2.0,
    -DQ,
    tanh(DQ / 0.4),
    magnitude(DQ) * DQ,
    sign(DQ) * LOAD,
    exponential(-((DQ / 0.8) ** 2.0)) * sign(DQ),
    tanh(Q * DQ) ** 2.0 / (1.0 + magnitude(LOAD)),
    LOAD ** (-2.0) + Q**0.5,
    sine(3.0 * Q) + cosine(Q * DQ),
    maximum(-DQ - 0.5, 0.0) - maximum(DQ, Q),
    minimum(maximum(LOAD, Q - 0.1), Q + 0.1) * minimum(DQ, 2.0),
]


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=text)
def test_derivative_is_the_slope(expression):
    for name in POINT:
        up, down = ({**POINT, name: POINT[name] + h} for h in (STEP, -STEP))
        slope = (evaluate(expression, up) - evaluate(expression, down)) / (2.0 * STEP)
        assert evaluate(derivative(expression, name), POINT) == pytest.approx(slope, abs=SLOPE)


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=text)
def test_values_are_those_of_the_text_in_python(expression):
    """The plain form, read as Python, computes the same: it is what a person will retype."""
    plain = re.sub(r"\|([^|]*)\|", r"abs(\1)", text(expression)).replace("^", "**")
    plain = re.sub(r"(?<=[\w)]) (?=[\w(-])", " * ", plain)
    scope = POINT | {"tanh": np.tanh, "sign": np.sign, "exp": np.exp, "abs": abs}
    scope |= {"sin": np.sin, "cos": np.cos, "max": max, "min": min}
    # Numbers are written with six digits.
    assert eval(plain, scope) == pytest.approx(float(evaluate(expression, POINT)), rel=1e-5)


def test_arrays_are_evaluated_at_once():
    dq = np.array([-0.5, 0.0, 0.25])
    assert np.array_equal(evaluate(sign(DQ) + DQ, {"dq": dq}), [-1.5, 0.0, 1.25])


def test_trivial_parts_vanish():
    assert Q * 1.0 == Q == 1.0 * Q == Q + 0.0 == 0.0 + Q == Q**1.0
    assert Q * 0.0 == number(0.0)
    assert Q**0.0 == number(1.0)
    assert 2.0 * (3.0 * Q) * 0.5 == 3.0 * Q
    assert number(4.0) ** 0.5 == number(2.0)
    assert derivative(3.0 * Q, "q") == number(3.0)
    assert derivative(3.0 * Q, "dq") == number(0.0)
    assert derivative(sign(Q), "q") == number(0.0)


def test_symbols():
    assert symbols(tanh(DQ / 0.4) * LOAD + 2.0) == {"dq", "load"}
    assert symbols(number(1.0)) == frozenset()


def test_functions():
    assert functions(maximum(DQ, 0.0) * tanh(Q)) == {"max", "mul", "tanh"}
    assert functions(Q) == functions(number(2.0)) == frozenset()
    assert frozenset().union(*(functions(e) for e in EXPRESSIONS)) == set(FUNCTIONS)


def test_slopes_at_a_kink_are_the_mean_of_both_sides():
    for one, other in ((maximum(DQ, 0.0), 0.5), (minimum(DQ, 0.0), 0.5), (magnitude(DQ), 0.0)):
        assert evaluate(derivative(one, "dq"), {"dq": 0.0}) == other


def test_printed_forms():
    assert str(2.0 * tanh(50.0 * DQ)) == "2 tanh(50 dq)"
    assert text(tanh(DQ / 0.02)) == "tanh(50 dq)"
    assert text(Q - DQ) == "(q + -1 dq)"
    assert text((2.0 * DQ) ** 2.0) == "(2 dq)^2"
    assert latex((Q * DQ) ** 2.0) == r"{\left(q \, \dot{q}\right)}^{2}"
    assert latex(2.0 * tanh(50.0 * DQ)) == r"2 \, \tanh(50 \, \dot{q})"
    assert latex(magnitude(symbol("ddq")) + symbol("width")) == r"(|\ddot{q}| + \mathrm{width})"
    assert latex(DQ**2.0) == r"{\dot{q}}^{2}"
    assert text(maximum(sine(2.0 * Q), 0.0)) == "max(sin(2 q), 0)"
    assert latex(minimum(symbol("state"), cosine(Q))) == r"\min(z, \cos(q))"
    assert latex(sign(LOAD)) == r"\operatorname{sgn}(\tau_{\mathrm{load}})"


def test_a_symbol_without_a_value_is_named():
    with pytest.raises(ModelError, match=r"'load'.*\n.*dq, q"):
        evaluate(Q * LOAD, {"q": 1.0, "dq": 2.0})

"""Equations of the page as MathML, which browsers typeset without a script."""

from __future__ import annotations

from armid.thesis.page.chapter_elements import Equation


def _i(name: str) -> str:
    """MathML of a variable with a given name."""
    return f"<mi>{name}</mi>"


def _b(name: str) -> str:
    """MathML of a vector or matrix with a given name, in bold upright type."""
    return f'<mi mathvariant="normal" style="font-weight:bold">{name}</mi>'


def _o(sign: str) -> str:
    return f"<mo>{sign}</mo>"


def _sub(base: str, index: str) -> str:
    return f"<msub>{base}<mrow>{index}</mrow></msub>"


def _sup(base: str, index: str) -> str:
    return f"<msup>{base}<mrow>{index}</mrow></msup>"


def _frac(above: str, below: str) -> str:
    return f"<mfrac><mrow>{above}</mrow><mrow>{below}</mrow></mfrac>"


def _of(*content: str) -> str:
    """MathML of elements in parentheses that have the height of the line."""
    return f"<mo stretchy='false'>(</mo>{''.join(content)}<mo stretchy='false'>)</mo>"


def _over(base: str, sign: str) -> str:
    """MathML of an element with the accent `sign` above it."""
    return f'<mover accent="true">{base}<mo>{sign}</mo></mover>'


T = '<mi mathvariant="normal">T</mi>'
DQ, DDQ = (f'<mover accent="true">{_b("q")}<mo>{dots}</mo></mover>' for dots in ("˙", "¨"))

SPEED = '<mover accent="true"><mi>q</mi><mo>˙</mo></mover>'

TRANSFORM = Equation(
    f"<msubsup>{_b('H')}<mrow><mi>n</mi><mo>−</mo><mn>1</mn></mrow><mi>n</mi></msubsup>" + _o("=")
    + "".join(
        _sub(_b("H"), f"<mi>{name}</mi>")
        for name in ("Ty,dy", "Tz,dz", "Rz,φ", "Rx,θ", "Rz,ψ")
    ),
    "(3.1)",
)  # fmt: skip

POTENTIAL = Equation(
    _i("U") + _o("=") + _o("−") + "<munder><mo>∑</mo><mi>i</mi></munder>" + _sub(_i("m"), _i("i"))
    + _sup(_sub(_b("g"), "<mn>0</mn>"), T) + _sub(_b("p"), _i("i")),
    "(2.21), corrected",
)  # fmt: skip

REGRESSOR = Equation(
    _sub(_b("y"), "<mi>i</mi><mi>j</mi>") + _o("=") + _frac(_i("d"), "<mi>d</mi><mi>t</mi>")
    + _sup(
        "<mrow><mo>(</mo>"
        + _frac("<mo>∂</mo>" + _sub(_b("β"), _i("i")), "<mo>∂</mo>" + _sub(SPEED, _i("j")))
        + "<mo>)</mo></mrow>", T,
    )
    + _o("−")
    + _sup(
        "<mrow><mo>(</mo>"
        + _frac("<mo>∂</mo>" + _sub(_b("β"), _i("i")), "<mo>∂</mo>" + _sub(_i("q"), _i("j")))
        + "<mo>)</mo></mrow>", T,
    ),
    "(2.37), (3.42) corrected",
)  # fmt: skip

Q, PI_B, Y_B = _b("q"), _sub(_b("π"), _i("b")), _sub(_b("Y"), _i("b"))

DYNAMICS = Equation(
    _b("M") + _of(Q) + DDQ + _o("+") + _b("C") + _of(Q, "<mo>,</mo>", DQ) + DQ + _o("+") + _b("g") + _of(Q) + _o("+")
    + _sub(_b("F"), _i("v")) + DQ + _o("+") + _sub(_b("F"), _i("s")) + "<mi>sgn</mi>" + _of(DQ)
    + _o("=") + _b("τ") + _o("=") + _b("Y") + _b("π") + _o("=") + Y_B + PI_B,
    "(3.3), (3.32)",
)  # fmt: skip

LEAST_SQUARES = Equation(
    _sub(_over(_b("π"), "^"), _i("b")) + _o("=") + "<mi>arg</mi><mspace width='0.2em'/>"
    + f"<munder><mi>min</mi>{PI_B}</munder>"
    + _sup(
        "<mrow><mo>‖</mo>" + _over(_b("τ"), "¯") + _o("−") + _sub(_over(_b("Y"), "¯"), _i("b")) + PI_B
        + "<mo>‖</mo></mrow>", "<mn>2</mn>",
    ),
    "(3.50), corrected",
)  # fmt: skip

INDEX, OMEGA = "<mi>i</mi><mo>,</mo><mi>l</mi>", _sub(_i("ω"), _i("f"))

ANGLE = _of(OMEGA, "<mi>l</mi><mi>t</mi>")

SERIES = Equation(
    _sub(_i("q"), _i("i")) + _of(_i("t")) + _o("=")
    + "<munderover><mo>∑</mo><mrow><mi>l</mi><mo>=</mo><mn>1</mn></mrow><mi>L</mi></munderover>"
    + _frac(_sub(_i("a"), INDEX), OMEGA + _i("l")) + "<mi>sin</mi>" + ANGLE + _o("−")
    + _frac(_sub(_i("b"), INDEX), OMEGA + _i("l")) + "<mi>cos</mi>" + ANGLE,
    "(3.55b)",
)  # fmt: skip

"""Linear combinations of parameters or columns as text and LaTeX, as in `MY_2 + MZ_3 + 0.2045 M_3`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from armid.checked_array import Array

Style = Literal["text", "latex"]

PRINT_AGREEMENT = 1e-11
"""Largest relative rounding error of a printed coefficient. Sums and products of lengths have rounding errors of
1e-16 to 1e-12, and lengths are given with far fewer digits. Coefficients without a short decimal form, such as
cosines, are printed with 11 or 12 digits."""


def linear_combination(row: Array, names: Sequence[str], own: int | None = None, style: Style = "text") -> str:
    """Writes a linear combination of named parameters or columns as a sum.

    The sum begins with the parameter `own`, then come terms with coefficients ±1, then groups of equal coefficients.

    Args:
        row: Coefficients, shape (p,).
        names: Names of the parameters or columns, p of them.
        own: Index of the parameter that is written first, without its coefficient; `None` if there is none.
        style: Style of numbers and products: `text` or `latex`.
    """
    groups: dict[str, list[str]] = {}
    single: list[str] = []
    for k in np.flatnonzero(row).tolist():
        size = _number(abs(row[k]))
        sign = "-" if row[k] < 0.0 else "+"
        if k == own:
            single.insert(0, sign + names[k])
        elif size == "1":
            single.append(sign + names[k])
        else:
            groups.setdefault(sign + size, []).append(names[k])
    parts = single + [_group(signed, members, style) for signed, members in groups.items()]
    if not parts:
        return "0"
    head = parts[0].removeprefix("+")
    return head + "".join(f" {part[0]} {part[1:]}" for part in parts[1:])


def _group(signed: str, members: list[str], style: Style) -> str:
    """Writes parameters with the same coefficient as one term, for instance `+0.42 (M_4 + M_5)`.

    `signed` is the coefficient with its sign.
    """
    text = " + ".join(members)
    if len(members) > 1:
        text = f"({text})"
    if style == "text":
        return f"{signed} {text}"
    mantissa, _, exponent = signed.partition("e")
    power = rf" \cdot 10^{{{int(exponent)}}}" if exponent else ""
    return rf"{mantissa}{power}\,{text}"


def _number(size: float) -> str:
    """Shortest decimal number whose relative difference from a positive number is at most `PRINT_AGREEMENT`."""
    digits = 1
    while abs(float(f"{size:.{digits}g}") - size) > PRINT_AGREEMENT * size:
        digits += 1
    return f"{size:.{digits}g}"

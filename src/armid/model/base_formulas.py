"""Base parameters as the field writes them: text, LaTeX and JSON, made from the regrouping matrix.

ZZR_1 = ZZ_1 + YY_2                             which standard parameters a base parameter stands for
Y_{MZ_3} = Y_{MY_2} + 0.409 (Y_{XX_2} + …)      which columns a removed column is made of
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypedDict

import numpy as np

from armid.model.base_parameters import BaseParameters
from armid.values import Array

__all__ = ["BaseRecord", "ParameterRecord", "base_formulas", "base_record", "column_formulas"]

Style = Literal["text", "latex"]

PRINT_AGREEMENT = 1e-11
"""A printed coefficient may differ by this much, relatively: sums and products of lengths carry rounding of some
1e-16 and less than 1e-12, and lengths are given with far fewer digits. What no short number stands for, such as
a cosine, gets eleven or twelve digits."""

RECORD_DIGITS = 14
"""Digits of coefficients in JSON: a few less than a float holds, so that 0.42 does not read 0.42000000000000004."""


class ParameterRecord(TypedDict):
    """One base parameter in JSON."""

    name: str
    unit: str
    grouping: dict[str, float]
    formula: str


class BaseRecord(TypedDict):
    """Base parameters in JSON."""

    count: int
    zero_columns: list[str]
    removed: list[str]
    dependencies: dict[str, dict[str, float]]
    base: list[ParameterRecord]


def base_formulas(base: BaseParameters, style: Style = "text") -> tuple[str, ...]:
    """Return what each base parameter stands for, for instance `MYR_2 = MY_2 + MZ_3 + 0.2045 M_3`."""
    write = _parameter_latex if style == "latex" else str
    return tuple(
        f"{write(name)} = {_sum(row, own, [write(n) for n in base.standard_names], style)}"
        for name, own, row in zip(base.names, base.kept, base.regrouping, strict=True)
    )


def column_formulas(base: BaseParameters, style: Style = "text") -> tuple[str, ...]:
    """Tell how each removed column depends on the kept ones, for instance `Y_{YY_2} = Y_{ZZ_1} - Y_{XX_2}`."""
    write: Callable[[str], str] = _column_latex if style == "latex" else _column_text
    kept = [write(base.standard_names[k]) for k in base.kept]
    return tuple(
        f"{write(base.standard_names[k])} = {_sum(base.regrouping[:, k], None, kept, style)}" for k in base.removed
    )


def base_record(base: BaseParameters) -> BaseRecord:
    """Base parameters as one JSON object; `dependencies` of a zero column are empty."""
    names = base.standard_names
    kept = [names[k] for k in base.kept]
    return BaseRecord(
        count=base.count,
        zero_columns=[names[k] for k in base.zero_columns],
        removed=[names[k] for k in base.removed],
        dependencies={names[k]: _nonzeros(kept, base.regrouping[:, k]) for k in base.removed},
        base=[
            ParameterRecord(name=name, unit=unit, grouping=_nonzeros(names, row), formula=formula)
            for name, unit, row, formula in zip(
                base.names, base.units, base.regrouping, base_formulas(base), strict=True
            )
        ],
    )


def _nonzeros(names: tuple[str, ...] | list[str], row: Array) -> dict[str, float]:
    return {names[k]: float(f"{row[k]:.{RECORD_DIGITS}g}") for k in np.flatnonzero(row)}


def _sum(row: Array, own: int | None, names: list[str], style: Style) -> str:
    """A linear combination: its own parameter first, then those with coefficient ±1, then equal ones grouped."""
    groups: dict[str, list[str]] = {}
    single: list[str] = []
    for k in np.flatnonzero(row):
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
    """`+0.42 (M_4 + M_5)` from `+0.42` and its members."""
    text = " + ".join(members)
    if len(members) > 1:
        text = f"({text})"
    if style == "text":
        return f"{signed} {text}"
    mantissa, _, exponent = signed.partition("e")
    power = rf" \cdot 10^{{{int(exponent)}}}" if exponent else ""
    return rf"{mantissa}{power}\,{text}"


def _number(size: float) -> str:
    """The shortest decimal that stands for a positive number."""
    digits = 1
    while abs(float(f"{size:.{digits}g}") - size) > PRINT_AGREEMENT * size:
        digits += 1
    return f"{size:.{digits}g}"


def _parameter_latex(name: str) -> str:
    """`ZZR_{1}` for `ZZR_1`."""
    symbol, number = name.rsplit("_", 1)
    return f"{symbol}_{{{number}}}"


def _column_text(name: str) -> str:
    return f"Y_{{{name}}}"


def _column_latex(name: str) -> str:
    return f"Y_{{{_parameter_latex(name)}}}"

"""Formulas of base parameters in the usual notation, as text, LaTeX and JSON, from the regrouping matrix.

ZZR_1 = ZZ_1 + YY_2                             a base parameter by its standard parameters
Y_{MZ_3} = Y_{MY_2} + 0.409 (Y_{XX_2} + …)      a removed column by the kept columns
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict

import numpy as np

from armid.checked_array import Array
from armid.model.base_parameters import BaseParameters
from armid.model.linear_combination_text import Style, linear_combination
from armid.model.parameter_name import ParameterName

RECORD_DIGITS = 14
"""Number of significant digits of coefficients in JSON. A float has a few more digits, with which 0.42 could be
written as 0.42000000000000004."""


class ParameterRecord(TypedDict):
    """JSON object of one base parameter."""

    name: str
    unit: str
    grouping: dict[str, float]
    formula: str


class BaseRecord(TypedDict):
    """JSON object of all base parameters."""

    count: int
    zero_columns: list[str]
    removed: list[str]
    dependencies: dict[str, dict[str, float]]
    base: list[ParameterRecord]


def base_formulas(base: BaseParameters, style: Style = "text") -> tuple[str, ...]:
    """Formula of each base parameter, for instance `MYR_2 = MY_2 + MZ_3 + 0.2045 M_3`."""
    write = _WRITERS[style]
    return tuple(f"{write(name)} = {right}" for name, right in zip(base.names, base_sums(base, style), strict=True))


def base_sums(base: BaseParameters, style: Style = "text") -> tuple[str, ...]:
    """Right-hand side of the formula of each base parameter, for instance `MY_2 + MZ_3 + 0.2045 M_3`."""
    names = [_WRITERS[style](name) for name in base.standard_names]
    return tuple(
        linear_combination(row, names, own, style) for own, row in zip(base.kept, base.regrouping, strict=True)
    )


def column_formulas(base: BaseParameters, style: Style = "text") -> tuple[str, ...]:
    """Formula of each removed column in terms of the kept columns, for instance `Y_{YY_2} = Y_{ZZ_1} - Y_{XX_2}`."""
    names = column_names(base, style)
    sums = column_sums(base, names, style)
    return tuple(f"{names[k]} = {right}" for k, right in zip(base.removed, sums, strict=True))


def column_names(base: BaseParameters, style: Style = "text") -> list[str]:
    """Name of the column of each standard parameter as used in formulas, for instance `Y_{YY_2}`."""
    return [f"Y_{{{_WRITERS[style](name)}}}" for name in base.standard_names]


def column_sums(base: BaseParameters, names: tuple[str, ...] | list[str], style: Style = "text") -> tuple[str, ...]:
    """Right-hand side of the formula of each removed column, for instance `Y_{ZZ_1} - Y_{XX_2}`.

    Args:
        base: Base parameters.
        names: Name of the column of each of the p standard parameters.
        style: Style of the numbers.
    """
    kept = [names[k] for k in base.kept]
    return tuple(linear_combination(base.regrouping[:, k], kept, style=style) for k in base.removed)


def base_record(base: BaseParameters) -> BaseRecord:
    """Base parameters as one JSON object.

    If the column of a parameter is zero, its entry in `dependencies` is empty.
    """
    names = base.standard_names
    kept = [names[k] for k in base.kept]
    return BaseRecord(
        count=base.count,
        zero_columns=[names[k] for k in base.zero_columns],
        removed=[names[k] for k in base.removed],
        dependencies={names[k]: _nonzeros(kept, base.regrouping[:, k]) for k in base.removed},
        base=[
            ParameterRecord(name=name, unit=unit, grouping=grouping, formula=formula)
            for name, unit, grouping, formula in zip(
                base.names, base.units, groupings(base), base_formulas(base), strict=True
            )
        ],
    )


def groupings(base: BaseParameters) -> tuple[dict[str, float], ...]:
    """Coefficients of the standard parameters in each base parameter, for instance `{"ZZ_1": 1.0, "YY_2": 1.0}`."""
    return tuple(_nonzeros(base.standard_names, row) for row in base.regrouping)


def _nonzeros(names: tuple[str, ...] | list[str], row: Array) -> dict[str, float]:
    return {names[k]: float(f"{row[k]:.{RECORD_DIGITS}g}") for k in np.flatnonzero(row)}


def parameter_latex(name: ParameterName) -> str:
    """Name of a parameter in LaTeX: `ZZR_{1}` for `ZZR_1`, `FV_{1}^{(2)}` for `FV_1[2]`."""
    symbol = name.symbol + "R" * name.grouped
    return f"{symbol}_{{{name.number}}}" + ("" if name.recording is None else f"^{{({name.recording})}}")


_WRITERS: dict[Style, Callable[[ParameterName], str]] = {"text": str, "latex": parameter_latex}

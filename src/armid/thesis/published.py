"""Published data of the thesis: tables, a condition number, and formulas that are sums of parameters or columns."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array


@dataclass(frozen=True, slots=True)
class Summand:
    """Summand of a formula of the thesis, for instance 2 (d_3 + d_4)² M_4.

    Attributes:
        name: Name of the parameter, or of the regressor column, that is multiplied.
        factor: Numerical factor.
        lengths: Numbers i of the lengths d_i in the sum of lengths.
        power: Exponent of the sum of lengths; 0 if the summand contains no lengths.
    """

    name: str
    factor: float
    lengths: tuple[int, ...]
    power: int


Sum = tuple[Summand, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Published:
    """Published data of the thesis [Halper2024].

    Attributes:
        condition: Condition number in section 4.1.
        lengths: Lengths d_1 to d_7 of the arm [m]; the thesis gives only the symbols.
        frames: Rows of Table 3.1: d_y, d_z, φ, θ and ψ of the frame of each joint, as text.
        base: Table 4.1: value and relative standard deviation [%] of each base parameter.
        physical: Table 4.2: one row for each link, in the order of equation (3.40), shape (7, 12).
        columns: Lines of equation (A.1): removed column, its printed label, its correct sum and its printed sum. The
            printed sum is `None` if the print cannot be read as a sum.
        groupings: Lines of equation (3.39): base parameter and its sum of standard parameters.
        removed: Names of the parameters in π_r, equation (3.33).
    """

    condition: float
    lengths: Array
    frames: tuple[tuple[str, ...], ...]
    base: Mapping[str, tuple[float, float]]
    physical: Array
    columns: tuple[tuple[str, str, Sum, Sum | None], ...]
    groupings: Mapping[str, Sum]
    removed: tuple[str, ...]


def weight(summand: Summand, lengths: Array) -> float:
    """Factor by which the parameter or column of a summand is multiplied, from the lengths d_1 to d_7 (7,) [m]."""
    return summand.factor * float(sum(lengths[i - 1] for i in summand.lengths)) ** summand.power


def formula(terms: Sum) -> str:
    """Text of the formula that is the sum of given summands; `0` for an empty sum."""
    if not terms:
        return "0"
    text = " ".join(_written(each, first=k == 0) for k, each in enumerate(terms))
    return text


def _written(each: Summand, *, first: bool) -> str:
    sign = "−" if each.factor < 0.0 else "" if first else "+"
    size = "" if abs(each.factor) == 1.0 else f"{abs(each.factor):g} "
    inner = " + ".join(f"d_{i}" for i in each.lengths)
    length = f"({inner})" if len(each.lengths) > 1 else inner
    square = "² " if each.power == 2 else " " if each.power else ""
    return f"{sign}{'' if first else ' '}{size}{length}{square}{each.name}"


@cache
def published() -> Published:
    """Published data of the thesis; the file is read once."""
    table: dict[str, Any] = json.loads((Path(__file__).parent / "published.json").read_text(encoding="utf-8"))
    return Published(
        float(table["condition"]),
        np.array(table["lengths"]),
        tuple(tuple(row) for row in table["frames"]),
        {name: (value, deviation) for name, (value, deviation) in table["base"].items()},
        np.array(table["physical"]),
        tuple(
            (row["name"], row["label"], _sum(row["right"]), None if row["printed"] is None else _sum(row["printed"]))
            for row in table["columns"]
        ),
        {name: _sum(terms) for name, terms in table["groupings"].items()},
        tuple(table["removed"]),
    )


def _sum(terms: Sequence[Sequence[Any]]) -> Sum:
    return tuple(
        Summand(str(name), float(factor), tuple(lengths), int(power)) for name, factor, lengths, power in terms
    )

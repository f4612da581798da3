"""Units in column names, their conversion factors, and the fields of a log format that state units."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import repeat
from typing import Any

from armid.measurement.columns.column_name_parsing import (
    column_unit,
    quantity_of,
    split_time,
    split_unit,
    time_unit,
    words,
)
from armid.measurement.log_format import LogFormat

DEGREE = 0.017453292519943295
"""One degree [rad]."""


CURRENT = re.compile(r"i([_\[]?\d+\]?)?|.*current.*", re.IGNORECASE)
"""Pattern of the names of columns with motor current: i1, i_1, i[0], actual_current_0."""

AMPERE = re.compile(r".+[_\s.-]A")
"""Pattern of a name that ends in the letter A after a separator: the unit ampere, or the name of a joint or arm."""


def hold_current(effort: Sequence[str], q: Sequence[str] = ()) -> bool:
    """Checks whether columns of effort contain motor currents, according to the units or words in their names.

    A final letter A is taken as the unit ampere if it ends the names of all columns of effort after a separator, and
    ends no name of a column of positions.

    Args:
        effort: Columns of effort.
        q: Columns of position.
    """
    if any(_is_current(name) for name in effort):
        return True
    joints = len(effort) > 1 or any(character.isdigit() for name in effort for character in name)
    return joints and all(_ends_in_a(name) for name in effort) and not any(_ends_in_a(name) for name in q)


def _is_current(column: str) -> bool:
    """Checks whether the unit or a word in a column name indicates that the column contains motor currents."""
    unit = column_unit(column)
    if unit is not None:
        return unit[0] == "current"
    return bool(CURRENT.fullmatch(column)) or quantity_of(words(column)) == "current"


def _ends_in_a(column: str) -> bool:
    return column_unit(column) is None and AMPERE.fullmatch(column.strip()) is not None


def unit_fields(chosen: Mapping[str, Sequence[str]], log_format: LogFormat) -> dict[str, Any]:
    """Fields `units` and `time_unit`, if the log format lacks them, from the names of the chosen columns."""
    fields: dict[str, Any] = {}
    if log_format.units is None and any((column_unit(name) or ("",))[0] == "deg" for name in chosen["q"]):
        fields["units"] = "deg"
    if log_format.time_unit is None and len(chosen["time"]) == 1:
        unit = time_unit(chosen["time"][0])
        if unit not in (None, 1.0):
            fields["time_unit"] = unit
    return fields


def overruled(chosen: Mapping[str, Sequence[str]], log_format: LogFormat) -> dict[str, str]:
    """Fields of the log format that contradict the names of the chosen columns, each with a sentence about it."""
    found: dict[str, str] = {}
    units = log_format.units
    given = repeat(units) if units is None or isinstance(units, str) else units
    for name, unit in zip(chosen["q"], given, strict=False):
        kind = (column_unit(name) or ("",))[0]
        if unit is not None and kind in ("rad", "deg") and kind != unit:
            found["units"] = (
                f"The key `units` is used, although the column name {name!r} contains the unit "
                f"{_stated_unit('q', name)}."
            )
            break
    if log_format.time_unit is not None and len(chosen["time"]) == 1:
        (name,) = chosen["time"]
        if time_unit(name) not in (None, log_format.time_unit):
            found["time_unit"] = (
                f"The key `time_unit` is used, although the column name {name!r} contains the unit "
                f"{_stated_unit('time', name)}."
            )
    return found


def factors(columns: Sequence[str], units: str | Sequence[str] | None, *, angles: bool = True) -> dict[str, float]:
    """Factors by which columns must be multiplied to be in SI units, with angles in the unit of the log format.

    Columns with the factor 1 are not in the result.

    Args:
        columns: Columns of positions, velocities, accelerations and efforts.
        units: Unit of angles in the log format. If it is a list with one unit for each joint, this function does not
            convert angles in degrees.
        angles: True if the units of angles in the names of the columns are used.
    """
    found: dict[str, float] = {}
    for name in columns:
        kind, factor = column_unit(name) or ("", 1.0)
        if kind in ("rad", "deg") and not angles:
            continue
        if kind == "rad" and units == "deg":
            factor /= DEGREE
        if kind == "deg" and units in (None, "rad"):
            factor *= DEGREE
        if factor != 1.0:
            found[name] = factor
    return found


def stated_units(chosen: Mapping[str, Sequence[str]], without: Collection[str] = ()) -> str:
    """Text that lists the units in the names of the chosen columns other than SI units; empty if there are none.

    Args:
        chosen: Names of the columns of each quantity.
        without: Fields of the log format (`units`, `time_unit`) that replace the units in the names, so that these
            are not listed.
    """
    texts: list[str] = []
    for quantity, columns in chosen.items():
        field = {"time": "time_unit", "effort": ""}.get(quantity, "units")
        units = dict.fromkeys(
            _stated_unit(quantity, name) for name in columns if field not in without and _is_other(quantity, name)
        )
        texts += [f"{quantity} in {', '.join(units)}"] if units else []
    return ", ".join(texts)


def _stated_unit(quantity: str, column: str) -> str:
    """Unit as it is written in a column name: at the end of the name or, for a unit of angle, anywhere in it."""
    return split_time(column)[1] if quantity == "time" else split_unit(column)[1] or "deg"


def _is_other(quantity: str, column: str) -> bool:
    if quantity == "time":
        return time_unit(column) not in (None, 1.0)
    return (column_unit(column) or ("", 1.0)) not in (("", 1.0), ("rad", 1.0), ("m", 1.0), ("torque", 1.0))

"""Units in column names, their factors, and the fields of a log format that state them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from armid.errors import RecordingError
from armid.measurement.columns.names import column_unit, split_time, split_unit, time_unit
from armid.measurement.log_format import LogFormat

__all__ = ["factors", "is_current", "stated_units", "unit_fields"]

DEGREE = 0.017453292519943295
"""One degree [rad]."""


def is_current(column: str) -> bool:
    """Tests whether a column's unit is that of a current."""
    unit = column_unit(column)
    return unit is not None and unit[0] == "current"


def unit_fields(chosen: Mapping[str, Sequence[str]], reading: LogFormat, path: Path) -> dict[str, Any]:
    """Fields `units` and `time_unit` of a log format that the names of the chosen columns state.

    Raises:
        RecordingError: The reading says something else.
    """
    said: dict[str, Any] = {}
    angles = {unit[0] for name in chosen["q"] if (unit := column_unit(name)) and unit[0] != "m"}
    if angles:
        units = "deg" if "deg" in angles else "rad"
        if isinstance(reading.units, str) and reading.units != units:
            raise _contradiction(path, f"units = {reading.units!r}", chosen["q"][0], units)
        if reading.units is None and units == "deg":
            said["units"] = units
    if len(chosen["time"]) == 1:
        unit = time_unit(chosen["time"][0])
        if unit is not None and reading.time_unit not in (None, unit):
            raise _contradiction(path, f"time_unit = {reading.time_unit:g}", chosen["time"][0], f"{unit:g} s")
        if unit not in (None, 1.0) and reading.time_unit is None:
            said["time_unit"] = unit
    return said


def factors(columns: Sequence[str], units: str | Sequence[str] | None) -> dict[str, float]:
    """Factors that convert columns to SI units and all angles to the unit of the log format.

    Args:
        columns: Columns of positions, velocities, accelerations and efforts.
        units: Unit of the reading's angles; where it is a list, joint by joint, angles stay as they are.
    """
    found: dict[str, float] = {}
    for name in columns:
        kind, factor = column_unit(name) or ("", 1.0)
        if kind == "rad" and units == "deg":
            factor /= DEGREE
        if kind == "deg" and units in (None, "rad"):
            factor *= DEGREE
        if factor != 1.0:
            found[name] = factor
    return found


def stated_units(chosen: Mapping[str, Sequence[str]]) -> str:
    """Text of the units other than SI in the names of the chosen columns; empty where there are none."""
    told: list[str] = []
    for quantity, columns in chosen.items():
        said = dict.fromkeys(_unit_said(quantity, name) for name in columns if _is_other(quantity, name))
        told += [f"{quantity} in {', '.join(said)}"] if said else []
    return ", ".join(told)


def _unit_said(quantity: str, column: str) -> str:
    """Unit as written in a name; one within the name can only be that of an angle."""
    return split_time(column)[1] if quantity == "time" else split_unit(column)[1] or "deg"


def _is_other(quantity: str, column: str) -> bool:
    if quantity == "time":
        return time_unit(column) not in (None, 1.0)
    return (column_unit(column) or ("", 1.0)) not in (("", 1.0), ("rad", 1.0), ("m", 1.0), ("torque", 1.0))


def _contradiction(path: Path, said: str, column: str, unit: str) -> RecordingError:
    return RecordingError(
        f"{path}: {said} was given, and the column {column!r} is in {unit}.",
        remedy="leave it out, or correct the name of the column.",
    )

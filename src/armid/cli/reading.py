"""Options that say how recordings are read, and what they make of a reading."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.errors import ArmidError

if TYPE_CHECKING:
    from armid.measurement.log_format import LogFormat

__all__ = ["Columns", "Data", "Rate", "TimeUnit", "TorqueSign", "Units", "changed_reading", "columns_given", "given"]

Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--columns",
        metavar="QUANTITY=NAME",
        help="Columns of time, q, dq, ddq or effort: a name, a pattern as q=pos{}, or names with commas between; "
        "repeatable.",
    ),
]
Data = Annotated[
    Path | None, typer.Option("--data", metavar="FOLDER", help="Where the recordings are, if they were moved.")
]
Rate = Annotated[float | None, typer.Option(help="Samples a second, Hz, where there is no clock.")]
TimeUnit = Annotated[float | None, typer.Option(help="Length of a unit of the clock, s, as 0.001.")]
TorqueSign = Annotated[int | None, typer.Option(help="-1 where the torque is measured against the URDF.")]
Units = Annotated[
    str | None, typer.Option(metavar="rad|deg", help="Unit of recorded angles; what columns say, else rad.")
]


def given(
    columns: list[str] | None,
    rate: float | None = None,
    torque_sign: int | None = None,
    units: str | None = None,
    time_unit: float | None = None,
    period: float | str | None = None,
) -> dict[str, Any]:
    """Return what the command line says of a reading, without what it leaves open."""
    keys = {"rate": rate, "torque_sign": torque_sign, "units": units, "time_unit": time_unit, "period": period}
    said: dict[str, Any] = {key: value for key, value in keys.items() if value is not None}
    return said | ({"columns": columns_given(columns)} if columns else {})


def changed_reading(
    reading: LogFormat, rate: float | None, torque_sign: int | None, columns: list[str] | None
) -> dict[str, Any]:
    """Return what the command line says of reading beyond a run's; columns that it does not name stay the run's."""
    said = given(columns, rate, torque_sign)
    return said | ({"columns": {**reading.columns, **said["columns"]}} if columns else {})


def columns_given(given: list[str]) -> dict[str, str | list[str]]:
    """Names by quantity, of `QUANTITY=NAME,…`; several of one quantity are one list.

    Raises:
        ArmidError: No quantity.
    """
    found: dict[str, list[str]] = {}
    for each in given:
        quantity, equals, names = each.partition("=")
        if not equals:
            raise ArmidError(f"--columns {each}: no quantity.", remedy="write as --columns 'time=Zeit [ms]'.")
        found.setdefault(quantity.strip(), []).extend(name.strip() for name in names.split(","))
    return {quantity: names[0] if len(names) == 1 else names for quantity, names in found.items()}

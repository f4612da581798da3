"""Options for the log format of recordings, and their conversion to arguments of `LogFormat`."""

from __future__ import annotations

import csv
import dataclasses
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.value_completion import among
from armid.errors import ArmidError, did_you_mean

if TYPE_CHECKING:
    from armid.measurement.log_format import LogFormat

PRESET_NAMES = ("ur-rtde", "kuka-fri", "libfranka")
"""Names of the presets for log formats (`armid.measurement.log_format.PRESETS`), which help texts do not import."""

Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--columns",
        metavar="QUANTITY=NAME",
        help="Columns of time, q, dq, ddq, effort or command: a name, a pattern such as q=pos{} with {} for the "
        "numbers 1, 2, …, or names separated by commas; names that contain commas are put in double quotes: "
        'q="pos,1","pos,2"; repeatable.',
    ),
]
Data = Annotated[
    Path | None, typer.Option("--data", metavar="FOLDER", help="Folder of the recordings, if they were moved.")
]
Rate = Annotated[float | None, typer.Option(help="Sampling rate of a recording without a clock, Hz.")]
Period = Annotated[
    str | None, typer.Option(metavar="S|none", help="Period of the motion, s; by default found from the positions.")
]
Preset = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        help="Columns of a well-known log: ur-rtde, kuka-fri, libfranka.",
        autocompletion=among(PRESET_NAMES),
    ),
]
Edges = Annotated[
    str | None,
    typer.Option(
        metavar="drop|pad|periodic", help="Treatment of the ends of a recording; that of the run by default."
    ),
]
TimeUnit = Annotated[float | None, typer.Option(help="Unit of the clock in seconds, for instance 0.001.")]
TorqueSign = Annotated[
    int | None, typer.Option(help="-1 if the sign of the measured torque is opposite to the joint axes of the URDF.")
]
Units = Annotated[
    str | None,
    typer.Option(
        metavar="rad|deg", help="Unit of angles; by default the unit in the names of the columns, or else rad."
    ),
]
ReadingLines = Annotated[
    list[str] | None,
    typer.Option(
        "--reading",
        metavar="KEY = VALUE",
        help="Line of a study's table `recording` for these recordings, such as 'drive_gain = [2.1, 1.9]'; "
        'the value "none" removes the value of the run; repeatable.',
    ),
]


def given(
    columns: list[str] | None,
    rate: float | None = None,
    torque_sign: int | None = None,
    units: str | None = None,
    time_unit: float | None = None,
    period: str | None = None,
    preset: str | None = None,
) -> dict[str, Any]:
    """Arguments of `LogFormat` that are given on the command line; arguments that are not given are left out.

    Raises:
        ArmidError: The value of an option has the wrong form.
    """
    keys: dict[str, Any] = {"rate": rate, "torque_sign": torque_sign, "units": units, "time_unit": time_unit}
    keys |= {"period": _period(period), "preset": preset}
    arguments: dict[str, Any] = {key: value for key, value in keys.items() if value is not None}
    return arguments | ({"columns": columns_given(columns)} if columns else {})


def _period(text: str | None) -> float | str | None:
    """Value of the option --period: a time [s] or `none`; `None` if the option is not given.

    Raises:
        ArmidError: The text is neither a number nor `none`.
    """
    if text is None or text == "none":
        return text
    try:
        return float(text)
    except ValueError:
        raise ArmidError(
            f"--period {text} is neither a time nor `none`.",
            possible="a number [s], none",
            remedy="write for instance --period 8, or --period none if the motion does not repeat.",
        ) from None


def changed_reading(
    reading: LogFormat,
    rate: float | None,
    torque_sign: int | None,
    columns: list[str] | None,
    lines: list[str] | None = None,
    period: str | None = None,
    preset: str | None = None,
) -> dict[str, Any]:
    """Arguments of `LogFormat` that the command line changes; columns that are not given stay those of the run.

    Raises:
        ArmidError: A line is not a key of a log format with a value.
    """
    arguments = {**_keys_of_lines(lines or []), **given(columns, rate, torque_sign, period=period, preset=preset)}
    if "columns" in arguments:
        arguments["columns"] = {**reading.columns, **arguments["columns"]}
    return arguments


def _keys_of_lines(lines: list[str]) -> dict[str, Any]:
    """Keys and values of the lines that are given with `--reading`.

    Raises:
        ArmidError: A line is not TOML, or its key does not belong to a log format.
    """
    from armid.measurement.log_format import LogFormat

    possible = [field.name for field in dataclasses.fields(LogFormat)]
    keys: dict[str, Any] = {}
    for line in lines:
        try:
            keys |= tomllib.loads(line)
        except (ValueError, RecursionError) as error:
            raise ArmidError(
                f"--reading {line} is not a line of a study: {error}.",
                remedy="write for instance --reading 'drive_gain = [2.1, 1.9]' or --reading 'units = \"deg\"'.",
            ) from error
    if keys.get("drive_gain") == "none":
        keys.setdefault("drive_gain_deviation", "none")
    for key in keys:
        if key not in possible:
            raise ArmidError(
                f"--reading has no key {key!r}.", possible=", ".join(possible), remedy=did_you_mean(key, possible)
            )
    return {key: None if value == "none" and key != "period" else value for key, value in keys.items()}


def columns_given(given: list[str]) -> dict[str, str | list[str]]:
    """Column names by quantity, from texts of the form `QUANTITY=NAME,…`; several names become a list.

    Raises:
        ArmidError: A text does not begin with a quantity, or a quotation mark is not closed.
    """
    by_quantity: dict[str, list[str]] = {}
    for each in given:
        quantity, equals, names = each.partition("=")
        if not equals:
            raise ArmidError(
                f"--columns {each} does not begin with a quantity.",
                remedy="write for instance --columns 'time=Zeit [ms]'.",
            )
        try:
            (split,) = csv.reader([names], skipinitialspace=True, strict=True)
        except csv.Error as error:
            raise ArmidError(
                f"--columns {each}: the names cannot be separated ({error}).",
                remedy='put a name with a comma in double quotes, as --columns \'q="pos,1","pos,2"\'.',
            ) from error
        by_quantity.setdefault(quantity.strip(), []).extend(name.strip() for name in split or [""])
    return {quantity: names[0] if len(names) == 1 else names for quantity, names in by_quantity.items()}

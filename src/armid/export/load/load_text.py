"""Text of load data: numbers with units and intervals, their notation, and the comment at the head of each file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.export.load.flange_load import FlangeLoad
from armid.export.types import plain_number

MARK = "Load data written by armid payload"
"""First words of each file, by which armid recognises its own files."""

SINGLE_DIGITS = 9
"""Number of significant digits that determine a single-precision number."""


@dataclass(frozen=True, eq=False, slots=True)
class LoadNumber:
    """Number of the load data of a controller, in its unit.

    Attributes:
        name: Name that the vendor gives to the number.
        value: Value.
        unit: Unit; empty if the number has none.
        interval: 95 % interval, shape (2,); NaN if the recording does not determine it.
        in_file: False if the controller has no place for the number, which is then not written.
    """

    name: str
    value: float
    unit: str
    interval: Array
    in_file: bool = True


@dataclass(frozen=True, eq=False, slots=True)
class LoadText:
    """Files with the load data of a controller, before they are stored.

    Attributes:
        files: Content of each file; the keys are the names of the files.
        numbers: Numbers of the files with their intervals.
        findings: Findings about numbers that the controller does not accept, and about facts that are not confirmed.
    """

    files: Mapping[str, str]
    numbers: tuple[LoadNumber, ...]
    findings: tuple[Finding, ...] = ()


def number_text(value: float, digits: int | None = None) -> str:
    """Number without exponent, from which the same number can be read.

    Args:
        value: The number.
        digits: Number of significant digits; `None` for as many as double precision needs.
    """
    rounded = value if digits is None else float(f"{value:.{digits}g}")
    return plain_number(rounded)


def single(value: float) -> str:
    """Text of a number that a controller stores in single precision."""
    return number_text(value, SINGLE_DIGITS)


def three(names: Sequence[str], values: Array, unit: str, intervals: Array, factor: float = 1.0) -> list[LoadNumber]:
    """Load numbers with a common unit, from values and intervals in SI units.

    Args:
        names: Names of the m numbers.
        values: Values in SI units, shape (m,).
        unit: Unit after multiplication.
        intervals: 95 % intervals in SI units, shape (m, 2).
        factor: Factor from SI units to the unit.
    """
    return [
        LoadNumber(name, float(value) * factor, unit, np.asarray(ends) * factor)
        for name, value, ends in zip(names, values, intervals, strict=True)
    ]


TENSOR = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
"""Elements of an inertia matrix, in the order in which controllers usually take them."""


def tensor(load: FlangeLoad, names: str = "I{}") -> list[LoadNumber]:
    """Six elements of the inertia about the centre of mass in the axes of the flange [kg·m²], as load numbers."""
    at = tuple(np.array(list(TENSOR.values())).T)
    return three([names.format(pair) for pair in TENSOR], load.inertia[at], "kg·m²", load.inertia_intervals[at])


def mass_number(load: FlangeLoad, name: str) -> LoadNumber:
    """Mass of a load [kg], as a load number with the vendor's name of the mass."""
    return LoadNumber(name, load.mass, "kg", load.mass_interval)


def heading(load: FlangeLoad, numbers: Sequence[LoadNumber], controller: str, *notes: str) -> list[str]:
    """Lines of the comment at the head of a file.

    Args:
        load: The load.
        numbers: Numbers of the file.
        controller: Name of the vendor.
        notes: Further lines.
    """
    lines = [
        f"{MARK} for controllers of {controller}.",
        "This form was not tried on a robot. Compare the numbers with those that the controller shows, and move the",
        "arm slowly at first.",
        f"Arm {load.robot}; the load is what was added to the arm since the run {load.run}.",
        f"Flange: {load.flange}.",
        *notes,
    ]
    if load.unclear:
        lines.append(f"The recording does not determine all parameters: {', '.join(load.unclear)}.")
    return [*lines, "Numbers with their 95 % intervals:", *(f"  {_with_interval(number)}" for number in numbers)]


def _with_interval(number: LoadNumber) -> str:
    ends = " to ".join(f"{end:.6g}" for end in number.interval)
    known = bool(np.isfinite(number.interval).all())
    unit = f" {number.unit}" if number.unit else ""
    absent = "" if number.in_file else "; the controller has no entry for this number"
    return (
        f"{number.name} = {number.value:.6g}{unit}, {f'interval {ends}{unit}' if known else 'not determined'}{absent}"
    )


def commented(lines: Sequence[str], sign: str) -> list[str]:
    """Lines as comments; line ends within names are removed."""
    return [f"{sign} {' '.join(line.split()) if not line.startswith(' ') else line}".rstrip() for line in lines]

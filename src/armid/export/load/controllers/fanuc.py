"""Fanuc: numbers for the screen MOTION/PAYLOAD SET.

The screen takes the payload [kg], the payload centre [cm] from the faceplate, and the payload inertia about the
centre of mass in the axes of the faceplate [kgf·cm·s²]; it has no products of inertia. System variables for the load
exist, but their units could not be confirmed, so they are not written.
"""

from __future__ import annotations

from dataclasses import replace

from armid.errors import Finding
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, single, tensor, three

CENTIMETRES = 100.0

STANDARD_GRAVITY = 9.80665
"""Acceleration that defines the kilogram-force [m/s²]."""

INERTIA_UNIT = 100.0 / STANDARD_GRAVITY
"""Inertia of 1 kg·m² in kgf·cm·s²: 1 kg·m² = 1 N·m·s²."""

LARGE = 0.1
"""Ratio of the largest product of inertia to the largest moment above which a finding reports omitted products."""


def write(load: FlangeLoad) -> LoadText:
    """Makes a text with the numbers to enter on the screen MOTION/PAYLOAD SET."""
    centre = three([f"PAYLOAD CENTER {axis}" for axis in "XYZ"], load.com, "cm", load.com_intervals, CENTIMETRES)
    six = tensor(load)
    inertia = three(
        [f"PAYLOAD INERTIA {axis}" for axis in "XYZ"],
        load.inertia.diagonal(),
        "kgf·cm·s²",
        load.inertia_intervals.diagonal().T,
        INERTIA_UNIT,
    )
    products = [replace(each, in_file=False) for each in six[3:]]
    numbers = [mass_number(load, "PAYLOAD"), *centre, *inertia, *products]
    note = "For the screen MOTION/PAYLOAD SET (MENU, SYSTEM, Motion). Axes of the faceplate: Z points out of it."
    lines = commented(heading(load, numbers, "Fanuc", note), "!")
    lines += [f"{each.name} [{_ascii(each.unit)}]: {single(each.value)}" for each in numbers if each.in_file]
    return LoadText({"load_fanuc.txt": "\n".join(lines) + "\n"}, tuple(numbers), _left_out(load))


def _ascii(unit: str) -> str:
    """Unit as the screen shows it."""
    return unit.replace("kgf·cm·s²", "kgfcms^2")


def _left_out(load: FlangeLoad) -> tuple[Finding, ...]:
    """Finding about large products of inertia, which are not written."""
    products = abs(load.inertia - load.inertia.diagonal() * [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    share = float(products.max() / max(load.inertia.diagonal().max(), 1e-300))
    if share <= LARGE:
        return ()
    evidence = (
        f"The largest product of inertia is {share:.0%} of the largest moment, but controllers of Fanuc take no "
        "products of inertia, so the file does not have them."
    )
    remedy = "mount the load so that its principal axes are parallel to those of the faceplate, if that is possible."
    return (Finding("products-not-written", "warning", "fanuc", evidence, remedy),)

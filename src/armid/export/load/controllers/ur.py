"""Universal Robots: URScript with `set_target_payload`.

The arguments are the mass [kg], the centre of mass from the tool mount [m], and the inertia
[Ixx, Iyy, Izz, Ixy, Ixz, Iyz] about the centre of mass in the axes of the tool flange [kg·m²].
"""

from __future__ import annotations

from armid.errors import OutputError
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, number_text, tensor, three

LARGEST = 133.0
"""Largest absolute value of an element of the inertia matrix [kg·m²]. According to the vendor's script manual, the
controller raises an exception for larger values."""


def write(load: FlangeLoad) -> LoadText:
    """Makes a URScript program that sets the payload."""
    centre = three(["CoGx", "CoGy", "CoGz"], load.com, "m", load.com_intervals)
    inertia = tensor(load)
    largest = max(inertia, key=lambda each: abs(each.value))
    if abs(largest.value) > LARGEST:
        raise OutputError(
            f"{largest.name} of the load is {largest.value:.4g} kg·m²; controllers of Universal Robots accept at "
            f"most {LARGEST:g} kg·m².",
            remedy="check the units of the recording and of the description.",
        )
    numbers = [mass_number(load, "m"), *centre, *inertia]
    mass, *rest = (number_text(number.value) for number in numbers)
    cog, six = ", ".join(rest[:3]), ", ".join(rest[3:])
    note = (
        "Setting the payload zeroes the force sensor. Controllers without set_target_payload: the line set_payload."
    )
    lines = commented(heading(load, numbers, "Universal Robots", note), "#")
    lines += ["def armid_load():", f"  set_target_payload({mass}, [{cog}], [{six}])"]
    lines += [f"  # set_payload({mass}, [{cog}])", "end"]
    return LoadText({"load_ur.script": "\n".join(lines) + "\n"}, tuple(numbers))

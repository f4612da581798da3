"""Doosan Robotics: numbers of the structure `CONFIG_TOOL`, as YAML for the ROS 2 service `tool/config_create_tool`.

The vendor documents the mass [kg] and the centre of mass [m] of a tool, but neither axes, order nor unit of its six
inertias; they are written as zeros. Examples of the service give centres in millimetres, so the unit of the service
could not be confirmed; if it is millimetres, a centre in metres is almost at the flange.
"""

from __future__ import annotations

from dataclasses import replace

from armid.errors import Finding
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, single, tensor, three


def write(load: FlangeLoad) -> LoadText:
    """Makes the request of the service `tool/config_create_tool` with the load, as YAML."""
    centre = three(["cog x", "cog y", "cog z"], load.com, "m", load.com_intervals)
    numbers = [mass_number(load, "weight"), *centre, *(replace(each, in_file=False) for each in tensor(load))]
    weight, *cog = (single(number.value) for number in numbers if number.in_file)
    notes = (
        "UNIT NOT CONFIRMED: the vendor documents the centre in m, but examples of the service use mm. Look at the",
        "tool on the pendant before the first motion; multiply the centre by 1000 if it shows a tool at the flange.",
        "Order, axes and unit of the inertia are not documented; it is written as zeros.",
    )
    lines = commented(heading(load, numbers, "Doosan Robotics", *notes), "#")
    lines += ["name: armid_load", f"weight: {weight}", f"cog: [{', '.join(cog)}]"]
    lines += ["inertia: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"]
    findings = (
        Finding(
            "unit-not-confirmed",
            "warning",
            "doosan",
            "The vendor documents the centre of mass in m, as it is written; examples of the ROS service give mm.",
            "look at the tool on the pendant before the first motion.",
        ),
        Finding(
            "inertia-not-written",
            "info",
            "doosan",
            "Order, axes and unit of the inertia are not documented, so it is written as zeros.",
        ),
    )
    return LoadText({"load_doosan.yaml": "\n".join(lines) + "\n"}, tuple(numbers), findings)

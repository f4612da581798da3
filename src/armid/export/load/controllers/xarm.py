"""UFACTORY: Python with `set_tcp_load` of the xArm SDK.

The arguments are the weight [kg] and the centre of gravity [mm] from the tool mount; there is no inertia. The SDK
sends them in single precision.
"""

from __future__ import annotations

from dataclasses import replace

from armid.errors import Finding
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, single, tensor, three

MILLIMETRES = 1e3


def write(load: FlangeLoad) -> LoadText:
    """Makes a Python module with a function that sets the load."""
    centre = three(["x", "y", "z"], load.com, "mm", load.com_intervals, MILLIMETRES)
    numbers = [mass_number(load, "weight"), *centre, *(replace(each, in_file=False) for each in tensor(load))]
    weight, *cog = (single(number.value) for number in numbers if number.in_file)
    lines = commented(heading(load, numbers, "UFACTORY (xArm)", "The SDK forgets the load at a restart."), "#")
    lines += ["", "", "def set_load(arm):", '    """Set the load; `arm` is a connected XArmAPI."""']
    lines += [f"    return arm.set_tcp_load({weight}, [{', '.join(cog)}])"]
    finding = Finding(
        "inertia-not-written", "info", "xarm", "set_tcp_load takes no inertia, so the file has only mass and centre."
    )
    return LoadText({"load_xarm.py": "\n".join(lines) + "\n"}, tuple(numbers), (finding,))

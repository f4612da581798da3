"""KUKA: load data `LOAD_DATA` in KRL.

M is the mass [kg]; CM has the centre of mass X, Y, Z [mm] in the flange frame and the orientation A, B, C [degrees]
of the principal axes of inertia, by rotations about Z, then the new Y, then the new X; J has the principal moments
X, Y, Z about the centre of mass [kg·m²].
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, single, three
from armid.export.load.principal_axes import numbers_of_rotation
from armid.export.types import rpy_of

MILLIMETRES = 1e3


def write(load: FlangeLoad) -> LoadText:
    """Makes the line for `LOAD_DATA` in the file `$config.dat`."""
    axes, moments, spread = load.principal_axes()
    angles, ends = numbers_of_rotation(_abc, axes.axes, spread)
    numbers = [
        mass_number(load, "M"),
        *three(["X", "Y", "Z"], load.com, "mm", load.com_intervals, MILLIMETRES),
        *three(["A", "B", "C"], angles, "deg", ends),
        *three(["JX", "JY", "JZ"], axes.moments, "kg·m²", moments),
    ]
    m, x, y, z, a, b, c, jx, jy, jz = (single(number.value) for number in numbers)
    note = "Replace the index 1 by the number of the tool. M = -1 is the load for which the controller has defaults."
    lines = commented(heading(load, numbers, "KUKA", note), ";")
    lines.append(f"LOAD_DATA[1]={{M {m},CM {{X {x},Y {y},Z {z},A {a},B {b},C {c}}},J {{X {jx},Y {jy},Z {jz}}}}}")
    return LoadText({"load_kuka.dat": "\n".join(lines) + "\n"}, tuple(numbers))


def _abc(rotation: Array) -> Array:
    """Angles A, B, C [degrees] with Rz(A) Ry(B) Rx(C) = R."""
    roll, pitch, yaw = rpy_of(rotation)
    return np.rad2deg([yaw, pitch, roll])

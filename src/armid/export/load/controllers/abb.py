"""ABB: `loaddata` in RAPID.

Its components are the mass [kg], the centre of mass [mm], the orientation of the principal axes of inertia as the
quaternion q1 … q4 (scalar first), and the principal moments about the centre of mass [kg·m²]. As a component of
`tooldata`, loads are in the wrist frame; as an argument of `GripLoad`, they are in the frame of the tool.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, single, three
from armid.export.load.principal_axes import numbers_of_rotation

MILLIMETRES = 1e3


def write(load: FlangeLoad) -> LoadText:
    """Makes a RAPID module with the data `armid_load`."""
    axes, moments, spread = load.principal_axes()
    quaternion, ends = numbers_of_rotation(quaternion_of, axes.axes, spread)
    numbers = [
        mass_number(load, "mass"),
        *three(["cog.x", "cog.y", "cog.z"], load.com, "mm", load.com_intervals, MILLIMETRES),
        *three(["aom.q1", "aom.q2", "aom.q3", "aom.q4"], quaternion, "", ends),
        *three(["ix", "iy", "iz"], axes.moments, "kg·m²", moments),
    ]
    mass, *rest = (single(number.value) for number in numbers)
    cog, aom, moment = (",".join(part) for part in (rest[:3], rest[3:7], rest[7:]))
    notes = (
        "In the wrist frame (tool0): for the component tload of tooldata. GripLoad takes loads in the frame of the",
        "active tool: then tool0 must be active, or the pose of the tool must be given as the flange.",
    )
    lines = commented(heading(load, numbers, "ABB", *notes), "!")
    lines += [
        "MODULE armid_load_data",
        f"  PERS loaddata armid_load:=[{mass},[{cog}],[{aom}],{moment}];",
        "ENDMODULE",
    ]
    return LoadText({"load_abb.mod": "\n".join(lines) + "\n"}, tuple(numbers))


def quaternion_of(rotation: Array) -> Array:
    """Unit quaternion with the scalar first and not negative, shape (4,), of a rotation matrix (3, 3)."""
    R = rotation
    # The eigenvector of this matrix is accurate for all angles, unlike formulas with one square root.
    matrix = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    q = np.linalg.eigh(matrix)[1][:, -1]
    return -q if q[0] < 0.0 else q

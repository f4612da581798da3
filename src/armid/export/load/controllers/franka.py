"""Franka Robotics: end effector for Desk, and the arguments of `Robot::setLoad` of libfranka.

Both take the mass [kg], the centre of mass from the flange [m], and the inertia about the centre of mass in the axes
of the flange [kg·m²] as nine numbers by columns.
"""

from __future__ import annotations

import json

from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadText, commented, heading, mass_number, number_text, tensor, three

IDENTITY = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""Pose of the end effector in the flange frame (4 × 4, by columns), which a load does not determine."""


def write(load: FlangeLoad) -> LoadText:
    """Makes the file `endeffector-config.json` of an end effector archive, and a C++ header with `setLoad`."""
    numbers = [
        mass_number(load, "m_load"),
        *three(["F_x_Cload x", "F_x_Cload y", "F_x_Cload z"], load.com, "m", load.com_intervals),
        *tensor(load),
    ]
    columns = load.inertia.T.reshape(-1).tolist()
    end_effector = {
        "id": "armid-load",
        "name": "Load written by armid",
        "color": "#808080",
        "mass": load.mass,
        "centerOfMass": load.com.tolist(),
        "transformation": IDENTITY,
        "inertia": columns,
    }
    note = "Give the load to Desk (endeffector-config.json) or to setLoad, not to both: the controller adds them."
    lines = commented(heading(load, numbers, "Franka Robotics (libfranka)", note), "//")
    lines += ["#pragma once", "", "#include <array>", ""]
    lines += [f"constexpr double armid_load_mass = {number_text(load.mass)};"]
    lines += [f"constexpr std::array<double, 3> armid_F_x_Cload{{{_listed(load.com.tolist())}}};"]
    lines += [f"constexpr std::array<double, 9> armid_load_inertia{{{_listed(columns)}}};", ""]
    lines += ["// robot.setLoad(armid_load_mass, armid_F_x_Cload, armid_load_inertia);"]
    files = {
        "franka/endeffector-config.json": json.dumps(end_effector, indent=2) + "\n",
        "franka/armid_set_load.hpp": "\n".join(lines) + "\n",
    }
    return LoadText(files, tuple(numbers))


def _listed(values: list[float]) -> str:
    return ", ".join(number_text(value) for value in values)

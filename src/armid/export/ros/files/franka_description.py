"""Files of the package `franka_description`: `inertials.yaml` and `dynamics.yaml` of a robot."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any, cast

from armid.export.ros.package_yaml import (
    TENSOR,
    find_prefix,
    friction_of,
    link_numbers,
    numbers_of_links,
    read_yaml,
    require_axes,
    with_values,
    yaml_lines,
)
from armid.export.types import plain_number

NEEDS_DESCRIPTION: bool = True

PACKAGE = "franka_description"
LINKS = tuple(f"link{i}" for i in range(8))
INERTIALS, DYNAMICS = "inertials.yaml", "dynamics.yaml"

RIGHT = math.pi / 2.0
AXES = {f"joint{i}": (turn * RIGHT, 0.0, 0.0) for i, turn in enumerate((0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0), 1)}
"""Roll, pitch and yaw of each joint [rad], the same for all arms of the package."""

OTHER_DYNAMICS = {"D": "1", "K": "7000", "mu_coulomb": "0", "mu_viscous": "16"}
"""Values that the macro of the package also needs, and that are not identified; from `robots/fr3/dynamics.yaml`."""


def write(urdf: bytes, about: str) -> dict[str, str]:
    """Makes `inertials.yaml` and `dynamics.yaml`; the base, link0, has the inertia of the description."""
    root = ET.fromstring(urdf)
    prefix = _prefix(root)
    require_axes(root, {prefix + joint: rpy for joint, rpy in AXES.items()}, PACKAGE)
    inertials: dict[str, Any] = {}
    base = link_numbers(root, prefix + LINKS[0])
    moving = numbers_of_links(root, [prefix + link for link in LINKS[1:]], PACKAGE)
    for link, numbers in zip(LINKS, (base, *moving), strict=True):
        if numbers is None:  # the base does not move, so the macro may have its own inertia
            continue
        inertials[link] = {
            "origin": {"xyz": " ".join(plain_number(x) for x in numbers.com), "rpy": "0 0 0"},
            "mass": numbers.mass,
            "inertia": {pair: float(numbers.inertia[i, j]) for pair, (i, j) in TENSOR.items()},
        }
    dynamics = {
        f"joint{i}": {"dynamic": friction_of(root, f"{prefix}joint{i}") | OTHER_DYNAMICS} for i in range(1, 8)
    }
    note = "# D, K, mu_coulomb and mu_viscous are not identified; these are values of the package for fr3."
    return {
        INERTIALS: "\n".join([f"# {about}", *yaml_lines(inertials)]) + "\n",
        DYNAMICS: "\n".join([f"# {about}", note, *yaml_lines(dynamics)]) + "\n",
    }


def expanded(files: Mapping[str, str], urdf: bytes) -> bytes:
    """Makes the URDF in which inertias and friction are replaced by the values of the files."""
    prefix = _prefix(ET.fromstring(urdf))
    inertials = cast("dict[str, Any]", read_yaml(files[INERTIALS]))
    dynamics = cast("dict[str, Any]", read_yaml(files[DYNAMICS]))
    links = {
        prefix + link: (each["mass"], each["origin"]["xyz"], each["origin"]["rpy"], each["inertia"])
        for link, each in inertials.items()
    }
    joints = {
        prefix + joint: {key: each["dynamic"][key] for key in ("damping", "friction")}
        for joint, each in dynamics.items()
    }
    return with_values(urdf, links, joints)


def _prefix(root: ET.Element) -> str:
    return find_prefix(root, LINKS, PACKAGE)

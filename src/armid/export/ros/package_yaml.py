"""Inertias and joint friction of a URDF, for YAML files of description packages."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import OutputError
from armid.export.types import plain_number
from armid.maths.rotations import rpy_rotation

MOST_TURNED = 0.05
"""Largest angle [rad] between the axes of a joint and those of the package; those of a calibrated arm are nearer."""

TENSOR = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}


@dataclass(frozen=True, eq=False, slots=True)
class LinkNumbers:
    """Mass, centre of mass and inertia of a link, read from a URDF.

    Attributes:
        mass: Mass [kg].
        com: Centre of mass in the frame of the link, shape (3,) [m].
        inertia: Inertia about the centre of mass in the axes of the link, shape (3, 3) [kg·m²].
    """

    mass: float
    com: Array
    inertia: Array


def find_prefix(root: ET.Element, names: Sequence[str], package: str) -> str:
    """Prefix before the names of the links of a package in a URDF.

    Args:
        root: Root of the URDF.
        names: Names of the links without prefix.
        package: Name of the package.

    Raises:
        OutputError: The URDF has no such links, or several arms.
    """
    links = [link.get("name", "") for link in root.findall("link")]
    prefixes = [link.removesuffix(names[0]) for link in links if link.endswith(names[0])]
    found = [prefix for prefix in prefixes if all(prefix + name in links for name in names)]
    if len(found) == 1:
        return found[0]
    raise OutputError(
        f"The description has {'several arms' if found else 'no arm'} with the links of the package {package}: "
        f"{', '.join(names)}.",
        possible="the formats urdf and xacro",
        remedy=f"identify with the URDF or xacro of one arm of {package}, or choose another format with --to.",
    )


def require_axes(root: ET.Element, axes: Mapping[str, tuple[float, float, float]], package: str) -> None:
    """Requires that the axes of joints are those of a package, since its numbers are in the frames of its links.

    Args:
        root: Root of the URDF.
        axes: Roll, pitch and yaw [rad] of the frame of each joint in the frame of its parent link, by the joint's
            name. Every joint of a package turns about z.
        package: Name of the package.

    Raises:
        OutputError: A joint is missing, does not turn about z, or has other axes.
    """
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    others = [name for name, rpy in axes.items() if name not in joints or not _has_axes(joints[name], rpy)]
    if others:
        raise OutputError(
            f"The links have the names of the package {package}, but other frames. These joints have other "
            f"axes or are missing: {', '.join(others)}. The numbers would be in the wrong frames.",
            possible="the formats urdf and xacro",
            remedy=f"identify with a description of the present {package}, or choose another format with --to.",
        )


def _has_axes(joint: ET.Element, rpy: tuple[float, float, float]) -> bool:
    """True if a joint turns about z, and its frame is turned against the parent's by given angles, about."""
    axis = _three(joint.find("axis"), "xyz")
    turned = rpy_rotation(np.array(rpy)).T @ rpy_rotation(_three(joint.find("origin"), "rpy"))
    angle = float(np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0)))
    return bool(axis[2] > 0.0 and np.abs(axis[:2]).max() == 0.0 and angle < MOST_TURNED)


def link_numbers(root: ET.Element, name: str) -> LinkNumbers | None:
    """Mass, centre of mass and inertia of a link; `None` if the link has no `<inertial>` in the URDF."""
    inertial = next((link.find("inertial") for link in root.findall("link") if link.get("name") == name), None)
    if inertial is None:
        return None
    origin, mass, tensor = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    R = rpy_rotation(_three(origin, "rpy"))
    about = np.zeros((3, 3))
    for pair, (i, j) in TENSOR.items():
        about[i, j] = about[j, i] = 0.0 if tensor is None else float(tensor.get(f"i{pair}", "0"))
    about = R @ about @ R.T
    value = 0.0 if mass is None else float(mass.get("value", "0"))
    return LinkNumbers(value, _three(origin, "xyz"), (about + about.T) / 2.0)


def numbers_of_links(root: ET.Element, names: Sequence[str], package: str) -> list[LinkNumbers]:
    """Mass, centre of mass and inertia of each link that a package needs.

    Raises:
        OutputError: The URDF has no inertia of at least one of the links.
    """
    found = {name: link_numbers(root, name) for name in names}
    missing = [name for name, numbers in found.items() if numbers is None]
    if missing:
        raise OutputError(
            f"{package} needs an inertia of each link, and the URDF has none of {', '.join(missing)}.",
            remedy="write an inertia of these links into the description, and identify again.",
        )
    return [numbers for numbers in found.values() if numbers is not None]


def _three(origin: ET.Element | None, key: str) -> Array:
    text = "" if origin is None else origin.get(key, "")
    return np.array([float(word) for word in text.split()] or [0.0, 0.0, 0.0])


def friction_of(root: ET.Element, joint: str) -> dict[str, float]:
    """Values `damping` [N·m·s/rad or N·s/m] and `friction` [N·m or N] of a joint; zero if the URDF has none."""
    dynamics = next((each.find("dynamics") for each in root.findall("joint") if each.get("name") == joint), None)
    return {key: float(dynamics.get(key, "0")) if dynamics is not None else 0.0 for key in ("damping", "friction")}


def with_values(
    urdf: bytes, links: Mapping[str, tuple[str, str, str, Mapping[str, str]]], joints: Mapping[str, Mapping[str, str]]
) -> bytes:
    """URDF in which inertias and friction are replaced, as the macros of a package write them.

    Args:
        urdf: The URDF.
        links: For each link, the texts of mass, `xyz` and `rpy`, and of the elements of the tensor by `xx`, `xy` ….
        joints: For each joint, the texts of `damping` and `friction`.
    """
    root = ET.fromstring(urdf)
    for link in root.findall("link"):
        if (name := link.get("name", "")) not in links:
            continue
        mass, xyz, rpy, tensor = links[name]
        for old in link.findall("inertial"):
            link.remove(old)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", {"xyz": xyz, "rpy": rpy})
        ET.SubElement(inertial, "mass", {"value": mass})
        ET.SubElement(inertial, "inertia", {f"i{pair}": text for pair, text in tensor.items()})
    for joint in root.findall("joint"):
        if (name := joint.get("name", "")) in joints:
            for old in joint.findall("dynamics"):
                joint.remove(old)
            ET.SubElement(joint, "dynamics", dict(joints[name]))
    return ET.tostring(root)


def yaml_lines(values: Mapping[str, object], indent: int = 0) -> list[str]:
    """Lines of YAML for nested mappings of numbers and texts.

    Numbers have no exponent, because YAML 1.1 reads `1e-05` as a text.
    """
    lines: list[str] = []
    for key, value in values.items():
        head = f"{'  ' * indent}{key}:"
        if isinstance(value, Mapping):
            lines += [head, *yaml_lines(value, indent + 1)]
        else:
            lines.append(f"{head} {plain_number(value) if isinstance(value, float) else value}")
    return lines


def read_yaml(text: str) -> dict[str, object]:
    """Nested mappings with the texts of the values of a file that `yaml_lines` has made."""
    result: dict[str, object] = {}
    levels = [result]
    for line in text.splitlines():
        key, _, value = line.strip().partition(":")
        if not key or key.startswith("#"):
            continue
        level = (len(line) - len(line.lstrip())) // 2
        if value.strip():
            levels[level][key] = value.strip()
        else:
            inner: dict[str, object] = {}
            levels[level][key] = inner
            levels[level + 1 :] = [inner]
    return result

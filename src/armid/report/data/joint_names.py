"""Labels of joints by name and number; names of parameters end in the number."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby

from armid.robot import Joint

__all__ = ["MAX_NAMES", "by_joint", "groups_of", "heading_of", "label_of", "number_of", "residual_title"]

MAX_NAMES = 6
"""Largest number of names that a list writes out; further ones are only counted."""


def heading_of(joints: Sequence[Joint], j: int) -> str:
    """Number and name of a joint, index j, for a heading: `joint 3 · elbow`."""
    return f"joint {j + 1} · {joints[j].name}"


def label_of(joints: Sequence[Joint], j: int) -> str:
    """Label of a joint for a cell or a sentence: `3 · elbow`; the name alone if it ends in the number."""
    name = joints[j].name
    suffix = re.search(r"(\d+)$", name)
    return name if suffix is not None and int(suffix[1]) == j + 1 else f"{j + 1} · {name}"


def residual_title(heading: str) -> str:
    """Title of the residual plot below the torque plot of a joint."""
    return f"{heading}, residual"


def number_of(parameter: str) -> int:
    """Number of the joint that a parameter belongs to: 3 for `FV_3` or `FV_3[2]`; 0 if there is none."""
    match = re.search(r"_(\d+)(?:\[\d+\])?$", parameter)
    return 0 if match is None else int(match[1])


def by_joint(parameters: Iterable[str], joints: Sequence[Joint]) -> str:
    """List of the first parameters as text, grouped by joint with its name, and the count of the others."""
    all_names = list(parameters)
    shown = all_names[:MAX_NAMES] if len(all_names) > MAX_NAMES + 1 else all_names
    parts: list[str] = []
    for number, names in groupby(shown, number_of):
        joint = f" ({joints[number - 1].name})" if 0 < number <= len(joints) else ""
        parts.append(", ".join(names) + joint)
    return "; ".join(parts) + (f" and {len(all_names) - len(shown)} more" if len(all_names) > len(shown) else "")


def groups_of(parameters: Sequence[str], joints: Sequence[Joint]) -> tuple[list[int], dict[int, str]]:
    """Order of the parameters by joint, and the heading of each joint by the index of its first parameter."""
    order = sorted(range(len(parameters)), key=lambda k: number_of(parameters[k]))
    groups: dict[int, str] = {}
    for place, k in enumerate(order):
        number = number_of(parameters[k])
        if place == 0 or number != number_of(parameters[order[place - 1]]):
            groups[place] = heading_of(joints, number - 1) if 0 < number <= len(joints) else "of no joint"
    return order, groups

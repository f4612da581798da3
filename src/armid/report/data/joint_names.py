"""Labels of joints with name and number, and parameters grouped by joint."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby

from armid.model.parameter_name import ParameterName
from armid.robot import Joint

MAX_NAMES = 6
"""Largest number of names in a list; further names are only counted."""


def heading_of(joints: Sequence[Joint], j: int) -> str:
    """Number and name of a joint, index j, for a heading: `joint 3 · elbow`."""
    return f"joint {j + 1} · {joints[j].name}"


def label_of(joints: Sequence[Joint], j: int) -> str:
    """Label of a joint for a cell or a sentence: `3 · elbow`, or only the name if the name ends in the number."""
    name = joints[j].name
    suffix = re.search(r"(?<!\d)0*(\d{1,9})$", name)  # a longer number is not that of a joint
    return name if suffix is not None and int(suffix[1]) == j + 1 else f"{j + 1} · {name}"


def residual_title(heading: str) -> str:
    """Title of the residual plot below the torque plot of a joint."""
    return f"{heading}, residual"


def by_joint(parameters: Iterable[ParameterName], joints: Sequence[Joint]) -> str:
    """Text that lists the first `MAX_NAMES` parameters, grouped by joint, and states the number of the others."""
    all_names = list(parameters)
    shown = all_names[:MAX_NAMES] if len(all_names) > MAX_NAMES + 1 else all_names
    parts: list[str] = []
    for number, names in groupby(shown, lambda name: name.number or 0):
        joint = f" ({joints[number - 1].name})" if 0 < number <= len(joints) else ""
        parts.append(", ".join(names) + joint)
    return "; ".join(parts) + (f" and {len(all_names) - len(shown)} more" if len(all_names) > len(shown) else "")


def groups_of(parameters: Sequence[ParameterName], joints: Sequence[Joint]) -> tuple[list[int], dict[int, str]]:
    """Indices that sort the parameters by joint, and the headings of the joints.

    The key of a heading is the place of the first parameter of the joint in the sorted order.
    """
    order = sorted(range(len(parameters)), key=lambda k: parameters[k].number or 0)
    groups: dict[int, str] = {}
    for place, k in enumerate(order):
        number = parameters[k].number or 0
        if place == 0 or number != (parameters[order[place - 1]].number or 0):
            groups[place] = heading_of(joints, number - 1) if 0 < number <= len(joints) else "of no joint"
    return order, groups

"""Names of joints beside their numbers, which the names of parameters bear."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import groupby

from armid.robot import Joint

__all__ = ["MOST_NAMES", "by_joint", "groups_of", "heading_of", "label_of", "number_of", "residual_title"]

MOST_NAMES = 6
"""Names of a list that are written out; a few more are counted."""


def heading_of(joints: Sequence[Joint], j: int) -> str:
    """Number and name of a joint, index j, for a heading: `joint 3 · elbow`."""
    return f"joint {j + 1} · {joints[j].name}"


def label_of(joints: Sequence[Joint], j: int) -> str:
    """The same for a cell or a sentence: `3 · elbow`; the name alone where it ends with the number."""
    name = joints[j].name
    own = re.search(r"(\d+)$", name)
    return name if own is not None and int(own[1]) == j + 1 else f"{j + 1} · {name}"


def residual_title(heading: str) -> str:
    """Title of the residual below the torque of a joint."""
    return f"{heading}, residual"


def number_of(parameter: str) -> int:
    """Number of the joint that a parameter belongs to: 3 of `FV_3` or `FV_3[2]`; 0 where there is none."""
    found = re.search(r"_(\d+)(?:\[\d+\])?$", parameter)
    return 0 if found is None else int(found[1])


def by_joint(parameters: Iterable[str], joints: Sequence[Joint]) -> str:
    """Parameters after one another, those of a joint together with its name, the first few."""
    every = list(parameters)
    shown = every[:MOST_NAMES] if len(every) > MOST_NAMES + 1 else every
    parts: list[str] = []
    for number, names in groupby(shown, number_of):
        whose = f" ({joints[number - 1].name})" if 0 < number <= len(joints) else ""
        parts.append(", ".join(names) + whose)
    return "; ".join(parts) + (f" and {len(every) - len(shown)} more" if len(every) > len(shown) else "")


def groups_of(parameters: Sequence[str], joints: Sequence[Joint]) -> tuple[list[int], dict[int, str]]:
    """Order of parameters joint by joint, and the heading of each joint by the place of its first parameter."""
    order = sorted(range(len(parameters)), key=lambda k: number_of(parameters[k]))
    groups: dict[int, str] = {}
    for place, k in enumerate(order):
        number = number_of(parameters[k])
        if place == 0 or number != number_of(parameters[order[place - 1]]):
            groups[place] = heading_of(joints, number - 1) if 0 < number <= len(joints) else "of no joint"
    return order, groups

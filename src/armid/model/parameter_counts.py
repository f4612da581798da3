"""Numbers of parameters that belong to bodies, to rotors and to friction: `43 inertial + 14 friction`."""

from __future__ import annotations

from collections.abc import Iterable

from armid.model.terms.rigid_body import RIGID_BODY_SYMBOLS
from armid.model.terms.rotor_inertia import RotorInertia

__all__ = ["by_joint", "count_text", "joint_number"]

ROTOR = "IA"
"""Symbol of the parameter of `RotorInertia`."""


def count_text(names: Iterable[str]) -> str:
    """Numbers of parameters by kind in words, kinds without any left out.

    Args:
        names: Names as the field writes them, grouped or not, `ZZR_1`, `FV_2[1]`.
    """
    kinds = {"inertial": 0, RotorInertia.name.replace("-", " "): 0, "friction": 0}
    inertial, rotor, friction = kinds
    for name in names:
        symbol = name.split("_", 1)[0]
        bodies = symbol.removesuffix("R") in RIGID_BODY_SYMBOLS
        kinds[inertial if bodies else rotor if symbol.removesuffix("R") == ROTOR else friction] += 1
    return " + ".join(f"{count} {kind}" for kind, count in kinds.items() if count)


def joint_number(name: str) -> int:
    """Number of the joint that a parameter's name ends in, from 1."""
    return int(name.split("[", 1)[0].rsplit("_", 1)[1])


def by_joint(names: Iterable[str]) -> dict[int, list[int]]:
    """Positions of parameters by the number of their joint, ascending."""
    groups: dict[int, list[int]] = {}
    for k, name in enumerate(names):
        groups.setdefault(joint_number(name), []).append(k)
    return dict(sorted(groups.items()))

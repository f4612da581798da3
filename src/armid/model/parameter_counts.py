"""Numbers of parameters of bodies, rotors and friction: `43 inertial + 14 friction`."""

from __future__ import annotations

from collections.abc import Iterable

from armid.model.parameter_name import ParameterName
from armid.model.terms.rigid_body import RIGID_BODY_SYMBOLS
from armid.model.terms.rotor_inertia import RotorInertia

ROTOR = "IA"
"""Symbol of the parameter of `RotorInertia`."""


def count_text(names: Iterable[ParameterName]) -> str:
    """Numbers of parameters by kind in words, without the kinds that have none.

    Args:
        names: Names of parameters, grouped or not, such as `ZZR_1` or `FV_2[1]`.
    """
    kinds = {"inertial": 0, RotorInertia.name.replace("-", " "): 0, "friction": 0}
    inertial, rotor, friction = kinds
    for name in names:
        bodies = name.symbol in RIGID_BODY_SYMBOLS
        kinds[inertial if bodies else rotor if name.symbol == ROTOR else friction] += 1
    return " + ".join(f"{count} {kind}" for kind, count in kinds.items() if count)


def by_joint(names: Iterable[ParameterName]) -> dict[int, list[int]]:
    """Positions of parameters by the number of their joint, ascending; 0 for those of no joint."""
    groups: dict[int, list[int]] = {}
    for k, name in enumerate(names):
        groups.setdefault(name.number or 0, []).append(k)
    return dict(sorted(groups.items()))

"""Numbers of inertial, rotor inertia and friction parameters, for instance `43 inertial + 14 friction`."""

from __future__ import annotations

from collections.abc import Iterable

from armid.model.parameter_name import ParameterName
from armid.model.terms.rigid_body import RIGID_BODY_SYMBOLS
from armid.model.terms.rotor_inertia import RotorInertia

ROTOR = "IA"
"""Symbol of the parameter of the torque term `RotorInertia`, the rotor inertia."""


def count_text(names: Iterable[ParameterName]) -> str:
    """Numbers of inertial, rotor inertia and friction parameters as text: `43 inertial + 14 friction`.

    Kinds without parameters are left out.

    Args:
        names: Names of standard or base parameters, such as `ZZR_1` or `FV_2[1]`.
    """
    kinds = {"inertial": 0, RotorInertia.name.replace("-", " "): 0, "friction": 0}
    inertial, rotor, friction = kinds
    for name in names:
        bodies = name.symbol in RIGID_BODY_SYMBOLS
        kinds[inertial if bodies else rotor if name.symbol == ROTOR else friction] += 1
    return " + ".join(f"{count} {kind}" for kind, count in kinds.items() if count)


def by_joint(names: Iterable[ParameterName]) -> dict[int, list[int]]:
    """Groups parameters by joint: for each joint number, ascending, the indices of its parameters.

    Parameters without a joint have the number 0.
    """
    groups: dict[int, list[int]] = {}
    for k, name in enumerate(names):
        groups.setdefault(name.number or 0, []).append(k)
    return dict(sorted(groups.items()))

"""Smallest set of requirements that contradict each other (irreducible infeasible subset).

One requirement after the other is removed. If no parameters meet the remaining requirements, the requirement stays
removed; otherwise it is restored. No parameters meet all requirements of the result, but if any single requirement is
removed from the result, the others can be met.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from armid.estimation.consistency.additional_constraints import Requirements


def conflicting(asked: Requirements, empty: Callable[[Requirements], bool]) -> list[str]:
    """Text that lists contradicting requirements; if any one of them is removed, the others can be met.

    Args:
        asked: Requirements that no parameters meet.
        empty: Function that returns true if no parameters meet the given requirements.
    """
    kept = _single(asked)
    none = Requirements(asked.epsilon)
    for each in tuple(kept):
        others = [other for other in kept if other is not each]
        if empty(_joined(none, others)):
            kept = others
    return [f"{name} = {_said(value)}" for name, value in kept]


def _single(asked: Requirements) -> list[tuple[str, Any]]:
    """Splits requirements into single requirements, each given by the name of an option and a value."""
    found: list[tuple[str, Any]] = []
    for name in ("heaviest", "total_mass"):
        if getattr(asked, name) is not None:
            found.append((name, getattr(asked, name)))
    for name in ("masses", "com", "fixed"):
        found += [(name, {key: value}) for key, value in (getattr(asked, name) or {}).items()]
    for name in ("equal", "known"):
        found += [(name, (value,)) for value in getattr(asked, name)]
    return found


def _joined(none: Requirements, parts: list[tuple[str, Any]]) -> Requirements:
    """Adds single requirements, given by option and value, to the requirements `none`, which are never removed."""
    options: dict[str, Any] = {}
    for name, value in parts:
        before = options.get(name)
        if isinstance(value, Mapping):
            options[name] = {**(before or {}), **value}
        elif name in ("equal", "known"):
            options[name] = (*(before or ()), *value)
        else:
            options[name] = value
    return replace(none, **options)


def _said(value: Any) -> str:
    """Text of a value in the form in which a study contains it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_said(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_said(each) for each in value) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"

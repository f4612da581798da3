"""Irreducible infeasible subset of the requirements.

Each requirement is removed in turn, permanently if the others are still infeasible. The remaining set becomes
feasible when any one of its requirements is removed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from armid.estimation.consistency.constraints import Requirements

__all__ = ["conflicting"]


def conflicting(asked: Requirements, empty: Callable[[Requirements], bool]) -> list[str]:
    """Requirements, in words, that leave no body together and would without any one of them.

    Args:
        asked: Requirements that leave no body.
        empty: Whether requirements leave none.
    """
    kept = _single(asked)
    none = Requirements(asked.epsilon)
    for each in tuple(kept):
        others = [other for other in kept if other is not each]
        if empty(_joined(none, others)):
            kept = others
    return [f"{name} = {_said(value)}" for name, value in kept]


def _single(asked: Requirements) -> list[tuple[str, Any]]:
    """Each requirement by itself, as the option that asks for it and nothing else."""
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
    """Requirements together."""
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
    """A value as a study would have it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_said(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_said(each) for each in value) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"

"""Hints in the words of the command line: the options of the command in use, then the keys of a study."""

from __future__ import annotations

from contextvars import ContextVar
from itertools import chain
from typing import Any

__all__ = ["CONTEXT", "hint", "options_of_command"]

CONTEXT: ContextVar[Any] = ContextVar("context", default=None)
"""Context of the command that runs; kept here, for versions of typer differ in whose click they use."""


def hint(remedy: str) -> str:
    """A remedy as somebody at the prompt needs it; as it stands where no command runs, or nothing is to be said.

    Args:
        remedy: Of a finding or an error.
    """
    if " = " not in remedy or CONTEXT.get() is None:
        return remedy
    from armid.study.remedies import at_the_prompt

    return at_the_prompt(remedy, options_of_command())


def options_of_command() -> tuple[str, ...]:
    """Keys of a study that the command in use has options for; a study on the line says its readings itself."""
    from armid.study.remedies import OF_READING, OPTIONS

    context = CONTEXT.get()
    if context is None:
        return ()
    known = set(chain.from_iterable(param.opts for param in context.command.params))
    found = tuple(key for key in OPTIONS if f"--{key.replace('_', '-')}" in known)
    if not _has_study(context):
        return found
    return () if context.info_name == "doctor" else tuple(key for key in found if key not in OF_READING)


def _has_study(context: Any) -> bool:
    """Tell whether the command was given a study in the place of an arm and recordings."""
    names = [param.name for param in context.command.params if param.param_type_name == "argument"]
    given: list[Any] = []
    for name in names:
        value = context.params.get(name or "")
        given += value if isinstance(value, list | tuple) else [value] if value is not None else []
    return len(given) == 1 and str(given[0]).endswith(".toml")

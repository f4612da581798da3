"""Remedies for the command line, in which options of the running command replace keys of a study."""

from __future__ import annotations

import shlex
from collections.abc import Container
from contextvars import ContextVar
from itertools import chain
from typing import Any

from armid.remedy import Remedy

CONTEXT: ContextVar[Any] = ContextVar("context", default=None)
"""Context of the running command; stored here because versions of typer use different versions of click."""


def hint(remedy: str) -> str:
    """Remedy with options of the running command; unchanged if no command runs or the remedy names no key.

    Args:
        remedy: Remedy of a finding or an error.
    """
    if not isinstance(remedy, Remedy) or CONTEXT.get() is None:
        return remedy
    from armid.study.remedy_translation import at_the_prompt

    return at_the_prompt(remedy, options_of_command())


def options_of_command() -> tuple[str, ...]:
    """Keys of a study that the running command accepts as options; if a study is given, no keys of the log format.

    A command with the option `--reading` accepts every key of a log format; then `reading` is one of the keys.
    """
    from armid.study.remedy_translation import OF_READING, OPTIONS, READING

    context = CONTEXT.get()
    if context is None:
        return ()
    known = set(chain.from_iterable(param.opts for param in context.command.params))
    keys = tuple(key for key in (*OPTIONS, READING) if f"--{key.replace('_', '-')}" in known)
    if not _has_study(context):
        return keys
    return () if context.info_name == "doctor" else tuple(key for key in keys if key not in OF_READING)


def given_options(names: Container[str]) -> list[str]:
    """Options of the running command that were given, as words for a shell; none if a study was given.

    Args:
        names: Names of the options that are looked up.
    """
    context = CONTEXT.get()
    if context is None or _has_study(context):
        return []
    found: list[str] = []
    for param in context.command.params:
        value = context.params.get(param.name)
        if param.param_type_name != "option" or param.name not in names or not _is_given(value):
            continue
        for each in value if isinstance(value, list) else [value]:
            numbers = each if isinstance(each, tuple) else (each,)
            found += [param.opts[0], *(shlex.quote(f"{x:.12g}" if isinstance(x, float) else str(x)) for x in numbers)]
    return found


def _is_given(value: Any) -> bool:
    """True if an option was given with a value; false for switches, which have no value."""
    return value is not None and value != () and not isinstance(value, bool)


def _has_study(context: Any) -> bool:
    """True if the command was given a study instead of an arm and recordings."""
    names = [param.name for param in context.command.params if param.param_type_name == "argument"]
    given: list[Any] = []
    for name in names:
        value = context.params.get(name or "")
        given += value if isinstance(value, list | tuple) else [value] if value is not None else []
    return len(given) == 1 and str(given[0]).endswith(".toml")

"""Errors of commands with `--json`, including errors of the parser, as JSON objects on standard output."""

from __future__ import annotations

import json
import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from typer.core import TyperGroup

BAD_INPUT = 2
"""Exit code for bad input, and for a wrong command line."""

ASKED = "armid.json"
"""Key of the parser's context whose value is true if `--json` is on the command line."""


def write_error(problem: str, possible: str = "", remedy: str = "", code: int = BAD_INPUT) -> None:
    """Write an error as a JSON object on standard output.

    Args:
        problem: Text that states the request, and the value or state that makes it impossible.
        possible: Values that are accepted.
        remedy: Action that solves the problem.
        code: Exit code of the command.
    """
    record = {"error": problem, "possible": possible, "remedy": remedy, "exit_code": code}
    sys.stdout.write(json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    sys.stdout.flush()


class Group(TyperGroup):
    """Group of all commands; with `--json`, a wrong command line gives a JSON object and the parser's message."""

    def make_context(self, info_name: str | None, args: list[str], *rest: Any, **extra: Any) -> Any:
        """Parse the part of the command line before the name of the command."""
        asked = "--json" in args
        with _as_json(asked):
            context = super().make_context(info_name, args, *rest, **extra)
        context.meta[ASKED] = asked
        return context

    def invoke(self, ctx: Any) -> Any:
        """Parse the command line of a command, and run it."""
        with _as_json(ctx.meta[ASKED]):
            return super().invoke(ctx)


@contextmanager
def _as_json(asked: bool) -> Generator[None]:
    """Write errors of the parser as JSON objects if `asked` is true, and raise these errors again.

    The exceptions of the parser are recognised by their attributes, because versions of typer use different versions
    of click.
    """
    try:
        yield
    except Exception as error:
        message = getattr(error, "format_message", None)
        if asked and message is not None and getattr(error, "exit_code", None) == BAD_INPUT:
            command = getattr(getattr(error, "ctx", None), "command_path", "armid")
            write_error(message(), remedy=f"{command} --help lists arguments and options.")
        raise

"""The command line: `armid COMMAND`.

Exit codes: 0 done, 1 a verdict failed, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from contextvars import copy_context
from functools import wraps
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from armid.cli.commands.base import base
from armid.cli.commands.bench import bench
from armid.cli.commands.certify import certify
from armid.cli.commands.demo import demo
from armid.cli.commands.doctor import doctor
from armid.cli.commands.export import export
from armid.cli.commands.identify import identify
from armid.cli.commands.payload import payload
from armid.cli.commands.predict import predict
from armid.cli.commands.recalibrate import recalibrate
from armid.cli.commands.report import report
from armid.cli.commands.thesis import thesis
from armid.cli.commands.track import track
from armid.cli.commands.validate import validate
from armid.cli.help_format import Command
from armid.cli.hints import hint
from armid.cli.motion.excite import excite
from armid.cli.motion.preview import preview
from armid.cli.motion.simulate import simulate
from armid.cli.next_step import next_step
from armid.errors import ArmidError
from armid.threads import prefer_one_thread

__all__ = ["app", "main"]

BAD_INPUT = 2
INTERRUPTED = 130


class _StoppedError(Exception):
    """Ctrl-C inside a command; the parser would end the program without a word."""


def _interruptible(command: Callable[..., None]) -> Callable[..., None]:
    """The command with Ctrl-C as an exception that `main` sees, and with hints that name its options."""

    @wraps(command)
    def run(**options: Any) -> None:
        try:
            command(**options)
        except ArmidError as error:
            error.remedy = hint(error.remedy)
            raise
        except KeyboardInterrupt:
            raise _StoppedError from None

    return run


app = typer.Typer(
    name="armid",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        sys.stdout.write(f"armid {version('armid')}\n")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Find the dynamic model of a robot arm: base parameters, friction and intervals from recordings."""
    del version
    if context.invoked_subcommand is None:
        sys.stdout.write(next_step())


COMMANDS: tuple[Callable[..., None], ...] = (
    base,
    excite,
    simulate,
    identify,
    doctor,
    validate,
    predict,
    certify,
    payload,
    recalibrate,
    track,
    report,
    preview,
    export,
    demo,
    thesis,
    bench,
)
for command in COMMANDS:
    app.command(cls=Command)(_interruptible(command))


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; errors of armid become one message and exit code 2."""
    prefer_one_thread()
    given = sys.argv[1:] if arguments is None else arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal without Greek letters gets their numbers
            stream.reconfigure(errors="backslashreplace")
    try:
        copy_context().run(app, _repeated("--validate", _joined(given)), prog_name="armid", standalone_mode=True)
    except ArmidError as error:
        from armid.cli.console import print_error

        print_error(error)
        sys.exit(BAD_INPUT)
    except (_StoppedError, KeyboardInterrupt):
        sys.stderr.write("interrupted; nothing was written\n")
        sys.exit(INTERRUPTED)


def _repeated(option: str, arguments: list[str]) -> list[str]:
    """`--validate a b` as `--validate a --validate b`, which the parser understands."""
    result: list[str] = []
    inside = False
    for argument in arguments:
        if argument.startswith("-"):
            inside = argument == option
            if not inside:
                result.append(argument)
        elif inside:
            result += [option, argument]
        else:
            result.append(argument)
    if inside and (not result or option not in result):
        result.append(option)
    return result


POSES = ("--start", "--begin", "--end", "--noise", "--tip", "--tip-box")
"""Options of `excite` with as many numbers as there are joints, which may have blanks between them."""


def _joined(arguments: list[str]) -> list[str]:
    """`--start 0 -1 0` as `--start=0,-1,0`, which the parser understands."""
    result: list[str] = []
    for argument in arguments:
        name, equals, _ = (result[-1] if result else "").partition("=")
        if name in POSES and NUMBERS.fullmatch(argument):
            result[-1] = f"{result[-1]},{argument}" if equals else f"{name}={argument}"
        else:
            result.append(argument)
    return result


NUMBERS = re.compile(r"[-+.\deE]+(,[-+.\deE]*)*,?")

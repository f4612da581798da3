"""The command line: `armid COMMAND`.

Exit codes: 0 success, 1 failed verdict, 2 wrong input, 70 an error that armid did not expect, 130 interruption,
141 the reader of the output has gone, 143 ended by SIGTERM.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from contextvars import copy_context
from functools import wraps
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from armid.cli.command_list import COMMANDS
from armid.cli.folder_overview import next_step
from armid.cli.help_format import Command
from armid.cli.json_errors import BAD_INPUT, Group, write_error
from armid.cli.last_handler import (
    BROKEN_PIPE,
    INTERRUPTED,
    UNEXPECTED,
    Terminated,
    discard_output,
    ended_by_signals,
    flushed,
    open_missing_streams,
    report_unexpected,
    stopped_line,
)
from armid.cli.remedy_hints import hint
from armid.errors import ArmidError
from armid.input_boundary import LIMITS, VARIABLE, allow, is_failure, parsed_limits, reason
from armid.output.locks import end_claims, start_claims
from armid.output.scratch import remove_abandoned
from armid.output.written import forget_written
from armid.threads import keep_freed_memory, prefer_one_thread


class _StoppedError(Exception):
    """Interruption of a command by Ctrl-C; without this exception the parser would end without a message."""


class _GoneError(Exception):
    """Loss of the reader of an output; without this exception the parser would end with an exit code of its own."""


def _interruptible(command: Callable[..., None]) -> Callable[..., None]:
    """Wraps a command, so that Ctrl-C raises an exception that `main` handles, and remedies name its options.

    Failures of computations, such as those on values of 1e300, and of the file system become errors of armid.
    """

    @wraps(command)
    def run(**options: Any) -> None:
        try:
            command(**options)
        except ArmidError as error:
            error.remedy = hint(error.remedy)
            raise
        except KeyboardInterrupt:
            raise _StoppedError from None
        except (ArithmeticError, MemoryError, ValueError) as error:
            if isinstance(error, ValueError) and type(error).__name__ != "LinAlgError":  # NumPy is not imported here
                raise
            raise ArmidError(
                f"A computation of armid {command.__name__} failed ({reason(error)}).",
                remedy="check the values of the recording, the description and the options; armid doctor examines a "
                "recording.",
            ) from error
        except BrokenPipeError:
            raise _GoneError from None
        except RuntimeError as error:
            if "Symlink loop" not in str(error):  # of pathlib before Python 3.13
                raise
            raise ArmidError(f"Links lead in a loop: {error}.", remedy="give another path.") from error
        except OSError as error:
            raise ArmidError(
                f"{error.filename or 'A file'} cannot be read or written ({reason(error)}).",
                remedy="give another path, or correct the rights of the file.",
            ) from error

    return run


app = typer.Typer(
    name="armid",
    cls=Group,
    pretty_exceptions_enable=False,
    epilog="docs/glossary.md explains the terms.",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(requested: bool) -> None:
    """Prints the version and ends the program, if requested."""
    if requested:
        from importlib.metadata import version

        sys.stdout.write(f"armid {version('armid')}\n")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    allowed: Annotated[
        list[str] | None,
        typer.Option(
            "--allow",
            metavar="LIMIT=NUMBER",
            help=f"Raise a limit of the size of input: {', '.join(LIMITS)}; repeatable. Also: {VARIABLE}.",
        ),
    ] = None,
) -> None:
    """Find the dynamic model of a robot arm: base parameters, friction and intervals from recordings."""
    del version
    allow(parsed_limits(",".join(allowed or ())))
    if context.invoked_subcommand is None:
        sys.stdout.write(next_step())


for command in COMMANDS:
    app.command(cls=Command)(_interruptible(command))


def main(arguments: list[str] | None = None, *, blocked: Collection[int] = ()) -> None:
    """Run the command line; an error of armid is printed as one message and gives exit code 2.

    Any other error is printed as one line, and its trace is written to a file.

    Args:
        arguments: Command line without the name of the program; by default that of this process.
        blocked: Signals that wait until they are handled.
    """
    open_missing_streams()
    prefer_one_thread()
    keep_freed_memory()
    raw_arguments = sys.argv[1:] if arguments is None else arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # escapes what the terminal cannot show, as Greek letters
            stream.reconfigure(errors="backslashreplace")
    code = UNEXPECTED
    try:
        code = _exit_code(raw_arguments, blocked)
    except OSError:  # the message could not be written, and there is nowhere to say it
        code = BAD_INPUT
    sys.exit(flushed(code))


def _exit_code(arguments: list[str], blocked: Collection[int]) -> int:
    """Run the command line, print the message of an error, and return the exit code."""
    as_json = "--json" in arguments
    try:
        _run(arguments, blocked)
    except ArmidError as error:
        _tell(error, as_json=as_json)
        return BAD_INPUT
    except (_StoppedError, KeyboardInterrupt):
        sys.stderr.write(stopped_line("interrupted"))
        return INTERRUPTED
    except Terminated as ended:
        sys.stderr.write(stopped_line(ended.reason))
        return int(ended.code or 0)
    except (_GoneError, BrokenPipeError):
        discard_output()
        return BROKEN_PIPE
    except SystemExit as ended:
        if _is_interrupted(ended):
            sys.stderr.write(stopped_line("interrupted"))
            return INTERRUPTED
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException as error:
        if not is_failure(error):
            raise
        line = report_unexpected(error, arguments)
        if as_json:
            write_error(line.removeprefix("error "), code=UNEXPECTED)
        sys.stderr.write(f"{line}\n")
        return UNEXPECTED
    return 0


def _tell(error: ArmidError, *, as_json: bool) -> None:
    """Print an error, and also write it as a JSON object, if asked for."""
    from armid.cli.console import print_error

    if as_json:
        with suppress(OSError):  # the error may be that this stream cannot be written
            write_error(error.problem, error.possible, error.remedy)
    print_error(error)


def _is_interrupted(ended: SystemExit) -> bool:
    """Tests whether the parser of the command line turned an interruption into an end without a message."""
    chain: list[BaseException] = [ended]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None and before not in chain:
        chain.append(before)
    return any(isinstance(each, KeyboardInterrupt) for each in chain)


def _run(arguments: list[str], blocked: Collection[int]) -> None:
    """Run a command, which is ended by signals, and give up its locks."""
    given = _repeat_option("--validate", _join_numbers(arguments))
    forget_written()
    remove_abandoned()
    start_claims(" ".join(["armid", *[each for each in arguments if not each.startswith("-")][:1]]))
    try:
        with ended_by_signals(blocked):
            # In a context of its own: the packages of one call are not known to the next one in the same program.
            copy_context().run(app, given, prog_name="armid", standalone_mode=True)
    finally:
        end_claims()


def _repeat_option(option: str, arguments: list[str]) -> list[str]:
    """Rewrites `--validate a b` as `--validate a --validate b`, the only form that the parser accepts."""
    result: list[str] = []
    follows_option = needs_value = False
    for argument in arguments:
        if argument.startswith("-"):
            if needs_value:  # left to the parser, which refuses an option without a value
                result.append(option)
            follows_option = needs_value = argument == option
            if not follows_option:
                result.append(argument)
        elif follows_option:
            result += [option, argument]
            needs_value = False
        else:
            result.append(argument)
    return [*result, option] if needs_value else result


NUMBER_LISTS = ("--start", "--begin", "--end", "--noise", "--tip", "--tip-box")
"""Options of `excite` that take several numbers; the numbers may be separated by blanks."""


def _join_numbers(arguments: list[str]) -> list[str]:
    """Rewrites `--start 0 -1 0` as `--start=0,-1,0`, the only form that the parser accepts."""
    result: list[str] = []
    for argument in arguments:
        name, equals, _ = (result[-1] if result else "").partition("=")
        if name in NUMBER_LISTS and NUMBERS.fullmatch(argument):
            result[-1] = f"{result[-1]},{argument}" if equals else f"{name}={argument}"
        else:
            result.append(argument)
    return result


NUMBERS = re.compile(r"[-+.\deE]+(,[-+.\deE]*)*,?")
"""Pattern of one number, or of several numbers separated by commas."""

"""Commands on clean inputs in this process, so that those on damaged inputs need not import and compile again.

An attempt is a copy of this process. What each copy would do again, whatever its input is, is done once here:
late imports, the templates of pages and the tree of the command line. Nothing of an input is kept between commands.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import tempfile
from functools import cache
from pathlib import Path

import typer.main
from kinds import Command

REFUSED: Command = ("base", "no-such-file.urdf")
"""Command that ends in the message of an error."""


def warm_start(clean: Path, commands: tuple[Command, ...]) -> None:
    """Runs commands on a copy of the clean inputs, each once in the life of this process.

    Raises:
        RuntimeError: A command refuses its clean input.
    """
    typer.main.get_command = _get_command  # pyright: ignore[reportPrivateImportUsage]
    for command in (REFUSED, *commands):
        _run_once(clean, command)


@cache
def _run_once(clean: Path, command: Command) -> None:
    """Runs a command in a folder of its own."""
    from armid.cli.main import main

    with (
        tempfile.TemporaryDirectory() as place,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as said,
    ):
        folder = Path(place) / "in"
        shutil.copytree(clean, folder)
        with contextlib.chdir(folder):
            try:
                main(list(command))
            except SystemExit as ended:
                if ended.code not in (0, 1, None) and command is not REFUSED:
                    raise RuntimeError(f"{command} fails on the clean input: {said.getvalue()}") from ended


_get_command = cache(typer.main.get_command)

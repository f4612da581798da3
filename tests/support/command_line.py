"""The command line in the process of the tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from armid.cli import main as cli

TERMINAL = ("FORCE_COLOR", "CLICOLOR_FORCE", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
"""Variables that make an output look like a terminal."""


class Done(NamedTuple):
    """End of a command and its output."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as the one JSON object that it is."""

        def refused(name: str) -> None:
            raise AssertionError(f"{name} is no JSON")

        return json.loads(self.out, parse_constant=refused)


Armid = Callable[..., Done]


def exit_code(*arguments: object) -> int:
    """Runs a command; its exit code."""
    with pytest.raises(SystemExit) as ended:
        cli.main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


def command_line(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, folder: Path) -> Armid:
    """Runs commands in a folder, with nobody watching."""
    monkeypatch.chdir(folder)
    for name in TERMINAL:
        monkeypatch.delenv(name, raising=False)

    def run(*arguments: object) -> Done:
        code = exit_code(*arguments)
        out, err = capfd.readouterr()
        return Done(code, out, err)

    return run

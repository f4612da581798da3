"""The blocks of a page of docs/, and a way to do what they say.

- A block of toml or xml whose first line is a comment with a file's name is written to that file; of the others, toml
  has to be valid.
- A block of python is executed; names live on until the page ends.
- A block of bash is run command by command, `armid` in this process, and has to end with 0. `# exit code 1` behind a
  command says that it ends with a failed verdict, and that is what it has to do.
- A block after a line that begins with `*Not run by the tests` is left alone; readers see that line, too.
"""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from typer.core import TyperGroup
from typer.main import get_command

from armid.cli import main as cli
from armid.input_boundary import parsed_limits

DOCS = Path(__file__).parents[2] / "docs"

FENCE = re.compile(
    r"^(?P<note>\*Not run by the tests[^\n]*\n)?```(?P<language>[\w{}-]*)\n(?P<text>.*?)^```", re.M | re.S
)
SYNOPSIS = re.compile(r"\.\.\.|…|\b(?:ROBOT|RUN|RECORDING|PLAN|STUDY|VALUES\.json)\b(?! --simulate)|\s{3,}")
"""Placeholders and columns of a list of commands."""

NAMED = re.compile(r"(?:# |<!-- )([\w/.-]+\.\w+)(?: -->)?")


class Block(NamedTuple):
    """A fenced block of a page."""

    language: str
    text: str
    run: bool


def pages() -> dict[str, str]:
    """All pages by their path in docs/."""
    return {str(path.relative_to(DOCS)): path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page's text, in order."""
    return [Block(found["language"], found["text"], found["note"] is None) for found in FENCE.finditer(page)]


def commands(text: str) -> list[str]:
    """The commands of a block of bash, without comments and with continued lines joined."""
    lines = (
        re.sub(r"(^|\s)# (?!exit code 1$).*", "", line).strip() for line in text.replace("\\\n", " ").splitlines()
    )
    return [line for line in lines if line]


def follow(page: str) -> int:
    """Do what the blocks of a page say, in the working directory; the number of blocks that were done."""
    names: dict[str, Any] = {"__name__": "__page__"}
    done = 0
    for block in blocks(page):
        if not block.run or block.language not in ("bash", "python", "toml", "xml"):
            continue
        named = NAMED.fullmatch(block.text.split("\n", 1)[0])
        if block.language == "bash":
            for command in commands(block.text):
                _run(command)
        elif block.language == "python":
            exec(compile(block.text, "<page>", "exec"), names)
        elif named:
            Path(named[1]).write_text(block.text, encoding="utf-8")
        if block.language == "toml":
            tomllib.loads(block.text)
        done += 1
    return done


FAILS = "# exit code 1"


def _run(command: str) -> None:
    """Run one command of armid; its exit code has to be the one that the page says."""
    expected = 1 if command.endswith(FAILS) else 0
    words = shlex.split(command.removesuffix(FAILS))
    assert words[0] == "armid", f"not a command of armid: {command}"
    code: Any = 0
    try:
        cli.main(words[1:])
    except SystemExit as ended:
        code = ended.code or 0
    assert code == expected, f"{command} ended with {code}"


def understood(command: str) -> None:
    """Parse a command of armid without running it; an unknown command, option or a missing argument is an error."""
    words = shlex.split(command.removesuffix(FAILS))
    group = get_command(cli.app)
    assert isinstance(group, TyperGroup)
    while words[1] == "--allow":  # the option of all commands stands before the name of the command
        parsed_limits(words[2])
        del words[1:3]
    assert words[1] in group.commands, f"no such command: {command}"
    arguments = cli._repeat_option("--validate", cli._join_numbers(words[2:]))  # as `main` does before it parses
    group.commands[words[1]].make_context(words[1], arguments)


def mentioned(page: str) -> list[str]:
    """Commands of armid in any block of bash or of no language, but for synopses, which say what may stand there."""
    found = [each for block in blocks(page) if block.language in ("", "bash") for each in commands(block.text)]
    return [each for each in found if each.startswith("armid ") and not SYNOPSIS.search(each)]

"""All messages as a set: each says what is wrong, and what is possible, what to do, or what it must be.

The messages are read from the source, whichever class they are of; `pytest --collect-only` on this file lists them.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from armid import errors

SOURCE = Path(__file__).parents[2] / "src" / "armid"

CLASSES = {name for name in vars(errors) if name.endswith("Error")} - {"MissingExtraError"}
"""Errors with a message of their own; what an extra is missing for is said in one place."""

SAYS_WHAT_IT_MUST_BE = re.compile(r"\bmust\b|\bneeds?\b|\bat least\b|; found |; found$")
"""Words of a message that has its remedy in it, as in "the rate must be positive; found -1"."""

INNER = {"error.problem", "problem"}
"""Messages that are put together elsewhere, or passed on from an error that has been judged where it was made."""


class Message(NamedTuple):
    """A message as it stands in the source, with {} for what is put in."""

    where: str
    kind: str
    text: str
    possible: bool
    remedy: bool

    @property
    def helps(self) -> bool:
        """True if the message says what is possible or what to do."""
        return self.possible or self.remedy


def messages() -> Iterator[Message]:
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CLASSES:
                helps = {keyword.arg for keyword in node.keywords}
                where = f"{path.relative_to(SOURCE).with_suffix('')}:{node.lineno}"
                yield Message(where, node.func.id, written(node.args[0]), "possible" in helps, "remedy" in helps)


def written(node: ast.expr) -> str:
    """The text of an expression, as far as it stands in the source."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
    return ast.unparse(node)


ALL = list(messages())


def test_what_is_possible_comes_with_what_to_do():
    """A list of names alone leaves the choice to a reader who has just shown that the names are not known."""
    assert {f"{message.where}: {message.text}" for message in ALL if message.possible and not message.remedy} == set()


def test_messages_are_found():
    assert len(ALL) > 400 and {message.kind for message in ALL} == CLASSES


@pytest.mark.parametrize("message", ALL, ids=lambda message: f"{message.where} {message.kind} {message.text[:60]}")
def test_a_message_helps(message: Message):
    assert message.helps or message.text in INNER or SAYS_WHAT_IT_MUST_BE.search(message.text), message.text


@pytest.mark.parametrize("message", ALL, ids=lambda message: f"{message.where}")
def test_a_message_is_a_sentence(message: Message):
    """It ends with a full stop, or with what was put in; it does not shout and does not apologise."""
    assert message.text in INNER or re.search(r"[.}\]]$", message.text.rstrip("')")), message.text
    assert "!" not in message.text.replace("!=", "") and "sorry" not in message.text.lower()

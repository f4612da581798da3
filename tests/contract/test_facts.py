"""Facts travel as values: no module takes a message, a remedy or a code of armid's own apart to get at data in it.

A message that is reworded would silently change what such a module does. Texts of files and of other programs are
read in rooms of their own and carry other names.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import armid

SOURCE = Path(armid.__file__).parent

PROSE = frozenset(
    {"evidence", "problem", "possible", "remedy", "code", "channel", "account", "why", "summary", "verdict"}
)
"""Attributes that hold sentences, codes and names that armid writes itself."""

TAKES_APART = frozenset(
    {"startswith", "endswith", "removeprefix", "removesuffix", "split", "rsplit", "partition", "rpartition"}
    | {"find", "index", "replace", "splitlines"}
)
"""Methods that take a text apart."""

PATTERNS = frozenset({"match", "search", "fullmatch", "findall", "finditer", "sub", "split"})
"""Functions of `re`, and methods of its patterns."""


def _prose(node: ast.AST) -> str:
    """Name of the attribute with a text of armid's own, or an empty text."""
    return node.attr if isinstance(node, ast.Attribute) and node.attr in PROSE else ""


def _taken_apart(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and attribute of each text that is taken apart or searched."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in TAKES_APART and (name := _prose(node.func.value)):
                yield node.lineno, name
            if node.func.attr in PATTERNS:
                yield from ((node.lineno, name) for argument in node.args if (name := _prose(argument)))
        if isinstance(node, ast.Compare) and isinstance(node.left, ast.Constant) and isinstance(node.left.value, str):
            for operator, side in zip(node.ops, node.comparators, strict=True):
                if isinstance(operator, ast.In | ast.NotIn) and (name := _prose(side)):
                    yield node.lineno, name


def test_no_module_takes_a_text_of_armid_apart() -> None:
    found = [
        f"{path.relative_to(SOURCE)}:{line} takes {name!r} apart"
        for path in sorted(SOURCE.rglob("*.py"))
        for line, name in _taken_apart(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert not found, "\n".join(found)


def test_a_text_taken_apart_is_found() -> None:
    lines = (
        "finding.evidence.split('; taken')[0]",
        "PATTERN.search(error.problem)",
        "'not consecutive' in error.problem",
        "finding.code.startswith('roll-out')",
    )
    assert [len(list(_taken_apart(ast.parse(line)))) for line in lines] == [1] * len(lines)
    assert not list(_taken_apart(ast.parse("finding.code in CODES\ntext.split(',')\nerror.problem.rstrip('.')")))

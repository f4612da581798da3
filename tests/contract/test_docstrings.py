"""First lines of docstrings, constants included: a noun phrase or a verb with its object, never a question."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("src/armid", "tests", "benchmarks", "scripts", "docs/extensions")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]

QUESTION = re.compile(r"(How|What|Whether|Which|Why|Where|When|Who|Whose)\b")


def questions(text: str) -> list[str]:
    """First lines of docstrings that begin with a question word: of modules, classes, functions and constants."""
    found = (
        ast.literal_eval(node.value)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    )
    return [docstring.strip().splitlines()[0] for docstring in found if QUESTION.match(docstring.strip())]


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_docstring_begins_with_a_question_word(folder: str):
    files = [path for path in FILES if path.is_relative_to(ROOT / folder)]
    assert files
    assert {str(path): told for path in files if (told := questions(path.read_text(encoding="utf-8")))} == {}


def test_a_question_is_seen_in_every_place():
    text = '"""What it is."""\nclass A:\n    """Whether."""\n    def f(self):\n        """How.\n\n        So."""\n'
    assert sorted(questions(text)) == ["How.", "What it is.", "Whether."]
    assert questions('"""Whatever it is."""\nx = 1\n"""What x is."""\n') == ["What x is."]

"""Pages about the thesis say what the record of the complete study says, and the tests that they name exist."""

from __future__ import annotations

import importlib.util
import json
import re
from itertools import zip_longest
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]

NUMBER = re.compile(r"[−-]?\d+(?:\.\d+)?(?: · 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")

ROUNDING = 1e-5
"""Numbers below it are sizes of rounding or of difference quotients, which differ between machines."""

PLACE = 0.02
"""Relative difference of two numbers with few digits that are rounded from nearly the same number."""


@pytest.fixture(scope="module")
def results() -> ModuleType:
    spec = importlib.util.spec_from_file_location("results", ROOT / "docs" / "extensions" / "thesis_results.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def value(token: str) -> float:
    base, _, exponent = token.replace("−", "-").partition(" · 10")
    return float(base) * 10.0 ** float(exponent.translate(SUPERSCRIPTS) or 0.0)


def differences(text: str, expected: str) -> list[tuple[str, str]]:
    """Words that differ, and numbers that differ by more than rounding."""
    found: list[tuple[str, str]] = []
    words, others = NUMBER.sub("#", text), NUMBER.sub("#", expected)
    if words != others:
        found.append((words, others))
    for have, want in zip_longest(NUMBER.findall(text), NUMBER.findall(expected), fillvalue="nan"):
        a, b = value(have), value(want)
        last = 1.0000001 * 10.0 ** -len(want.partition(" ")[0].partition(".")[2])
        if " · " in want:
            last = 0.0
        alike = abs(a - b) <= max(PLACE * abs(b), last if abs(b) >= ROUNDING else 0.0)
        if not alike and max(abs(a), abs(b)) >= ROUNDING:
            found.append((have, want))
    return found


@pytest.mark.parametrize("page", ["thesis.md", "theory/errata.md"])
def test_pages_say_what_the_record_says(results: ModuleType, page: str):
    record = json.loads(results.RECORD.read_text(encoding="utf-8"))
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert len(results.PART.findall(text)) == len(results.PARTS[page])
    expected = results.written(page, text, record)
    told = [match[2] for match in results.PART.findall(text)]
    wanted = [match[2] for match in results.PART.findall(expected)]
    hint = f"stale: docs/{page}; python docs/extensions/thesis_results.py"
    assert [differences(*pair) for pair in zip(told, wanted, strict=True)] == [[] for _ in told], hint


def test_a_wrong_number_is_found():
    assert differences("an error of 0.38 W", "an error of 0.40 W") != []
    assert differences("an error of 3 · 10⁻⁷ W", "an error of 5 · 10⁻⁷ W") == []
    assert differences("0.374 and 77.0", "0.375 and 77.0") == []
    assert differences("0.374 and 77", "0.374") != []


def test_tests_of_the_examiners_list_exist():
    text = (ROOT / "docs" / "thesis.md").read_text(encoding="utf-8").split("## An examiner's list")[1]
    rows = re.findall(r"^\| (\d+) \| .* \| ([✓–]) \| (.+) \|$", text, re.MULTILINE)
    assert [int(number) for number, _, _ in rows] == list(range(1, 87))
    for number, _, shown in rows:
        assert shown.strip(), number
        for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", shown):
            assert (ROOT / path).is_file(), (number, path)
            assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), (number, name)

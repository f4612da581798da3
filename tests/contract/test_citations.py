"""Every source cited is in docs/references.bib, and every entry there is cited."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
BIBLIOGRAPHY = (ROOT / "docs" / "references.bib").read_text()

KEY = r"[A-Z][A-Za-z]+\d{4}[a-z]?"
CITATION = re.compile(rf"\[({KEY}(?:, [^\[\]]*)?(?:; {KEY}(?:, [^\[\]]*)?)*)\]")
"""A key, perhaps with a place as in a section or page; several are parted by semicolons."""

NO_YEAR = re.compile(r"(?<![\w])\[([A-Z][a-z]{3,}) ?(?:\d\d)?\](?![(\[:.])")
"""Text that looks like a citation but is not a key. A bracket before a parenthesis is a link, after a name a type."""

ENTRY = re.compile(r"^@(\w+)\{([^,]+),\n(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", re.MULTILINE)


def cited() -> dict[str, set[str]]:
    """Files in which each key occurs."""
    found: dict[str, set[str]] = {}
    for folder, suffixes in (("src", (".py", ".pyi", ".toml")), ("native", (".hpp", ".cpp")), ("docs", (".md",))):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in suffixes:
                for citation in CITATION.findall(path.read_text()):
                    for part in citation.split("; "):
                        found.setdefault(part.split(",")[0], set()).add(str(path.relative_to(ROOT)))
    return found


def entries() -> dict[str, dict[str, str]]:
    return {key: dict(FIELD.findall(body)) for _, key, body in ENTRY.findall(BIBLIOGRAPHY)}


def test_citations_resolve():
    known = entries()
    assert {key: files for key, files in cited().items() if key not in known} == {}


def test_no_entry_is_idle():
    assert set(entries()) - set(cited()) == set()


def test_entries_are_whole():
    assert len(entries()) == BIBLIOGRAPHY.count("\n@") + BIBLIOGRAPHY.startswith("@")
    for key, entry in entries().items():
        assert {"author", "title", "year"} <= set(entry), key
        assert {"journal", "booktitle", "publisher", "school"} & set(entry), key
        surname = re.sub(r"[^A-Za-z]", "", entry["author"].split(",")[0])
        assert re.fullmatch(rf"{surname}{entry['year']}[a-z]?", key), key


def test_citations_have_a_year():
    """A name in brackets without a year points nowhere. Only prose is looked at: docstrings and comments."""
    loose = {}
    for path in [*(ROOT / "src").rglob("*.py"), *(ROOT / "native").iterdir()]:
        text = path.read_text()
        prose = re.findall(r'"""(.*?)"""', text, re.DOTALL) + re.findall(r"(?:#|//) (.*)", text)
        names = [name for part in prose for name in NO_YEAR.findall(part)]
        if names:
            loose[str(path.relative_to(ROOT))] = names
    assert loose == {}

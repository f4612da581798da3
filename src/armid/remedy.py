"""Remedies of findings and errors: a sentence, lines of a study, or a sentence that quotes such lines."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from armid.text_stored_value import TextValue
from armid.toml_writing import toml_line

NOTE = "  # "
"""Beginning of the comment that follows the lines of a study."""

TABLE = re.compile(r"in \[(\w+)\](?:: (.*))?")
"""Pattern of a comment that names the table of the study to which the lines belong; more text may follow."""

ASSIGNMENT = re.compile(r'\b[a-z_]+ = (?:"[^"]*"|[-+.\de]*\d|\[[^\[\]]*\]|\{[^{}]*\})')
"""Pattern of a key of a study with its value, within a sentence."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """Key of a study with its value.

    Attributes:
        text: The line of the study.
        keys: The key and its value.
    """

    text: str
    keys: Mapping[str, Any]


def setting(key: str, value: Any) -> Assignment:
    """Makes a key of a study with its value, in the syntax of TOML."""
    return Assignment(toml_line(key, value), {key: value})


class Remedy(str, TextValue):
    """Action to take: a string that also stores the settings of a study that its text contains.

    Attributes:
        parts: Sentences and settings, in their order; a remedy of lines of a study consists of settings only.
        note: Comment after the lines of a study.
        table: Table of the study to which the lines belong, if it is not `[[recording]]`.
        judged: True if the remedy was tested on motion that was left out of the fit, and the finding states the
            result of this test.
    """

    __slots__ = ("judged", "note", "parts", "table")

    parts: tuple[str | Assignment, ...]
    note: str
    table: str
    judged: bool

    def __new__(cls, *parts: str | Assignment, note: str = "", table: str = "", judged: bool = False) -> Remedy:
        """Makes a remedy from its sentences and settings."""
        texts = [part.text if isinstance(part, Assignment) else str(part) for part in parts]
        lines = all(isinstance(part, Assignment) for part in parts)
        remedy = super().__new__(cls, ("\n" if lines else "").join(texts) + _comment(note, table))
        remedy.parts, remedy.note, remedy.table, remedy.judged = parts, note, table, judged
        return remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """Function and arguments with which `copy` and `pickle` make an equal remedy."""
        return _remedy, (self.parts, self.note, self.table, self.judged)

    @classmethod
    def read(cls, text: str) -> Remedy:
        """Restores a remedy from its text, which is stored with a finding."""
        if isinstance(text, Remedy):
            return text
        code, _, note = text.partition(NOTE)
        if _keys(text):
            lines = [Assignment(line, _keys(line)) for line in code.splitlines()]
            table = TABLE.fullmatch(note)
            return cls(*lines, note=note) if table is None else cls(*lines, note=table[2] or "", table=table[1])
        parts: list[str | Assignment] = []
        at = 0
        for found in ASSIGNMENT.finditer(text):
            if keys := _keys(found[0]):
                parts += [text[at : found.start()], Assignment(found[0], keys)]
                at = found.end()
        return cls(*parts, text[at:])

    @classmethod
    def joined(cls, remedies: Iterable[str]) -> Remedy:
        """Joins several remedies into one; of equal remedies, only the first is used."""
        every = list(dict.fromkeys(remedies))
        if len(every) == 1:
            return cls.read(every[0])
        parts: list[str | Assignment] = []
        for each in map(cls.read, every):
            parts += [*(["; "] if parts else []), *each.parts, _comment(each.note, each.table)]
        return cls(*parts)

    @property
    def keys(self) -> dict[str, Any]:
        """Keys of a study that the remedy sets, with their values; empty if the remedy contains sentences."""
        keys: dict[str, Any] = {}
        for part in self.parts:
            if not isinstance(part, Assignment):
                return {}
            keys |= part.keys
        return keys

    def marked(self) -> Remedy:
        """Copy of the remedy with `judged` set to true."""
        return Remedy(*self.parts, note=self.note, table=self.table, judged=True)


def _remedy(parts: tuple[str | Assignment, ...], note: str, table: str, judged: bool) -> Remedy:
    return Remedy(*parts, note=note, table=table, judged=judged)


def _comment(note: str, table: str) -> str:
    comment = ": ".join(part for part in (f"in [{table}]" if table else "", note) if part)
    return NOTE + comment if comment else ""


def _keys(text: str) -> dict[str, Any]:
    """Keys and values of a text in TOML; empty if the text is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return {}

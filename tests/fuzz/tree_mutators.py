"""Mutators of JSON, TOML and XML: keys and elements removed, renamed, doubled, nested, or of a wrong type."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ET
from typing import Any

from byte_mutators import NUMBER, WORDS, damage_bytes, damage_text, replace_one
from numpy.random import Generator

VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1e308,
    -1e308,
    1e-9,
    1e-300,
    float("nan"),
    float("inf"),
    10**30,
    2**63,
    "",
    "x",
    "nan",
    "1e308",
    [],
    {},
    [[]],
    [None],
    [float("nan")] * 3,
    [1, "a"],
    {"a": {}},
    "../../../etc/passwd",
    "\u0000",
    "é" * 300,
    [[1.0, 2.0]],
    [0.0] * 1000,
    "<script>alert(1)</script>",
    -5,
    1e9,
    1_000_000_000,
)
"""Values that replace a value of a record."""


def damage_record(record: Any, rng: Generator) -> Any:
    """Record (of dictionaries and lists) with one fault."""
    copied = copy.deepcopy(record)
    parent, key = _pick(copied, rng)
    if parent is None:
        return VALUES[int(rng.integers(len(VALUES)))]
    if not rng.integers(8):
        del parent[key]
    elif not rng.integers(8) and isinstance(parent, dict):
        parent[f"{key}_"] = parent.pop(key)
    else:
        parent[key] = _other_value(parent[key], rng)
    return copied


def _other_value(value: Any, rng: Generator) -> Any:
    """Value of another type, length or size, in place of a value of a record."""
    kind = rng.integers(6)
    if kind == 0:
        for _ in range(int(rng.choice([1, 3, 60, 900]))):
            value = [value] if rng.integers(2) else {"a": value}
        return value
    if kind == 1 and isinstance(value, list):
        return value[:-1] if rng.integers(2) else value + value
    if kind == 1 and isinstance(value, str):
        return f"{value}x"
    if kind == 1 and isinstance(value, int | float):
        return value * float(rng.choice([-1.0, 1e6, 1e-9, 1e12, 0.0]))
    return VALUES[int(rng.integers(len(VALUES)))]


def damage_json(text: str, rng: Generator) -> bytes:
    """JSON text with one fault in its record, in its text or in its bytes."""
    kind = rng.integers(8)
    if kind == 0:
        return damage_bytes(text.encode(), rng)
    if kind == 1:
        return damage_text(text, rng).encode("utf-8", "replace")
    if kind == 2 and not rng.integers(3):
        return b"[" * 100_000
    return json.dumps(damage_record(json.loads(text), rng)).encode()


NUMBERS = ("0", "1", "-1", "2", "1e-9", "1e9", "1e15", "1e300", "-1e300", "1e-300", "0.5", "1000000", "nan")
"""Numbers that replace numbers, most of them of the right type."""

ASSIGNMENT = re.compile(r"(?m)^(\s*)([\w.-]+)(\s*=\s*)(.*)$")
TOML_VALUES = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1",
    "0",
    "1e-9",
    "true",
    '""',
    '"x"',
    "[]",
    "{}",
    "[[]]",
    "[nan]",
    '[1, "a"]',
    "2026-01-01",
    "12:00:00",
    "9223372036854775807",
    "99999999999999999999",
    '"\\u0000"',
    '"/dev/zero"',
    '"/"',
    '"."',
    '"../.."',
    "{ a = 1 }",
    "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
    '["x"]',
    '"' + "y" * 300 + '"',
    "[" * 2000 + "]" * 2000,
    "[1, 2]",
    "[[1.0, 0.0], [0.0, 1.0]]",
    "[[[1.0]]]",
    "1_000_000_000",
    "-0.0",
    "'''\n'''",
    "[[1e308, 1e308, 1e308]]",
    '"none"',
    '"<script>"',
    "[1e308]",
    "[-1, -1, -1]",
)


def damage_toml(text: str, rng: Generator) -> bytes:
    """TOML text with one fault in a key, a value, a table or the text."""
    kind = rng.integers(16)
    hits = list(ASSIGNMENT.finditer(text))
    if kind == 0 or not hits:
        return damage_bytes(text.encode(), rng)
    if kind == 1:
        return damage_text(text, rng).encode("utf-8", "replace")
    hit = hits[int(rng.integers(len(hits)))]
    space, key, equals, value = hit.groups()
    changed = {
        2: "",
        3: f"{space}{key}x{equals}{value}",
        4: f"{hit[0]}\n{hit[0]}",
        5: f"{space}{key}.a{equals}{value}",
        6: f"{space}[{key}]\na{equals}{value}",
        7: f"{space}{key}{equals}{replace_one(NUMBER, value, NUMBERS[int(rng.integers(len(NUMBERS)))], rng)}",
        8: f"{space}{key}{equals}{replace_one(NUMBER, value, NUMBERS[int(rng.integers(len(NUMBERS)))], rng)}",
        9: f"{space}{key}{equals}{NUMBER.sub(NUMBERS[int(rng.integers(len(NUMBERS)))], value)}",
        10: f"{space}{key}{equals}{NUMBER.sub(NUMBERS[int(rng.integers(len(NUMBERS)))], value)}",
    }.get(int(kind), f"{space}{key}{equals}{TOML_VALUES[int(rng.integers(len(TOML_VALUES)))]}")
    return (text[: hit.start()] + changed + text[hit.end() :]).encode()


def damage_xml(text: str, rng: Generator) -> bytes:
    """XML text with one fault in an attribute, an element or the text."""
    kind = rng.integers(12)
    if kind == 0:
        return damage_bytes(text.encode(), rng)
    if kind == 1:
        return damage_text(text, rng).encode("utf-8", "replace")
    if kind == 2 and not rng.integers(3):
        return b"<robot>" * 50_000 + b"</robot>" * 50_000
    root = ET.fromstring(text)
    if kind < 6:
        _damage_element(root, rng)
    else:
        _damage_attribute(root, rng)
    return _as_text(root)


def _damage_element(root: ET.Element, rng: Generator) -> None:
    """Removes, doubles, nests or renames an element."""
    parents = [(parent, child) for parent in root.iter() for child in parent]
    parent, child = parents[int(rng.integers(len(parents)))]
    kind = rng.integers(4)
    if kind == 0:
        parent.remove(child)
    elif kind == 1:
        parent.append(copy.deepcopy(child))
    elif kind == 2:
        copied = copy.deepcopy(child)
        for _ in range(int(rng.choice([1, 50, 3000]))):
            outer = ET.Element(child.tag, child.attrib)
            outer.append(copied)
            copied = outer
        parent.append(copied)
    else:
        child.tag = str(rng.choice(["x", "link", "joint", "inertial", "body", "include", "mesh"]))


def _damage_attribute(root: ET.Element, rng: Generator) -> None:
    """Removes an attribute, or replaces it or a word of it."""
    named = [element for element in root.iter() if element.attrib]
    element = named[int(rng.integers(len(named)))]
    key = list(element.attrib)[int(rng.integers(len(element.attrib)))]
    word = "".join(c for c in WORDS[int(rng.integers(len(WORDS)))] if c in "\t\n\r" or ord(c) >= 32)
    kind = rng.integers(5)
    if kind == 0:
        del element.attrib[key]
    elif kind == 1:
        words = element.attrib[key].split() or [""]
        words[int(rng.integers(len(words)))] = word
        element.attrib[key] = " ".join(words)
    elif kind == 2:
        other = named[int(rng.integers(len(named)))]
        element.attrib[key] = next(iter(other.attrib.values()))
    else:
        element.attrib[key] = word


def _as_text(root: ET.Element) -> bytes:
    """XML of an element; elements that are nested deeper than the recursion of the library are written by hand."""
    try:
        return ET.tostring(root)
    except RecursionError:
        return b"<robot>" * 5000 + b"</robot>" * 5000


def _pick(record: Any, rng: Generator) -> tuple[Any, Any]:
    """Container and key of a random value; walks down, so that values near the root are not rare."""
    parent: Any = None
    key: Any = None
    here = record
    while isinstance(here, dict | list) and here and (parent is None or rng.integers(4)):
        parent, key = (
            here,
            list(here)[int(rng.integers(len(here)))] if isinstance(here, dict) else int(rng.integers(len(here))),
        )
        here = parent[key]
    return parent, key

"""Writing of TOML: tables, arrays of tables, and values on one line each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def to_toml(record: Mapping[str, Any]) -> str:
    """TOML text of named tables; a list of tables becomes an array of tables.

    `None`, empty lists and empty tables are left out. Empty texts are kept, because an empty name of a channel means
    that the channel is not used.
    """
    parts: list[str] = []
    for name, table in record.items():
        for each in table if isinstance(table, list) else [table]:
            head = f"[[{name}]]" if isinstance(table, list) else f"[{name}]"
            parts.append("\n".join([head, *(toml_line(k, v) for k, v in each.items() if not _idle(v))]))
    return "\n\n".join(parts) + "\n"


def toml_line(key: str, value: Any) -> str:
    """Line of TOML with one key and its value."""
    return f"{_key(key)} = {_value(value)}"


def _idle(value: Any) -> bool:
    return value is None or (isinstance(value, list | dict) and not value)


def _key(key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if plain else json.dumps(key, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(str(k))} = {_value(v)}" for k, v in value.items() if not _idle(v)) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(each) for each in value)}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)

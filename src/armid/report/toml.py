"""A record as TOML: tables, arrays of tables, and plain values on one line each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

__all__ = ["to_toml"]


def to_toml(record: Mapping[str, Any]) -> str:
    """TOML of tables by name; a list of tables becomes an array of tables. What is null or empty is left out."""
    parts: list[str] = []
    for name, table in record.items():
        for each in table if isinstance(table, list) else [table]:
            head = f"[[{name}]]" if isinstance(table, list) else f"[{name}]"
            parts.append("\n".join([head, *(f"{_key(k)} = {_value(v)}" for k, v in each.items() if not _idle(v))]))
    return "\n\n".join(parts) + "\n"


def _idle(value: Any) -> bool:
    return value is None or (isinstance(value, list | dict | str) and not value)


def _key(key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if plain else json.dumps(key, ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(str(k))} = {_value(v)}" for k, v in value.items() if not _idle(v)) + " }"
    if isinstance(value, list):
        return f"[{', '.join(_value(each) for each in value)}]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)

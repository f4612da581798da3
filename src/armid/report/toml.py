"""A record as TOML: tables, arrays of tables, and plain values on one line each; a run's study as one that runs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

__all__ = ["study_to_toml", "to_toml"]


def to_toml(record: Mapping[str, Any]) -> str:
    """TOML of tables by name; a list of tables becomes an array of tables.

    What is null or empty is left out; an empty text is not: as the name of a channel it leaves that one out.
    """
    parts: list[str] = []
    for name, table in record.items():
        for each in table if isinstance(table, list) else [table]:
            head = f"[[{name}]]" if isinstance(table, list) else f"[{name}]"
            parts.append("\n".join([head, *(f"{_key(k)} = {_value(v)}" for k, v in each.items() if not _idle(v))]))
    return "\n\n".join(parts) + "\n"


def study_to_toml(study: Mapping[str, Any]) -> str:
    """The `study.toml` that says what a run's study came to: read in the study's folder it is that study again.

    Args:
        study: The record `study.json` of a run.
    """
    estimation = study["estimation"]
    options = {f"estimation.{name}": table for name, table in estimation["options"].items() if table}
    recordings = [
        {**{key: value for key, value in each.items() if key != "reading"}, **each["reading"]}
        for each in study["recordings"]
    ]
    tables = {
        "robot": study["robot"],
        "model": {"terms": study["model"]["terms"], **study["model"]["shapes"]},
        "recording": recordings,
        "processing": study["processing"],
        "estimation": {key: value for key, value in estimation.items() if key != "options"},
    }
    return to_toml({**tables, **options})


def _idle(value: Any) -> bool:
    return value is None or (isinstance(value, list | dict) and not value)


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

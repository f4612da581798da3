"""A run's study as a `study.toml` that runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armid.toml import to_toml

__all__ = ["study_to_toml"]


def study_to_toml(study: Mapping[str, Any]) -> str:
    """Text of a `study.toml` with all values of a run's study; read in the study's folder, it gives the same study.

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

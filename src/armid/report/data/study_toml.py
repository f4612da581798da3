"""Conversion of the study of a run to a complete `study.toml`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armid.study.config import Study
from armid.study.storage.records import plain, study_record
from armid.toml_writing import to_toml


def study_to_toml(study: Study) -> str:
    """Text of a `study.toml` with all values of the study of a run.

    If the text is read in the folder of the study, it gives the same study.

    Args:
        study: The resolved study of a run.
    """
    record = plain(study_record(study))
    estimation = record["estimation"]
    options = {f"estimation.{name}": table for name, table in estimation["options"].items() if table}
    tables = {
        "robot": record["robot"],
        "model": {"terms": record["model"]["terms"], **record["model"]["shapes"]},
        "recording": _recordings(record),
        "processing": record["processing"],
        "estimation": {key: value for key, value in estimation.items() if key != "options"},
    }
    return to_toml({**tables, **options})


def servo_study_to_toml(study: Study) -> str:
    """Text of a `study.toml` for `armid servo`, with all values that it uses.

    Args:
        study: The study of a servo result.
    """
    record = plain(study_record(study))
    return to_toml({"robot": record["robot"], "recording": _recordings(record), "servo": record["servo"]})


def _recordings(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Tables `[[recording]]` of the record of a study, in which the log format is not a table of its own."""
    return [
        {**{key: value for key, value in each.items() if key != "reading"}, **each["reading"]}
        for each in record["recordings"]
    ]

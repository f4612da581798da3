"""Conversion of the study of a run to a complete `study.toml`."""

from __future__ import annotations

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
    recordings = [
        {**{key: value for key, value in each.items() if key != "reading"}, **each["reading"]}
        for each in record["recordings"]
    ]
    tables = {
        "robot": record["robot"],
        "model": {"terms": record["model"]["terms"], **record["model"]["shapes"]},
        "recording": recordings,
        "processing": record["processing"],
        "estimation": {key: value for key, value in estimation.items() if key != "options"},
    }
    return to_toml({**tables, **options})

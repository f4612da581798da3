"""What a finding's remedy says: to a study, and to somebody who came with a robot and recordings alone."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from armid.errors import StudyError
from armid.measurement.reading import Reading
from armid.measurement.remedy import BY_HAND
from armid.study.study import EstimationChoice, ModelChoice, RobotChoice, Study
from armid.toml import to_toml

__all__ = ["applied", "as_option", "as_study", "tables_of"]

TABLES: Mapping[str, type] = {
    "robot": RobotChoice,
    "model": ModelChoice,
    "recording": Reading,
    "estimation": EstimationChoice,
}
"""Tables by the values that they make; what none of them knows belongs to the processing."""

OPTIONS = ("rate", "units", "period", "torque_sign", "gravity", "terms")
"""Keys that `armid doctor` has options for."""


def tables_of(remedy: str) -> dict[str, dict[str, Any]]:
    """A remedy's keys by the table of the study that they belong to; none where it is to be done by hand.

    Raises:
        StudyError: It is neither.
    """
    if not remedy or remedy.startswith(BY_HAND):
        return {}
    try:
        keys = tomllib.loads(remedy)
    except tomllib.TOMLDecodeError as error:
        raise StudyError(
            f"The remedy {remedy!r} is no line of a study: {error}.", remedy="write it by hand."
        ) from error
    found: dict[str, dict[str, Any]] = {}
    for key, value in keys.items():
        homes = [name for name, kind in TABLES.items() if key in {f.name for f in dataclasses.fields(kind)}]
        found.setdefault(homes[0] if homes else "processing", {})[key] = value
    return found


def applied(study: Study, path: str, remedy: str) -> Study:
    """The study with a remedy for one of its recordings.

    Args:
        study: The study.
        path: The recording that the remedy is for.
        remedy: As a finding has it.
    """
    tables = tables_of(remedy)
    how = tables.pop("recording", {})
    recordings = tuple(
        replace(each, reading=replace(each.reading, **how)) if each.path == path else each
        for each in study.recordings
    )
    others = {name: replace(getattr(study, name), **keys) for name, keys in tables.items()}
    return replace(study, recordings=recordings, **others)


def as_option(remedy: str) -> str | None:
    """The options of the command line that say the same, or `None` where there are none."""
    said: list[str] = []
    for keys in tables_of(remedy).values():
        for key, value in keys.items():
            if key not in OPTIONS or (isinstance(value, list) and key not in ("gravity", "terms")):
                return None
            parts = [",".join(value)] if key == "terms" else value if key == "gravity" else [value]
            said.append(" ".join([f"--{key.replace('_', '-')}", *(_number(part) for part in parts)]))
    return " ".join(said) or None


def as_study(remedy: str, study: Study, path: str, reading: Mapping[str, Any]) -> str:
    """A whole study that says it.

    Args:
        remedy: As a finding has it.
        study: Of the command line: its arm and terms.
        path: The recording.
        reading: What the command line says of it.
    """
    tables = tables_of(remedy)
    arm = {key: value for key, value in dataclasses.asdict(study.robot).items() if value not in (None, (), {})}
    whole: dict[str, Any] = {"robot": {**arm, **tables.pop("robot", {})}}
    whole["model"] = {"terms": list(study.model.terms), **tables.pop("model", {})}
    whole["recording"] = [{"path": path, **reading, **tables.pop("recording", {})}]
    return to_toml({**{name: table for name, table in whole.items() if table != {"terms": []}}, **tables}).rstrip()


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)

"""Remedies of findings as lines of a study and as options of the command line."""

from __future__ import annotations

import dataclasses
import re
import shlex
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from armid.errors import StudyError
from armid.measurement.log_format import LogFormat
from armid.measurement.remedy import BY_HAND
from armid.study.config import EstimationChoice, ModelChoice, RobotChoice, Study
from armid.toml import to_toml

__all__ = ["OF_READING", "OPTIONS", "applied", "as_option", "as_study", "at_the_prompt", "tables_of"]

TABLES: Mapping[str, type] = {
    "robot": RobotChoice,
    "model": ModelChoice,
    "recording": LogFormat,
    "estimation": EstimationChoice,
}
"""Classes of the tables of a study; keys of none of them belong to `[processing]`."""

OF_READING = ("rate", "time_unit", "columns", "units", "period", "torque_sign")
OPTIONS = (*OF_READING, "gravity", "terms", "cutoff", "edges", "slow", "standstill", "method")
"""Keys that commands have options for, under the same names."""

ASSIGNMENT = re.compile(r'\b([a-z_]+) = ("[^"]*"|[-+.\de]*\d|\[[^\[\]]*\]|\{[^{}]*\})')
"""A key of a study with its value, within a sentence."""


def tables_of(remedy: str) -> dict[str, dict[str, Any]]:
    """Keys of a remedy by table of the study; none where it is to be done by hand.

    Raises:
        StudyError: The remedy is neither lines of a study nor work by hand.
    """
    if not remedy or remedy.startswith(BY_HAND):
        return {}
    try:
        keys = tomllib.loads(remedy)
    except tomllib.TOMLDecodeError as error:
        raise StudyError(
            f"The remedy {remedy!r} is no line of a study: {error}.", remedy="write it by hand."
        ) from error
    tables: dict[str, dict[str, Any]] = {}
    for key, value in keys.items():
        owners = [name for name, kind in TABLES.items() if key in {f.name for f in dataclasses.fields(kind)}]
        tables.setdefault(owners[0] if owners else "processing", {})[key] = value
    return tables


def applied(study: Study, path: str, remedy: str) -> Study:
    """The study with a remedy applied to one of its recordings.

    Args:
        study: The study.
        path: The recording that the remedy is for.
        remedy: Remedy of a finding.
    """
    tables = tables_of(remedy)
    how = tables.pop("recording", {})
    recordings = tuple(
        replace(each, reading=replace(each.reading, **how)) if each.path == path else each
        for each in study.recordings
    )
    others = {name: replace(getattr(study, name), **keys) for name, keys in tables.items()}
    return replace(study, recordings=recordings, **others)


def as_option(remedy: str, options: Collection[str] = OPTIONS) -> str | None:
    """Options of the command line for a remedy, or `None` where there are none.

    Args:
        remedy: As a finding has it.
        options: Keys that the command has options for.
    """
    texts: list[str] = []
    for keys in tables_of(remedy).values():
        for key, value in keys.items():
            values = _values(key, value) if key in options else None
            if values is None:
                return None
            texts += [f"--{key.replace('_', '-')} {each}" for each in values]
    return " ".join(texts) or None


def at_the_prompt(remedy: str, options: Collection[str]) -> str:
    """Text of a remedy for the command line: options of the command first, then keys of a study.

    Args:
        remedy: Remedy of a finding or an error.
        options: Keys that the command has options for.
    """
    try:
        whole = bool(tables_of(remedy))
    except StudyError:  # a sentence
        whole = False
    if whole:
        said = as_option(remedy, options)
        lines = "\n".join(["in a study:", remedy]) if "\n" in remedy else f"in a study: {remedy}"
        return lines if said is None else f"{said}; {lines}"

    def option(found: re.Match[str]) -> str:
        try:
            said = as_option(found[0], options)
        except StudyError:
            said = None
        return found[0] if said is None else f"{said} (in a study: {found[0]})"

    return ASSIGNMENT.sub(option, remedy)


def _values(key: str, value: Any) -> list[str] | None:
    """Values of an option, one for each time it is given; `None` where the option cannot express the value."""
    if key == "terms":
        return [",".join(value)]
    if key == "gravity":
        return [" ".join(map(_number, value))]
    if key == "columns":
        named = {name: [each] if isinstance(each, str) else each for name, each in value.items()}
        if any("," in each for names in named.values() for each in names):
            return None
        return [shlex.quote(f"{name}={','.join(names)}") for name, names in named.items()]
    return None if isinstance(value, list | dict) else [_number(value)]


def as_study(remedy: str, study: Study, path: str, reading: Mapping[str, Any]) -> str:
    """Text of a whole study with a remedy applied.

    Args:
        remedy: As a finding has it.
        study: Study made from the command line: its arm and terms.
        path: The recording.
        reading: Log format options of the command line.
    """
    tables = tables_of(remedy)
    arm = {key: value for key, value in dataclasses.asdict(study.robot).items() if value not in (None, (), {})}
    whole: dict[str, Any] = {"robot": {**arm, **tables.pop("robot", {})}}
    whole["model"] = {"terms": list(study.model.terms), **tables.pop("model", {})}
    whole["recording"] = [{"path": path, **reading, **tables.pop("recording", {})}]
    return to_toml({**{name: table for name, table in whole.items() if table != {"terms": []}}, **tables}).rstrip()


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)

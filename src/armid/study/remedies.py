"""Remedies of findings: for a study, and for somebody who came with a robot and recordings alone."""

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
"""Tables by the values that they make; what none of them knows belongs to the processing."""

OF_READING = ("rate", "time_unit", "columns", "units", "period", "torque_sign")
OPTIONS = (*OF_READING, "gravity", "terms", "cutoff", "edges", "slow", "standstill", "method")
"""Keys that commands have options for, under the same names."""

ASSIGNMENT = re.compile(r'\b([a-z_]+) = ("[^"]*"|[-+.\de]*\d|\[[^\[\]]*\]|\{[^{}]*\})')
"""A key of a study with its value, within a sentence."""


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


def as_option(remedy: str, options: Collection[str] = OPTIONS) -> str | None:
    """The options of the command line that say the same, or `None` where there are none.

    Args:
        remedy: As a finding has it.
        options: Keys that the command has options for.
    """
    said: list[str] = []
    for keys in tables_of(remedy).values():
        for key, value in keys.items():
            values = _values(key, value) if key in options else None
            if values is None:
                return None
            said += [f"--{key.replace('_', '-')} {each}" for each in values]
    return " ".join(said) or None


def at_the_prompt(remedy: str, options: Collection[str]) -> str:
    """A remedy for somebody at the command line: the options of the command first, then the keys of a study.

    Args:
        remedy: Of a finding or an error.
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
    """Return what stands behind an option, once for each time it is given; `None` where it cannot say that."""
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

"""Conversion of the remedies of findings to lines of a `study.toml` and to options of the command line."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from armid.measurement.log_format import LogFormat
from armid.model.catalogue import TERMS
from armid.remedy import NOTE, Assignment, Remedy
from armid.study.config import EstimationChoice, ModelChoice, RobotChoice, Study
from armid.toml_writing import to_toml, toml_line

TABLES: Mapping[str, type] = {
    "robot": RobotChoice,
    "model": ModelChoice,
    "recording": LogFormat,
    "estimation": EstimationChoice,
}
"""Classes whose fields are the keys of the tables of a study. The options of a torque term, whose key is the name
of the term, belong to `[model]`; other keys belong to `[processing]`."""

TABLE_KEYS = tuple(field.name for field in dataclasses.fields(LogFormat))
"""Keys of a `[[recording]]` table that describe the log format."""

OF_READING = ("rate", "time_unit", "columns", "units", "period", "torque_sign")
OPTIONS = (*OF_READING, "gravity", "terms", "cutoff", "edges", "slow", "standstill", "method")
"""Keys of a study for which commands have options with the same names."""

READING = "reading"
"""Name of the option `--reading` of commands that read new recordings for a run; it takes any line of a
`[[recording]]` table."""


def tables_of(remedy: str) -> dict[str, dict[str, Any]]:
    """Keys of a study that a remedy sets, by table of the study; empty if the remedy sets no keys."""
    return _by_table(Remedy.read(remedy).keys)


def _by_table(keys: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Sorts keys of a study by the tables to which they belong."""
    tables: dict[str, dict[str, Any]] = {}
    for key, value in keys.items():
        owners = [name for name, kind in TABLES.items() if key in {f.name for f in dataclasses.fields(kind)}]
        owners += ["model"] if key in TERMS else []
        tables.setdefault(owners[0] if owners else "processing", {})[key] = value
    return tables


def applied(study: Study, path: str, remedy: str) -> Study:
    """Study after a remedy for one recording: the keys that the remedy names have the values of the remedy.

    Args:
        study: The study.
        path: Path of the recording to which the remedy applies.
        remedy: Remedy of a finding.
    """
    tables = tables_of(remedy)
    how = tables.pop("recording", {})
    recordings = tuple(
        replace(each, reading=replace(each.reading, **how)) if each.path == path else each
        for each in study.recordings
    )
    shapes = {key: value for key, value in tables.get("model", {}).items() if key in TERMS}
    if shapes:
        plain = {key: value for key, value in tables["model"].items() if key not in TERMS}
        tables["model"] = {**plain, "shapes": {**study.model.shapes, **shapes}}
    others = {name: replace(getattr(study, name), **keys) for name, keys in tables.items()}
    return replace(study, recordings=recordings, **others)


def as_option(remedy: str, options: Collection[str] = OPTIONS) -> str | None:
    """Options of the command line that correspond to a remedy; `None` if no options can express the remedy.

    Args:
        remedy: Remedy of a finding.
        options: Keys for which the command has options.
    """
    return _options(Remedy.read(remedy).keys, options)


def _options(keys: Mapping[str, Any], options: Collection[str]) -> str | None:
    texts: list[str] = []
    for key, value in keys.items():
        values = _values(key, value) if key in options else None
        if values is None and READING in options and key in TABLE_KEYS:
            texts.append(f"--{READING} {shlex.quote(toml_line(key, value))}")
            continue
        if values is None:
            return None
        texts += [f"--{key.replace('_', '-')} {each}" for each in values]
    return " ".join(texts) or None


def at_the_prompt(remedy: str, options: Collection[str]) -> str:
    """Text of a remedy for the command line: options of the command first, then keys of a study.

    Args:
        remedy: Remedy of a finding or an error.
        options: Keys for which the command has options.
    """
    if not isinstance(remedy, Remedy):
        return remedy
    if remedy.keys:
        option = as_option(remedy, options)
        lines = f"in a study:{chr(10) if len(remedy.parts) > 1 else ' '}{remedy}"
        if option is not None and READING in options:  # such a command takes no study
            return f"{option}; {remedy.note}" if remedy.note else option
        return lines if option is None else f"{option}; {lines}"
    return "".join(part if isinstance(part, str) else _with_option(part, options) for part in remedy.parts)


def _with_option(setting: Assignment, options: Collection[str]) -> str:
    """Text of one setting of a remedy: the option of the command and, in parentheses, the keys of a study."""
    option = _options(setting.keys, options)
    if option is None or READING in options:
        return option or setting.text
    return f"{option} (in a study: {setting.text})"


def _values(key: str, value: Any) -> list[str] | None:
    """Values of an option as texts, one for each use of the option; `None` if an option cannot express the value."""
    if key == "terms":
        return [",".join(value)]
    if key == "gravity":
        return [" ".join(map(_number, value))]
    if key == "columns":
        named = {name: [each] if isinstance(each, str) else each for name, each in value.items()}
        return [shlex.quote(f"{name}={','.join(map(_quoted, names))}") for name, names in named.items()]
    return None if isinstance(value, list | dict) else [_number(value)]


def as_study(remedy: str, study: Study, path: str, reading: Mapping[str, Any]) -> str:
    """Text of a complete study to which a remedy is applied.

    Args:
        remedy: Remedy of a finding.
        study: Study that was made from the command line; its arm and its terms are used.
        path: Path of the recording.
        reading: Log format options of the command line.
    """
    tables = tables_of(remedy)
    arm = {key: value for key, value in dataclasses.asdict(study.robot).items() if value not in (None, (), {})}
    whole: dict[str, Any] = {"robot": {**arm, **tables.pop("robot", {})}}
    whole["model"] = {"terms": list(study.model.terms), **tables.pop("model", {})}
    whole["recording"] = [{"path": path, **reading, **tables.pop("recording", {})}]
    text = to_toml({**{name: table for name, table in whole.items() if table != {"terms": []}}, **tables}).rstrip()
    return _with_note(text, Remedy.read(remedy))


def _with_note(text: str, remedy: Remedy) -> str:
    """Text of a study in which the comment of a remedy stands after the last key that the remedy sets."""
    if not remedy.note or not remedy.keys:
        return text
    last = f"{list(remedy.keys)[-1]} = "
    return "\n".join(f"{line}{NOTE}{remedy.note}" if line.startswith(last) else line for line in text.splitlines())


def _quoted(name: str) -> str:
    """Name of a column in a list with commas, in double quotes if it contains a comma or begins with a quote."""
    doubled = name.replace('"', '""')
    return f'"{doubled}"' if "," in name or name.startswith('"') else name


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)

"""Unique short names of recordings, and texts of findings that contain these names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from armid.errors import Finding
from armid.study.config import RecordingChoice


def labels(choices: Sequence[RecordingChoice]) -> list[str]:
    """Short name of each recording: the shortest unique end of its path; empty for a single recording.

    If a file is listed twice, its role is appended to the name.
    """
    if len(choices) < 2:
        return [""] * len(choices)
    paths = [Path(choice.path) for choice in choices]
    names: list[str] = []
    for k, path in enumerate(paths):
        others = [other.parts for other in paths if other != path]
        count = next((c for c in range(1, len(path.parts)) if all(o[-c:] != path.parts[-c:] for o in others)), None)
        name = str(path) if count is None else str(Path(*path.parts[-count:]))
        names.append(name if paths.count(path) == 1 else f"{name} ({choices[k].role})")
    return names


def labelled(findings: Iterable[Finding], label: str) -> list[Finding]:
    """Findings about one recording, after the name of the recording was put before the evidence of each finding."""
    return [replace(f, evidence=f"{label}: {f.evidence}") if label else f for f in findings]


def together(named: Iterable[tuple[str, Finding]]) -> list[Finding]:
    """Merges findings of several recordings; equal findings become one finding that names all recordings."""
    groups: dict[tuple[str, ...], tuple[Finding, list[str]]] = {}
    for label, f in named:
        key = (f.code, f.severity, f.channel, f.remedy)
        groups.setdefault(key, (f, []))[1].append(label)
    result: list[Finding] = []
    for f, names in groups.values():
        others = list(dict.fromkeys(name for name in names[1:] if name != names[0]))
        same_on = f" The same was found in {', '.join(others)}." if others else ""
        result += labelled([replace(f, evidence=f.evidence + same_on)], names[0])
    return result

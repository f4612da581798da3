"""Names of recordings that tell them apart, and what was found with the name of its recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from armid.errors import Finding
from armid.study.config import RecordingChoice

__all__ = ["labelled", "labels", "together"]


def labels(choices: Sequence[RecordingChoice]) -> list[str]:
    """A short name for each recording: as much of its path's end as no other has; empty where there is one alone.

    A file that stands there twice is told apart by its role.
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
    """The findings with the name of their recording before what was seen."""
    return [replace(f, evidence=f"{label}: {f.evidence}") if label else f for f in findings]


def together(told: Iterable[tuple[str, Finding]]) -> list[Finding]:
    """Findings of several recordings, with their names; what several have alike is told once, of all of them."""
    found: dict[tuple[str, ...], tuple[Finding, list[str]]] = {}
    for label, f in told:
        key = (f.code, f.severity, f.channel, f.remedy)
        found.setdefault(key, (f, []))[1].append(label)
    result: list[Finding] = []
    for f, names in found.values():
        others = list(dict.fromkeys(name for name in names[1:] if name != names[0]))
        more = f" The same on {', '.join(others)}." if others else ""
        result += labelled([replace(f, evidence=f.evidence + more)], names[0])
    return result

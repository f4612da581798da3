"""Findings, as a page says them."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence

from armid.errors import Finding

__all__ = ["evidence_words", "remedy_words", "serious"]

BESIDE = ("bodies-from-visuals", "mesh-missing", "visual-missing")
"""Findings that say nothing of the model; the provenance lists them all."""


def serious(findings: Sequence[Finding], *severities: str) -> list[Finding]:
    """Findings of these severities that speak of the model."""
    return [each for each in findings if each.severity in severities and each.code not in BESIDE]


def evidence_words(finding: Finding) -> str:
    """Return what was seen, and where."""
    return f"{finding.channel}: {finding.evidence}" if finding.channel else finding.evidence


def remedy_words(finding: Finding) -> str:
    """Return what to do, a sentence; code in backticks. A remedy may be lines of a study, with a note behind `#`."""
    remedy = finding.remedy
    if not _is_toml(remedy):
        return remedy[:1].upper() + remedy[1:]
    code, _, note = remedy.partition("  # ")
    lines = " and ".join(f"`{line}`" for line in code.splitlines())
    joint = "" if not note else " " if note.startswith("in [") else ": "
    return f"In the study: {lines}{joint}{note}"


def _is_toml(text: str) -> bool:
    try:
        return bool(tomllib.loads(text))
    except tomllib.TOMLDecodeError:
        return False

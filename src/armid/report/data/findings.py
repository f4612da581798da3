"""Findings as text of the page of a run."""

from __future__ import annotations

from collections.abc import Sequence

from armid.errors import Finding
from armid.remedy import Assignment, Remedy

NOT_ABOUT_MODEL = (
    "bodies-from-visuals",
    "bodies-unknown",
    "markers-unchecked",
    "mesh-missing",
    "shape-unknown",
    "visual-missing",
)
"""Codes of findings that do not concern the model. Only the section about provenance lists these findings."""


def serious(findings: Sequence[Finding], *severities: str) -> list[Finding]:
    """Findings of the given severities that concern the model."""
    return [each for each in findings if each.severity in severities and each.code not in NOT_ABOUT_MODEL]


def evidence_words(finding: Finding) -> str:
    """Evidence of a finding, preceded by the name of the joint or channel, if the finding has one."""
    return f"{finding.channel}: {finding.evidence}" if finding.channel else finding.evidence


def remedy_words(finding: Finding) -> str:
    """Remedy of a finding as a sentence, with lines of a study in backticks and their note in parentheses.

    The lines are at the end, because the page shows long code as a separate block, after which a sentence cannot
    continue.
    """
    remedy = finding.remedy
    if not isinstance(remedy, Remedy) or not remedy.keys:
        return remedy[:1].upper() + remedy[1:]
    lines = "`" + "\n".join(part.text for part in remedy.parts if isinstance(part, Assignment)) + "`"
    where = f"In [{remedy.table}] of the study" if remedy.table else "In the study"
    return f"{where}{f' ({remedy.note})' if remedy.note else ''}: {lines}"

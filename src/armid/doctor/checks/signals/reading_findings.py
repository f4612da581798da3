"""Findings that the readers of recording and description have made already."""

from __future__ import annotations

from armid.doctor.evidence import LogEvidence
from armid.errors import Finding

CODES = (
    "clock-gap",
    "clock-jitter",
    "clock-missing",
    "clock-rate",
    "clock-received",
    "clock-unit",
    "channel-dead",
    "columns-guessed",
    "current-without-gain",
    "degrees",
    "description-rounded",
    "effort-missing",
    "gravity-direction",
    "joints-extra",
    "joints-merged",
    "locked-joint",
    "motor-side",
    "position-offset",
    "position-wrapped",
    "rests-left-out",
    "rows-not-consecutive",
    "rows-repeated",
    "standstill",
    "sticking",
    "topic-chosen",
    "units-of-header",
    "value-missing",
)
"""Codes of these findings; others are about processing, which the doctor checks in its own way."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the findings of these codes, each once."""
    return list(dict.fromkeys(finding for finding in evidence.noted if finding.code in CODES))

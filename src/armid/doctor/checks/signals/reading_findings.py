"""Findings that reading, clock and robot have noticed already, under the codes of the doctor."""

from __future__ import annotations

from armid.doctor.evidence import LogEvidence
from armid.errors import Finding

__all__ = ["CODES", "check"]

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
    "gravity-direction",
    "joints-extra",
    "joints-merged",
    "locked-joint",
    "motor-side",
    "position-offset",
    "position-wrapped",
    "rows-not-consecutive",
    "rows-repeated",
    "standstill",
    "sticking",
    "topic-chosen",
    "units-of-header",
    "value-missing",
)
"""Codes that reading a log may already give; others are about processing, which the doctor does in its own way."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Findings of these codes, each once."""
    found = [finding for finding in evidence.noted if finding.code in CODES]
    return list(dict.fromkeys(found))

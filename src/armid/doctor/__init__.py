"""The doctor: checks of a log for faults before an estimate is made from it.

`armid.doctor.catalogue` lists the checks. A check examines a log and returns findings; it repairs nothing. Some
checks can also explain why a model does not fit the log (`LogCheck.explain`). Each of these checks assumes that its
fault is present, corrects the fault, and computes by how much the residual decreases. The fault with the largest
decrease is accepted. Then the other checks are tried on the log in which this fault is corrected.
"""

from __future__ import annotations

from collections.abc import Collection

from armid.doctor.catalogue import CHECKS
from armid.doctor.check_definition import LogCheck, Scope
from armid.doctor.check_input import Explain, LogEvidence
from armid.doctor.remedy_trial import with_reason
from armid.errors import Finding

__all__ = [
    "CHECKS",
    "SEVERITIES",
    "LogCheck",
    "LogEvidence",
    "checks_of",
    "effects",
    "examine",
    "explanations_of",
]

SEVERITIES = ("error", "warning", "info")
"""Severities of findings, worst first."""

EVERYWHERE: tuple[Scope, ...] = ("recording", "format", "command")


def checks_of(scopes: Collection[Scope]) -> tuple[str, ...]:
    """Names of the checks whose scope is one of the given scopes."""
    return tuple(name for name, check in CHECKS.items() if check.scope in scopes)


def explanations_of(scopes: Collection[Scope] = EVERYWHERE) -> tuple[Explain, ...]:
    """Functions `explain` of the checks with one of the given scopes; those of all checks if no scope is given."""
    return tuple(check.explain for check in CHECKS.values() if check.scope in scopes and check.explain is not None)


def effects() -> dict[str, str]:
    """Effects of faults on an estimate, as text; the keys are the codes of the findings about the faults."""
    return {code: text for check in CHECKS.values() for code, text in check.effects.items()}


def examine(evidence: LogEvidence, checks: Collection[str] | None = None) -> tuple[Finding, ...]:
    """Runs checks on a log and returns their findings: each finding once, errors first.

    Args:
        evidence: The log to check, its log format and the arm.
        checks: Names of the checks that are run; if not given, all checks are run.
    """
    reasons = {code: why for check in CHECKS.values() for code, why in check.untested.items()}
    wanted = [check for name, check in CHECKS.items() if checks is None or name in checks]
    found = [with_reason(f, reasons) for check in wanted for f in check.look(evidence)]
    faults = {f.code for f in found if f.severity != "info"}
    noted = {with_reason(f, reasons) for f in evidence.noted}
    hidden = _consequences(faults)
    reported = [f for f in dict.fromkeys(found) if f.code not in hidden or f in noted]
    return tuple(sorted(reported, key=lambda f: SEVERITIES.index(f.severity)))


def _consequences(faults: Collection[str]) -> set[str]:
    """Codes of the findings that are consequences of the given faults and are therefore not reported."""
    hidden: set[str] = set()
    for name, check in CHECKS.items():
        if name in faults:
            hidden |= set(check.hides)
        if not set(check.follows).isdisjoint(faults):
            hidden |= check.effects.keys()
    return hidden

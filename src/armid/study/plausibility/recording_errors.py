"""Checks of a validation that fail because the recordings, or their processing, have errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from armid.doctor import effects
from armid.doctor.checks.signals.motor_side import CURRENT, MOTOR, UNIT
from armid.errors import Finding
from armid.remedy import Remedy
from armid.study.plausibility.one_sided_filter import CODE as ONE_SIDED
from armid.validation.torque_validation import Check, Validation

RECORDING_ERRORS = "errors in the recordings"
"""Beginning of the names of checks that fail because of errors in the recordings. The code of the finding follows in
parentheses."""

PROCESSING_ERRORS = "errors in the processing"
"""Beginning of the names of checks that fail because of errors in the processing of the recordings. The code of the
finding follows in parentheses."""

GAIN_CODES = (CURRENT, MOTOR, UNIT)
"""Codes of the findings that the torque does not agree with the masses of the description; wrong drive gains are one
possible cause."""


def contradictions(findings: Sequence[Finding]) -> tuple[Check, ...]:
    """Failed checks of the validation, one for each code of findings of severity `error`.

    Args:
        findings: Findings on the recordings and on their processing.
    """
    codes = {*effects(), "recordings-disagree", ONE_SIDED}
    errors = [each.code for each in findings if each.severity == "error" and each.code in codes]
    return tuple(
        Check(recording_error_check(code), float(errors.count(code)), 0.0, False) for code in dict.fromkeys(errors)
    )


def recording_error_check(code: str) -> str:
    """Name of the check that fails if the recordings have findings of severity `error` with a given code.

    Args:
        code: Code of the findings.
    """
    return f"{PROCESSING_ERRORS if code == ONE_SIDED else RECORDING_ERRORS} ({code})"


def contradicted(validation: Validation, findings: Sequence[Finding]) -> Validation:
    """Validation that fails if there is a finding of severity `error` about the recordings.

    Such an error makes most of an estimate wrong. Training and validation recordings with the same fault, such as a
    wrong unit or order of channels, agree with each other, so that the error on held-out motion does not show the
    fault.

    Args:
        validation: Scores, checks and verdict.
        findings: Findings on the recordings.
    """
    checks = contradictions(findings)
    if not checks:
        return validation
    return replace(validation, verdict="fail", checks=(*validation.checks, *checks))


def only_drive_gains_contradict(names: Sequence[str], findings: Sequence[Finding]) -> bool:
    """Tests whether all failed checks are caused by drive gains that contradict the described masses.

    The doctor reports such gains with one of the codes `GAIN_CODES`. A finding with such a code can also have another
    cause, such as positions in encoder counts; it then counts only if its remedy is a drive gain.

    Args:
        names: Names of the failed checks of a validation.
        findings: Findings on the recordings.
    """
    errors = [each for each in findings if each.severity == "error" and each.code in GAIN_CODES]
    return (
        bool(names)
        and {*names} <= {recording_error_check(code) for code in GAIN_CODES}
        and all("drive_gain" in Remedy.read(each.remedy).keys for each in errors)
    )

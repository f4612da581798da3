"""Estimates and validations as JSON objects with stable keys; NaN and infinity become null."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.estimate_record import Estimate, standard_parameters
from armid.estimation.friction.selection import FrictionSelection, SelectionEvidence
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.measurement.log_format import LogFormat
from armid.model.base_formulas import base_formulas, groupings
from armid.study.config import Study
from armid.study.plausibility.recording_errors import contradictions
from armid.validation.left_out_error import LeftOutError
from armid.validation.torque_validation import Validation

LIST_OF_NUMBERS = re.compile(r'\[\n([^][{}"]*?)\n *\]')
"""Pattern of a list of numbers that `json` writes on several lines. Texts never match, because their line ends are
escaped."""


ESTIMATE_KEYS = {
    "robot": "Name of the arm.",
    "method": "Name of the estimator.",
    "terms": "Torque terms of the model: `name`, `joints`, `shapes`.",
    "base_parameters": "Estimated base parameters; the keys of an entry are listed below.",
    "parameters": "Standard parameters of all links and terms, each with its status.",
    "residual": "`rms`: RMS residual of each joint on the training recordings [N·m or N].",
    "condition": "Condition number of the weighted base regressor.",
    "scaled_condition": "Condition number of the weighted base regressor with columns scaled to unit length.",
    "samples": "Number of rows of the joint with the most rows.",
    "rows": "Number of rows of the estimate, for each joint.",
    "covariance": "Covariance of the base parameters: `matrix`, `kind`, the reason `why`, and data on the noise.",
    "certificate": "Proof that an estimate with `--method physical` is consistent, and its prior; otherwise null.",
    "seconds": "Computing time from recordings to result [s].",
    "warnings": "Findings: `code`, `severity`, `channel`, `evidence`, `remedy`, `message`.",
    "made_from": "Role and sha256 of each input, the description of the arm included.",
    "made_by": "Build of the kernel and factorisation that computed the information.",
    "links": "Described and estimated mass, centre of mass and inertia of each link.",
}
"""Meaning of each key of `estimate.json`."""

BASE_PARAMETER_KEYS = {
    "name": "Name of the parameter. If it ends in `[k]`, the value is valid for recording k only.",
    "value": "Estimated value.",
    "unit": "Unit of the value.",
    "deviation": "Standard deviation, in the unit of the value.",
    "relative_deviation_percent": "Standard deviation divided by the absolute value [%].",
    "poorly_identified": "True if the relative deviation is so large that the value is hardly known.",
    "dropped": "True if the method set the parameter to zero.",
    "interval95": "Both ends of the 95 % interval.",
    "formula": "The parameter as a sum of standard parameters, as text.",
    "grouping": "Sum of `formula` as numbers: coefficient of each standard parameter (of a link or term) by name.",
}
"""Meaning of each key of an entry of `base_parameters` in `estimate.json`."""


def estimate_record(estimate: Estimate) -> dict[str, Any]:
    """Content of the file `estimate.json` of a run."""
    fit, ends = estimate.fit, estimate.intervals
    units = dict(zip(estimate.base.names, estimate.base.units, strict=True))
    formulas = dict(zip(estimate.base.names, base_formulas(estimate.base, "text"), strict=True))
    contained = dict(zip(estimate.base.names, groupings(estimate.base), strict=True))
    poor = fit.poorly_identified
    base: list[dict[str, Any]] = []
    for k, name in enumerate(fit.names):
        base.append(
            {
                "name": name,
                "value": fit.values[k],
                "unit": units[name.of_all],
                "deviation": fit.deviation[k],
                "relative_deviation_percent": fit.relative_deviation[k],
                "poorly_identified": bool(poor[k]),
                "dropped": name in fit.dropped,
                "interval95": ends[k],
                "formula": formulas[name.of_all],
                "grouping": contained[name.of_all],
            }
        )
    return {
        "robot": estimate.robot,
        "method": estimate.method,
        "terms": [{"name": t.name, "joints": t.joints, "shapes": t.shapes} for t in estimate.terms],
        "base_parameters": base,
        "parameters": standard_parameters(estimate),
        "residual": {"rms": fit.residual_rms},
        "condition": fit.condition,
        "scaled_condition": fit.scaled_condition,
        "samples": int(fit.rows.max()),
        "rows": fit.rows,
        "covariance": {
            "kind": fit.covariance_kind,
            "why": fit.report.why,
            "parts": fit.report.parts,
            "whiteness": fit.report.whiteness,
            "noise": fit.noise,
            "degrees_of_freedom": fit.freedom,
            "matrix": fit.covariance,
        },
        "certificate": certificate_record(fit.standard),
        "seconds": estimate.seconds,
        "warnings": [finding_record(finding) for finding in estimate.findings],
        "made_from": [str(each) for each in estimate.made_from],
        "made_by": str(estimate.made_by),
    }


def certificate_record(fit: StandardFit | None) -> dict[str, Any] | None:
    """Certificate of a physically consistent estimate, with its prior; `None` for other estimates."""
    if fit is None:
        return None
    return {
        "price": fit.proof.cost_increase,
        "smallest_eigenvalue": fit.proof.smallest_eigenvalue,
        "gap": fit.proof.gap,
        "prior": {"kind": fit.prior.kind, "weight": fit.prior.weight, "how": fit.prior.how},
    }


@dataclass(frozen=True, eq=False, slots=True)
class SelectionSummary:
    """Stored result of a friction selection; the models that were tried are not stored.

    Attributes:
        evidence: Result for every friction law that was tried on a joint (candidate).
        ratio: For each joint, RMS error on held-out motion with the selected terms, divided by the RMS error without
            them, shape (n,).
        deviation: Standard error of the ratio, shape (n,).
        prior_weight: Weight of the prior in independent samples; `None` if it was not determined.
        why: Reason why no candidate was tried, or why the prior has no weight; otherwise empty.
    """

    evidence: tuple[SelectionEvidence, ...]
    ratio: Array
    deviation: Array
    prior_weight: float | None
    why: str

    def chosen(self, joint: str) -> list[str]:
        """Names of the friction laws that were selected for the joint with a given name."""
        return [each.candidate for each in self.evidence if each.chosen and each.joint == joint]


def selection_summary(selection: FrictionSelection) -> SelectionSummary:
    """Converts the result of a friction selection to its stored form, without the models that were tried."""
    return SelectionSummary(
        selection.evidence, selection.ratio, selection.deviation, selection.prior_weight, selection.why
    )


def log_format_record(reading: LogFormat) -> dict[str, Any]:
    """Fields of a log format that have a value, as a dictionary for a JSON file."""
    return {key: value for key, value in dataclasses.asdict(reading).items() if value is not None}


def study_record(study: Study) -> dict[str, Any]:
    """Content of the file `study.json` of a run: the study with automatic choices replaced by their results."""
    record: dict[str, Any] = dataclasses.asdict(study)
    record["folder"] = str(Path(study.folder).resolve())  # independent of the working folder
    for recording, choice in zip(record["recordings"], study.recordings, strict=True):
        recording["reading"] = log_format_record(choice.reading)
    return record


def friction_selection_record(selection: FrictionSelection, joints: Sequence[str]) -> dict[str, Any]:
    """Content of the file `friction.json` of a run: selected friction of each joint, and all laws that were tried."""
    return {
        "why": selection.why,
        "prior_weight": selection.prior_weight,
        "joints": [
            {
                "name": name,
                "ratio": selection.ratio[j],
                "deviation": selection.deviation[j],
                "chosen": selection_summary(selection).chosen(name),
            }
            for j, name in enumerate(joints)
        ],
        "evidence": [
            {
                "joint": each.joint,
                "rung": each.family,
                "candidate": each.candidate,
                "ratio": each.ratio,
                "deviation": each.deviation,
                "chosen": each.chosen,
            }
            for each in selection.evidence
        ],
    }


def finding_record(finding: Finding) -> dict[str, Any]:
    """Finding as a dictionary for a JSON file; the key `message` contains evidence and remedy as one text."""
    where = f"{finding.channel}: " if finding.channel else ""
    message = f"{where}{finding.evidence}" + (f" {finding.remedy}" if finding.remedy else "")
    return {
        "code": finding.code,
        "severity": finding.severity,
        "channel": finding.channel,
        "evidence": finding.evidence,
        "remedy": finding.remedy,
        "message": message,
    }


def judgement_record(findings: Sequence[Finding]) -> dict[str, Any]:
    """Findings and verdict of a run without validation recordings: `fail` if there are errors, else `not judged`."""
    verdict = "fail" if contradictions(findings) else "not judged"
    return {"verdict": verdict, "warnings": [finding_record(finding) for finding in findings]}


def validation_record(validation: Validation) -> dict[str, Any]:
    """Content of the file `validation.json` of a run."""
    return {
        "joints": validation.joints,
        "recordings": [
            {
                "path": each.path,
                "sha256": each.sha256,
                "rms": each.rms,
                "rms_raw": each.rms_raw,
                "relative": each.relative,
                "peak": each.peak,
                "coverage95": each.coverage95,
                "prior_rms": each.prior_rms,
                "offset": each.offset,
                "rms_with_own_offset": each.rms_with_own_offset,
                "share": each.share,
            }
            for each in validation.recordings
        ],
        "verdict": validation.verdict,
        "checks": [{"name": c.name, "value": c.value, "bound": c.bound, "ok": c.ok} for c in validation.checks],
        "left_out": None if validation.left_out is None else left_out_record(validation.left_out),
    }


def left_out_record(error: LeftOutError) -> dict[str, Any]:
    """Record of the torque error on left-out training data, and of the torque error expected on another recording."""
    expected = error.expected
    return {
        "kind": error.kind,
        "rms": error.rms,
        "description_rms": error.description,
        "expected": {"rms": expected.rms, "low": expected.low, "high": expected.high},
    }


def to_json(record: Any) -> str:
    """JSON text with full precision and each list of numbers on one line; NaN and infinity become null."""
    text = json.dumps(plain(record), indent=1, ensure_ascii=False, allow_nan=False)
    return LIST_OF_NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)


def plain(value: Any) -> Any:
    """Converts a record to the types of JSON: lists for arrays and tuples, null for NaN and infinity."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value

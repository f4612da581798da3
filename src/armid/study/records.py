"""Estimates and validations as JSON objects with stable keys; NaN and infinity become null."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from armid.errors import Finding
from armid.estimation.estimate import Estimate, standard_parameters
from armid.estimation.friction.selection import FrictionSelection
from armid.estimation.standard_fit import StandardFit
from armid.model.base_formulas import base_formulas
from armid.validation.prediction import Validation

__all__ = [
    "certificate_record",
    "estimate_record",
    "finding_record",
    "friction_selection_record",
    "to_json",
    "validation_record",
]

LIST_OF_NUMBERS = re.compile(r'\[\n([^][{}"]*?)\n *\]')
"""List of numbers as `json` breaks it into lines. No text matches, since line ends in texts are escaped."""


def estimate_record(estimate: Estimate) -> dict[str, Any]:
    """The contents of `estimate.json`."""
    fit, ends = estimate.fit, estimate.intervals
    units = dict(zip(estimate.base.names, estimate.base.units, strict=True))
    formulas = dict(zip(estimate.base.names, base_formulas(estimate.base, "text"), strict=True))
    poor = fit.poorly_identified
    base: list[dict[str, Any]] = []
    for k, name in enumerate(fit.names):
        plain = name.split("[", 1)[0]
        base.append(
            {
                "name": name,
                "value": fit.values[k],
                "unit": units[plain],
                "deviation": fit.deviation[k],
                "relative_deviation_percent": fit.relative_deviation[k],
                "poorly_identified": bool(poor[k]),
                "dropped": name in fit.dropped,
                "interval95": ends[k],
                "formula": formulas[plain],
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
        "made_from": estimate.made_from,
        "made_by": estimate.made_by,
    }


def certificate_record(fit: StandardFit | None) -> dict[str, Any] | None:
    """Certificate of a consistent estimate with its prior; null without."""
    if fit is None:
        return None
    return {
        "price": fit.proof.price,
        "smallest_eigenvalue": fit.proof.smallest_eigenvalue,
        "gap": fit.proof.gap,
        "prior": {"kind": fit.prior.kind, "weight": fit.prior.weight, "how": fit.prior.how},
    }


def friction_selection_record(selection: FrictionSelection, joints: Sequence[str]) -> dict[str, Any]:
    """The contents of `friction.json`: selected friction of each joint and its evidence."""
    return {
        "why": selection.why,
        "prior_weight": selection.prior_weight,
        "joints": [
            {
                "name": name,
                "ratio": selection.ratio[j],
                "deviation": selection.deviation[j],
                "chosen": [each.candidate for each in selection.evidence if each.chosen and each.joint == name],
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
    """A finding with its evidence and remedy as one message."""
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


def validation_record(validation: Validation) -> dict[str, Any]:
    """The contents of `validation.json`."""
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
            }
            for each in validation.recordings
        ],
        "verdict": validation.verdict,
        "checks": [{"name": c.name, "value": c.value, "bound": c.bound, "ok": c.ok} for c in validation.checks],
    }


def to_json(record: Any) -> str:
    """JSON text with full precision, a list of numbers on one line; NaN and infinity as null."""
    text = json.dumps(_plain(record), indent=1, ensure_ascii=False, allow_nan=False)
    return LIST_OF_NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value

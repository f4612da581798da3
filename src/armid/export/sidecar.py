"""Sidecar file of a written description: the whole model as JSON, also values that descriptions cannot store."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armid.checked_array import Array
from armid.errors import OutputError
from armid.estimation.estimate_record import Estimate, collapse
from armid.export.types import Content
from armid.hashes import digest
from armid.model.base_formulas import base_formulas
from armid.runs.run import Run
from armid.study.storage.records import finding_record

KIND = "armid-model 1"
"""Name of the kind of file, and version of its format; the version is increased if a key changes its meaning."""


def side_record(run: Run, content: Content, theta: Array, data: bytes, name: str, kind: str) -> dict[str, Any]:
    """Content of the sidecar file: the model of a run as a record that can be stored as JSON.

    Args:
        run: The run.
        content: Content of the written description.
        theta: Standard parameters that were written, shape (p,).
        data: Content of the written file.
        name: Name of the written file.
        kind: Kind of the standard parameters: `estimated`, `nearest` or `unphysical`.
    """
    model, estimate = run.model, run.estimate
    return {
        "kind": KIND,
        "robot": model.robot.name,
        "file": {"name": name, "sha256": hashlib.sha256(data).hexdigest()},
        "run": Path(run.folder).name,
        "method": estimate.method,
        "standard_parameters": kind,
        "made_from": [str(each) for each in estimate.made_from],
        "gravity": model.robot.gravity,
        "locked": dict(content.locked),
        "joints": model.robot.joint_names,
        "terms": [{"name": use.name, "joints": use.joints, "shapes": use.shapes} for use in estimate.terms],
        "parameters": _parameters(run, content, theta),
        "base_parameters": _base_parameters(estimate),
        "load_parameters": model.load_parameters,
        "warnings": [finding_record(finding) for finding in estimate.findings],
    }


def origin_line(run: Run) -> str:
    """Line of a written file by which armid recognises an export of this run."""
    return f"Inputs and options: sha256 {digest(*map(str, run.estimate.made_from))}."


def refuse_overwriting(others: Sequence[Path], run: Run) -> None:
    """Refuses to overwrite files that are not an earlier export of this run.

    Args:
        others: Existing files that are not an export of this run.
        run: The run.

    Raises:
        OutputError: `others` is not empty.
    """
    if others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise OutputError(
            f"{others[0]}{more} would be overwritten, but it is not an earlier export of {run.folder}.",
            remedy="choose another place with --out, or remove the existing files.",
        )


def _parameters(run: Run, content: Content, theta: Array) -> list[dict[str, Any]]:
    """Standard parameters with the laws that they belong to.

    `in_file` is true if the description contains the value, too.
    """
    model = run.model
    laws = dict(zip(model.law_columns.tolist(), model.laws, strict=True))
    result: list[dict[str, Any]] = []
    for k, parameter in enumerate(model.parameters):
        record: dict[str, Any] = {
            "name": parameter.name,
            "value": theta[k],
            "unit": parameter.unit,
            "term": parameter.kind,
            "joint": parameter.joint,
            "in_file": True,
        }
        if k in laws:
            _, law = laws[k]
            single = law.coordinate == ((law.joint, 1.0),)
            record["in_file"] = single and parameter.kind in content.joints.get(parameter.joint, {})
            record["torque"] = str(law.expression)
            record["acts_on"] = [{"joint": model.robot.joint_names[j], "weight": w} for j, w in law.coordinate]
            if law.memory is not None:
                record["remembers"] = {"width": law.memory.width}
        result.append(record)
    return result


def _base_parameters(estimate: Estimate) -> list[dict[str, Any]]:
    """Base parameters with their values, units and formulas in terms of standard parameters."""
    base = estimate.base
    values, formulas = collapse(base.names, estimate.fit), base_formulas(base, "text")
    return [
        {"name": name, "value": value, "unit": unit, "formula": formula}
        for name, value, unit, formula in zip(base.names, values, base.units, formulas, strict=True)
    ]

"""Sidecar file: the whole model as JSON, including values that a robot description cannot store."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armid.errors import OutputError
from armid.estimation.estimate import Estimate, collapse
from armid.export.types import Content
from armid.model.base_formulas import base_formulas
from armid.runs.run import Run
from armid.study.records import finding_record
from armid.values import Array

KIND = "armid-model 1"
"""Kind and format number of the file; the number increases when a key changes its meaning."""


def side_record(run: Run, content: Content, theta: Array, data: bytes, name: str, kind: str) -> dict[str, Any]:
    """Model of a run as a JSON record.

    Args:
        run: The run.
        content: Content of the written description.
        theta: Standard parameters (p,) that were written.
        data: The written file.
        name: Its name.
        kind: Kind of the parameters: `estimated`, `nearest` or `unphysical`.
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


def refuse_overwriting(others: Sequence[Path], run: Run) -> None:
    """Check that no file is overwritten that this run's export has not written.

    Args:
        others: Existing files of another origin.
        run: The run.

    Raises:
        OutputError: There is one.
    """
    if others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise OutputError(
            f"{others[0]}{more} would be overwritten, and is not an export of {run.folder}.",
            remedy="name another place with --out, or remove what is there.",
        )


def _parameters(run: Run, content: Content, theta: Array) -> list[dict[str, Any]]:
    """Standard parameters with their laws; `in_file` tells if the description stores them, too."""
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
    """Base parameters with their values and formulas."""
    base = estimate.base
    values, formulas = collapse(base.names, estimate.fit), base_formulas(base, "text")
    return [
        {"name": name, "value": value, "unit": unit, "formula": formula}
        for name, value, unit, formula in zip(base.names, values, base.units, formulas, strict=True)
    ]

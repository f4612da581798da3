"""Export of the model of a run as a robot description; the description is verified before it is written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from armid.codegen.catalogue import LANGUAGES
from armid.errors import Finding, OutputError, did_you_mean
from armid.export.catalogue import EXPORTERS, Exporter
from armid.export.input_digest_check import find_source, unseen_recordings
from armid.export.preparation import ExportChoices, prepare
from armid.export.ros.catalogue import ROS_FILES
from armid.export.sidecar import refuse_overwriting, side_record
from armid.export.types import DescriptionSource
from armid.export.verification import Prediction, verify, without_place
from armid.hashes import sha256_of_file
from armid.output.file_group import replace_files
from armid.runs.run import Run
from armid.study.storage.records import finding_record, to_json
from armid.validation.torque_validation import Check

SIDE = ".armid.json"


@dataclass(frozen=True, eq=False, slots=True)
class Exported:
    """Result of an export.

    Attributes:
        path: Path of the robot description.
        side: Path of the sidecar file, which contains the whole model.
        format: Name of the format.
        edited: Path of the description that was edited to make the file; empty if a new file was written.
        standard: Kind of the standard parameters in the file: `estimated`, `nearest` or `unphysical`.
        checks: Checks of the file after it was read back.
        predictions: Torque errors of the estimate and of the file on validation motion.
        findings: Findings about changes, and about values that the format cannot store.
        files: Paths of all written files, if there are several.
    """

    path: Path
    side: Path
    format: str
    edited: str
    standard: str
    checks: tuple[Check, ...]
    predictions: tuple[Prediction, ...]
    findings: tuple[Finding, ...]
    files: tuple[Path, ...] = ()


def export_run(
    run: Run,
    to: str,
    out: Path | str | None = None,
    *,
    description: Path | str | None = None,
    data: Path | str | None = None,
    **choices: Unpack[ExportChoices],
) -> Exported:
    """Writes the model of a run as a robot description, and a sidecar file with the whole model.

    A description of the same format is edited: identified numbers are replaced, and all other bytes stay unchanged.
    Otherwise a new file is written, whose bodies have no shapes.

    Args:
        run: The run.
        to: Name of the format, one of `armid.export.catalogue.EXPORTERS`.
        out: Path of the file; `None` for a file in the folder of the run.
        description: Path of the description of the run, if it was moved after the identification.
        data: Folder of the recordings of the run, if they were moved after the identification.
        choices: Choices of the content.

    Raises:
        OutputError: A file of another origin exists, the file cannot be written, or its model would be wrong.
    """
    exporter, source = exporter_of(to), find_source(run, description)
    path = Path(out) if out is not None else default_path(run, source, exporter)
    _refuse_target(path, source, None if out is None else run)
    prepared = prepare(run, exporter, source, edits=source.format == to, **choices)
    content, theta, kind, findings = prepared.content, prepared.theta, prepared.kind, prepared.findings
    written = exporter.write(content)
    unseen = unseen_recordings(run, data)
    verified = verify(exporter, written, content, run, theta, unseen, unphysical=prepared.is_unphysical)
    side = _write_both(path, written.data, side_record(run, content, theta, written.data, path.name, kind))
    sidecar_only = findings_on_sidecar(run, exporter, side.name)
    findings = (*findings, *prepared.far, *written.findings, *sidecar_only, *verified.findings)
    edited = "" if content.source is None else source.path
    return Exported(path, side, to, edited, kind, verified.checks, verified.predictions, findings)


def exporter_of(to: str) -> Exporter:
    """Exporter of the format with a given name."""
    if to not in EXPORTERS:
        raise OutputError(
            f"Unknown format {to!r}.",
            possible=", ".join((*EXPORTERS, *ROS_FILES, *LANGUAGES)),
            remedy=did_you_mean(to, (*EXPORTERS, *ROS_FILES, *LANGUAGES)),
        )
    return EXPORTERS[to]


def export_record(exported: Exported) -> dict[str, Any]:
    """Data that `armid export --json` prints for an export as a robot description."""
    return {
        "file": str(exported.path),
        "files": [str(path) for path in exported.files or (exported.path,)],
        "sha256": [sha256_of_file(path) for path in exported.files or (exported.path,)],
        "side": str(exported.side),
        "format": exported.format,
        "edited": exported.edited or None,
        "standard_parameters": exported.standard,
        "checks": [{"name": c.name, "value": c.value, "bound": c.bound, "ok": c.ok} for c in exported.checks],
        "unseen": [{"path": p.path, "rms_estimate": p.estimate, "rms_file": p.file} for p in exported.predictions],
        "findings": [finding_record(finding) for finding in exported.findings],
    }


def default_path(run: Run, source: DescriptionSource, exporter: Exporter) -> Path:
    """Path of the file if the user gives none: in the folder of the run, with the name of description or arm."""
    stem = Path(source.path).stem if source.format != "dh" else run.robot.name
    return Path(run.folder) / (re.sub(r"[^\w.+-]+", "-", stem).strip(".-") + exporter.SUFFIX)


def _refuse_target(path: Path, source: DescriptionSource, run: Run | None) -> None:
    """Refuses to overwrite the description, or a file that is not an export of this run."""
    if any(path.exists() and path.samefile(part) for part in source.files):
        raise OutputError(
            f"The result cannot be written to {path}, because this file is the description or a file that it "
            "includes.",
            remedy="choose another file with --out.",
        )
    if run is not None and not _is_free(path, run):
        refuse_overwriting([path], run)


def _is_free(path: Path, run: Run) -> bool:
    """True if a file does not exist, or if the digests in its sidecar file show that it is an export of this run."""
    if not path.exists():
        return True
    try:
        side = json.loads(path.with_name(f"{path.name}{SIDE}").read_text(encoding="utf-8"))
        return side["made_from"] == [str(each) for each in run.estimate.made_from]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def findings_on_sidecar(run: Run, exporter: Exporter, side: str) -> list[Finding]:
    """Findings about values that the sidecar file contains and the description does not."""
    findings: list[Finding] = []
    for term, names in without_place(run.model, exporter.PLACES).items():
        what = f"the format cannot store {', '.join(names)}; {side} contains them"
        severe = term == "rotor-inertia"
        findings.append(Finding("no-place", "warning" if severe else "info", term, what))
    if any(name.recording for name in run.estimate.fit.names):
        what = "friction was estimated for each recording separately; the file contains the mean over the recordings"
        findings.append(Finding("friction-averaged", "info", "", what))
    for use in run.estimate.terms:
        if use.name == "coulomb" and use.shapes.get("width"):
            width = use.shapes["width"]
            what = (
                f"the model smooths Coulomb friction over a velocity of {width} rad/s (m/s); the file contains only "
                "its magnitude"
            )
            findings.append(Finding("no-place", "info", use.name, what))
    return findings


def _write_both(path: Path, data: bytes, record: Mapping[str, Any]) -> Path:
    """Writes the description and the sidecar file, or neither of them; returns the path of the sidecar file."""
    side = f"{path.name}{SIDE}"
    return replace_files(path.parent, {path.name: data, side: to_json(record) + "\n"})[1]

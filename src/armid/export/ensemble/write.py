"""Export of an ensemble: robot descriptions of possible arms, for domain randomisation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from armid.atomic_file import replace_file
from armid.errors import Finding
from armid.export.ensemble.draws import Draws, draw_arms
from armid.export.input_digest_check import Unseen, find_source
from armid.export.preparation import ExportChoices, contents_of, prepare
from armid.export.verification import verify
from armid.export.write import default_path, exporter_of
from armid.model.motion import Motion
from armid.runs.run import Run
from armid.study.progress import Progress, no_progress
from armid.study.storage.array_files import write_archive
from armid.study.storage.atomic_folder import refuse, whole_folder
from armid.study.storage.records import finding_record, to_json

RECORD, PARAMETERS = "ensemble.json", "parameters.npz"
"""Names of the files next to the descriptions: record of the ensemble, and parameters of all draws."""

KIND = "set of drawn arms"
"""Name of the kind of folder, for messages."""


@dataclass(frozen=True, eq=False, slots=True)
class ExportedEnsemble:
    """Result of the export of an ensemble.

    Attributes:
        folder: Folder of all files.
        format: Name of the format.
        files: Names of the descriptions, one for each draw.
        seed: Seed of the random numbers.
        draws: The draws.
        findings: Findings of the export of the estimate itself.
    """

    folder: Path
    format: str
    files: tuple[str, ...]
    seed: int
    draws: Draws
    findings: tuple[Finding, ...]


def export_ensemble(
    run: Run,
    to: str,
    count: int,
    out: Path | str | None = None,
    *,
    seed: int = 0,
    description: Path | str | None = None,
    motion: Motion | None = None,
    progress: Progress = no_progress,
    **choices: Unpack[ExportChoices],
) -> ExportedEnsemble:
    """Writes robot descriptions of arms that are drawn from the distribution of the estimate of a run.

    The folder also gets the parameters of all draws (`parameters.npz`: `base`, `standard`, `distance`,
    `torque_error`, and the names) and a record (`ensemble.json`). The file of the first draw is read back, and its
    values are compared with the parameters.

    Args:
        run: The run.
        to: Name of the format, one of `armid.export.catalogue.EXPORTERS`.
        count: Number of draws.
        out: Folder; `None` for the folder `ensemble` in that of the run. An earlier ensemble there is replaced.
        seed: Seed of the random numbers.
        description: Path of the description of the run, if it was moved after the identification.
        motion: Motion for which the torque errors are drawn; if not given, a motion like the training motion.
        progress: Function that is called with the text `ensemble` and the share of the draws that are done.
        choices: Choices of the content.

    Raises:
        OutputError: No real bodies have the base parameters of the estimate, the folder has other contents or cannot
            be written, or the description has no bodies for the links.
    """
    folder = Path(out) if out is not None else Path(run.folder) / "ensemble"
    refuse(folder, RECORD, KIND)
    exporter, source = exporter_of(to), find_source(run, description)
    edits = source.format == to
    prepared = prepare(run, exporter, source, edits=edits, **choices)
    draws = draw_arms(run, prepared.theta, count, seed, motion=motion, progress=progress)
    name = default_path(run, source, exporter)
    digits = len(str(count - 1))
    files = tuple(f"{name.stem}_{k:0{digits}d}{name.suffix}" for k in range(count))
    with whole_folder(folder, RECORD, KIND) as draft:
        contents = contents_of(run, exporter, source, draws.standard, edits=edits, **choices)
        for k, content in enumerate(contents):
            written = exporter.write(content)
            if k == 0:
                verify(exporter, written, content, run, draws.standard[k], Unseen((), ()))
            replace_file(draft / files[k], written.data)
        write_archive(draft / PARAMETERS, _arrays(run, draws))
        result = ExportedEnsemble(folder, to, files, seed, draws, (*prepared.findings, *prepared.far))
        replace_file(draft / RECORD, to_json(ensemble_record(run, result)) + "\n")
    return result


def ensemble_record(run: Run, exported: ExportedEnsemble) -> dict[str, Any]:
    """Data of `ensemble.json` and of `armid export --ensemble --json`."""
    return {
        "kind": "armid-ensemble 1",
        "run": Path(run.folder).name,
        "method": run.estimate.method,
        "made_from": [str(each) for each in run.estimate.made_from],
        "folder": str(exported.folder),
        "format": exported.format,
        "seed": exported.seed,
        "draws": len(exported.files),
        "replaced": exported.draws.replaced,
        "spread": exported.draws.spread.tolist(),
        "torque_error_rms": np.sqrt(np.mean(exported.draws.torque_error**2, axis=0)),
        "files": exported.files,
        "findings": [finding_record(finding) for finding in exported.findings],
    }


def _arrays(run: Run, draws: Draws) -> dict[str, Any]:
    """Arrays of `parameters.npz`."""
    return {
        "base": draws.base,
        "standard": draws.standard,
        "distance": draws.distance,
        "torque_error": draws.torque_error,
        "joints": np.array(run.robot.joint_names),
        "base_names": np.array([str(name) for name in run.estimate.base.names]),
        "standard_names": np.array([str(parameter.name) for parameter in run.model.parameters]),
    }

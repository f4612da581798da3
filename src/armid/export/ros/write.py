"""Export of the model of a run as files for ROS description packages; they are verified before they are written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Unpack

from armid.errors import OutputError
from armid.export.catalogue import EXPORTERS
from armid.export.input_digest_check import find_source, unseen_recordings
from armid.export.preparation import ExportChoices, PreparedExport, prepare
from armid.export.ros.catalogue import ROS_FILES, RosFiles
from armid.export.sidecar import origin_line, refuse_overwriting, side_record
from armid.export.types import DescriptionSource, WrittenDescription
from armid.export.verification import verify
from armid.export.write import SIDE, Exported, findings_on_sidecar
from armid.output.file_group import replace_files
from armid.runs.run import Run
from armid.study.storage.records import to_json


def export_for_ros(
    run: Run,
    to: str,
    out: Path | str | None = None,
    *,
    description: Path | str | None = None,
    data: Path | str | None = None,
    **choices: Unpack[ExportChoices],
) -> Exported:
    """Writes the model of a run as files of a ROS description package, and a sidecar file with the whole model.

    The files have the numbers that `export_run` would write into a URDF.

    Args:
        run: The run.
        to: Kind of files, one of `armid.export.ros.catalogue.ROS_FILES`.
        out: Folder for the files; `None` for a folder of this name in the folder of the run.
        description: Path of the description of the run, if it was moved after the identification.
        data: Folder of the recordings of the run, if they were moved after the identification.
        choices: Choices of the content.

    Raises:
        OutputError: The description is not that of the package, files of another origin exist, or the model in the
            files would be wrong.
    """
    kind, exporter, source = ROS_FILES[to], EXPORTERS["urdf"], find_source(run, description)
    edits = source.format == "urdf"
    if kind.NEEDS_DESCRIPTION and not edits:
        raise _foreign(to, source.path)
    prepared = prepare(run, exporter, source, edits=edits, **choices)
    written = exporter.write(prepared.content)
    files, again = _made(kind, run, source, written)
    unseen, unphysical = unseen_recordings(run, data), prepared.is_unphysical
    verified = verify(exporter, again, prepared.content, run, prepared.theta, unseen, unphysical=unphysical)
    folder = Path(run.folder) / to if out is None else Path(out)
    _refuse_others(files, folder, run)
    *paths, side = replace_files(folder, {**files, **_side(run, prepared, files)})
    findings = (*prepared.findings, *prepared.far, *written.findings)
    findings = (*findings, *findings_on_sidecar(run, exporter, side.name), *verified.findings)
    edited = source.path if edits else ""
    return Exported(
        paths[0], side, to, edited, prepared.kind, verified.checks, verified.predictions, findings, tuple(paths)
    )


def _foreign(to: str, description: str) -> OutputError:
    """Error that the description of a run is not that of a package."""
    return OutputError(
        f"The files {to} are for arms that were identified with a URDF or xacro of this package, but the "
        f"description of the run is {description}.",
        possible="the formats urdf and xacro",
        remedy="identify with the URDF of the package, or choose another format with --to.",
    )


def _made(
    kind: RosFiles, run: Run, source: DescriptionSource, written: WrittenDescription
) -> tuple[Mapping[str, str], WrittenDescription]:
    """Files made from a written URDF, and the URDF to which the package expands them."""
    about = f"{run.robot.name}, identified by armid ({run.estimate.method}). {origin_line(run)}"
    files = kind.write(written.data, about)
    # Files of a package hold the arm only; all else is as in the description.
    rest = source.data if kind.NEEDS_DESCRIPTION else written.data
    return files, WrittenDescription(kind.expanded(files, rest), written.findings)


def _refuse_others(files: Mapping[str, str], folder: Path, run: Run) -> None:
    """Refuses to overwrite files that are not an export of this run."""
    paths = [folder / name for name in files]
    present = {path: path.read_text(encoding="utf-8", errors="replace") for path in paths if path.is_file()}
    refuse_overwriting([path for path, text in present.items() if origin_line(run) not in text], run)


def _side(run: Run, prepared: PreparedExport, files: Mapping[str, str]) -> dict[str, str]:
    """Name and text of the sidecar file, which is next to the first of the files."""
    first = next(iter(files))
    record = side_record(
        run, prepared.content, prepared.theta, files[first].encode(), Path(first).name, prepared.kind
    )
    return {f"{first}{SIDE}": to_json(record) + "\n"}

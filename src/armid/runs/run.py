"""Run: the folder that an identification writes, and its reader.

    study.json  robot.npz  model.json  information.npz  estimate.npz  estimate.json  validation.json

The folder is written under a temporary name and renamed when it is complete, so a run is never incomplete.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armid.atomic_file import replace_file
from armid.dataclass_files import load, save
from armid.errors import ArmidError
from armid.estimation.estimate_record import Estimate
from armid.estimation.link_properties import LinkTable, link_record, link_table
from armid.hashes import sha256_of_file
from armid.input_boundary import boundary, naming, read_json
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.dynamics_model import DynamicsModel
from armid.notebook_display import Displayed, Summary
from armid.robot import Robot
from armid.study.config import ModelChoice, build_model
from armid.study.identify import Result
from armid.study.plausibility.recording_errors import only_drive_gains_contradict
from armid.study.storage.archive_digests import refuse_changed_archive
from armid.study.storage.atomic_folder import completed, refuse, whole_folder
from armid.study.storage.provenance import RunOrigin, origin_now, origin_of, origin_record
from armid.study.storage.records import (
    estimate_record,
    friction_selection_record,
    log_format_record,
    study_record,
    to_json,
    validation_record,
)

MARKER = "estimate.json"

ARCHIVES = ("robot.npz", "information.npz", "estimate.npz")
"""Archives of a run, whose digests are stored in `model.json`."""

RUN, RUN_RECORD = "a run of this version of armid", "a record of a run of this version of armid"
"""Names of the folder of a run and of its records, for messages."""

FORMAT = 1
"""Number of the format of the folder of a run, stored in `model.json`. A run without this number has format 1."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Run(Displayed):
    """Contents of the folder of a run, as far as a prediction needs them.

    Attributes:
        folder: The folder.
        robot: The arm.
        model: Arm and torque terms.
        estimate: The parameters.
        processing: Processing options.
        log_format: Log format of the first training recording, without guessed columns.
        trained_on: Digests of the training recordings (sha256).
        verdict: Verdict of the validation: `pass`, `fail` or `not judged`.
        made: Time and computer of the identification, and version of armid.
    """

    folder: str
    robot: Robot
    model: DynamicsModel
    estimate: Estimate
    processing: ProcessingOptions
    log_format: LogFormat
    trained_on: tuple[str, ...]
    verdict: str = "not judged"
    made: RunOrigin = field(default_factory=RunOrigin)

    def summary(self) -> Summary:
        """Table with arm, model, method and verdict."""
        fit = self.estimate.fit
        rows = (
            ("arm", self.estimate.robot),
            ("joints", ", ".join(self.robot.joint_names)),
            ("terms", ", ".join(dict.fromkeys(term.name for term in self.model.terms))),
            ("method", self.estimate.method),
            ("parameters", str(len(fit.names))),
            ("verdict", self.verdict),
        )
        return Summary(
            f"run {self.folder}",
            ("", ""),
            rows,
            "the parameters are in run.estimate, the bodies of the links in run.links",
        )

    @property
    def links(self) -> LinkTable:
        """Mass, centre of mass, and inertia about the centre of mass of each link: described and estimated values."""
        return link_table(self.model, self.estimate)


def save_run(
    result: Result,
    folder: Path | str,
    *,
    further_records: Mapping[str, Any] | None = None,
    made: RunOrigin | None = None,
) -> Path:
    """Writes the folder of a run. An existing run is replaced; any other folder is refused.

    Args:
        result: Result of an identification.
        folder: Output folder.
        further_records: Further records to write as JSON, by the name of their file.
        made: Time and computer of the identification, and version of armid; if not given, the present ones.

    Raises:
        OutputError: The folder cannot be written, or its contents are not a run.
    """
    with whole_folder(folder, MARKER, "run") as draft:
        write_run(result, draft, made or origin_now())
        for name, record in (further_records or {}).items():
            replace_file(draft / name, to_json(record) + "\n")
    return Path(folder)


def refuse_folder(folder: Path | str) -> None:
    """Raises an error if a run cannot or must not be written to a folder; called before a long computation.

    Raises:
        OutputError: The folder has contents that are not a run, is the current working folder, or is not writable.
    """
    refuse(folder, MARKER, "run")


def saved_run(result: Result, folder: Path | str, *, further_records: Mapping[str, Any] | None = None) -> Run:
    """Writes the folder of a run as `save_run` does, and returns the run without reading it."""
    made = origin_now()
    return run_of(result, save_run(result, folder, further_records=further_records, made=made), made)


def run_of(result: Result, folder: Path | str, made: RunOrigin) -> Run:
    """Run with the values that `save_run` writes, made from the result without reading the folder."""
    return Run(
        str(folder),
        result.robot,
        result.model,
        result.estimate,
        result.study.processing,
        _format_given(result),
        _trained_on(result),
        result.validation.verdict,
        made,
    )


def _format_given(result: Result) -> LogFormat:
    """Log format of the first training recording, without guessed columns.

    Guessed columns are left out, because they may differ in other recordings.
    """
    return result.given_format or next(r.reading for r in result.study.recordings if r.role == "train")


def _trained_on(result: Result) -> tuple[str, ...]:
    """Digests (sha256) of the recordings on which a run was trained."""
    return tuple(each.sha256 for each in result.training)


def load_run(folder: Path | str) -> Run:
    """Reads a run.

    Raises:
        ArmidError: The folder is not a run, is damaged, or has a format that this version does not know.
    """
    folder = completed(folder)
    with boundary(RUN, folder, remedy="give the folder that armid identify made."):
        made = (folder / MARKER).is_file()
    if not made and (folder / "servo.json").is_file():
        raise ArmidError(
            f"{folder} is a result of armid servo, which has no model of torques for this command.",
            possible="armid report, armid validate and armid preview",
            remedy="use the files of the folder, such as model.xml, or identify from torques with armid identify.",
        )
    if not made:
        raise ArmidError(f"{folder} is not a run of armid.", remedy="give the folder that armid identify made.")
    kept = _model_record(folder)
    _check_archives(folder, kept)
    robot, estimate = load(Robot, folder / "robot.npz"), load(Estimate, folder / "estimate.npz")
    with boundary(RUN, folder, remedy="identify again."), naming(folder):
        model = _model(robot, kept)
        _require_estimate_of(estimate, model, folder)
        return Run(
            str(folder),
            robot,
            model,
            estimate,
            ProcessingOptions(**kept["processing"]),
            LogFormat(**kept["reading"]),
            tuple(_digest(each) for each in kept["trained_on"]),
            _verdict(folder),
            origin_of(kept),
        )


def _require_estimate_of(estimate: Estimate, model: DynamicsModel, folder: Path) -> None:
    """Raises an error if an estimate is not one of the parameters of a model."""
    base, fit = estimate.base, estimate.fit
    problem = ""
    if len(base.standard_names) != len(model.parameters):
        problem = (
            f"its model has {len(base.standard_names)} standard parameters, and that of model.json "
            f"{len(model.parameters)}"
        )
    elif not {name.of_all for name in fit.names} >= set(base.names):
        problem = "it has values of other parameters than its base parameters"
    elif fit.standard is not None and not {each.of_all for each in fit.standard.names} >= set(base.standard_names):
        problem = "it has values of other standard parameters than its model"
    elif estimate.speeds is not None and np.shape(estimate.speeds) != (model.n,):
        problem = f"it has speeds of the shape {np.shape(estimate.speeds)} for {model.n} joints"
    if problem:
        raise ArmidError(
            f"{folder / 'estimate.npz'} is not the estimate of this run: {problem}.",
            remedy="restore the folder from a copy, or identify again.",
        )


def _digest(value: Any) -> str:
    """Digest from a record.

    Raises:
        TypeError: The value is not a string.
    """
    if not isinstance(value, str):
        raise TypeError(f"a digest must be a string; found {value!r:.40}")
    return value


def _check_archives(folder: Path, kept: Mapping[str, Any]) -> None:
    """Raises an error if an archive of a run differs from the one that was written; earlier runs have no digests."""
    digests = kept.get("sha256")
    for name, digest in digests.items() if isinstance(digests, Mapping) else ():
        if name in ARCHIVES:
            refuse_changed_archive(folder / name, digest, "model.json", "identify again.")


def _model_record(folder: Path) -> dict[str, Any]:
    """Contents of `model.json`, after a check that this version of armid can read the format of the run."""
    kept = read_json(folder / "model.json", RUN_RECORD, remedy="identify again.")
    found = kept.get("format", FORMAT)
    if found != FORMAT:
        raise ArmidError(
            f"{folder} has format {found}; this version of armid reads format {FORMAT}.",
            remedy="update armid, or identify again with this version.",
        )
    return kept


def format_of_new_recording(run: Run, changes: Mapping[str, Any]) -> LogFormat:
    """Log format of a new recording, made from the log format of the run.

    Excluded intervals, the period and the start of the first period are left out, because they belong to one
    recording; a period is detected from the positions.

    Args:
        run: The run.
        changes: Fields of the log format that differ from that of the run's first recording.
    """
    period = "none" if run.log_format.period == "none" else None
    made = dataclasses.replace(run.log_format, **{"exclude": (), "start": None, "period": period, **changes})
    return made.with_all_samples() if run.processing.needs_all_samples else made


def with_edges(run: Run, edges: str | None) -> Run:
    """Run with another treatment of the ends of new recordings.

    Args:
        run: The run.
        edges: Treatment of the ends: `drop`, `pad` or `periodic`; `None` for the treatment of the run.

    Raises:
        StudyError: The treatment is unknown.
    """
    if edges is None or edges == run.processing.edges:
        return run
    average = run.processing.average and edges == "periodic"
    changed: Any = {"edges": edges, "average": average}
    if run.processing.derivatives == "periodic" and edges != "periodic":
        changed["derivatives"] = "central"
    return dataclasses.replace(run, processing=dataclasses.replace(run.processing, **changed))


def failed_checks(run: Run) -> list[str]:
    """Names of the checks that failed in the validation of a run."""
    path = Path(run.folder) / "validation.json"
    record = read_json(path, RUN_RECORD, remedy="identify again.")
    with boundary(RUN_RECORD, path, remedy="identify again."):
        return [str(each["name"]) for each in record.get("checks", []) if not each["ok"]]


def only_drive_gains_failed(run: Run) -> bool:
    """Tests whether a run failed its validation only because its drive gains contradict the described masses.

    Args:
        run: The run.
    """
    if run.verdict != "fail" or run.log_format.drive_gain is None:
        return False
    return only_drive_gains_contradict(failed_checks(run), run.estimate.findings)


def _verdict(folder: Path) -> str:
    """Verdict of the validation of a run, from `validation.json`."""
    return str(read_json(folder / "validation.json", RUN_RECORD, remedy="identify again.")["verdict"])


def _model(robot: Robot, record: Mapping[str, Any]) -> DynamicsModel:
    """Model of a run, with the inertial parameters for the load torque, if the model has load-dependent friction."""
    model = build_model(robot, ModelChoice(tuple(record["terms"]), record["shapes"]))
    return dataclasses.replace(model, load_parameters=record.get("load_parameters"))


def write_run(result: Result, draft: Path, made: RunOrigin) -> None:
    """Writes the files of a run to an existing folder, which is not yet in its place.

    Args:
        result: Result of an identification.
        draft: The folder.
        made: Time and computer of the identification, and version of armid.
    """
    study = result.study
    model = {
        "format": FORMAT,
        "terms": study.model.terms,
        "shapes": study.model.shapes,
        "load_parameters": result.model.load_parameters,
        "processing": dataclasses.asdict(study.processing),
        "reading": log_format_record(_format_given(result)),
        "trained_on": _trained_on(result),
        "made": origin_record(made),
    }
    replace_file(draft / "study.json", to_json(study_record(study)) + "\n")
    for name, value in zip(ARCHIVES, (result.robot, result.information, result.estimate), strict=True):
        save(value, draft / name)
    model["sha256"] = {name: sha256_of_file(draft / name) for name in ARCHIVES}
    replace_file(draft / "model.json", to_json(model) + "\n")
    if result.friction_selection is not None:
        record = friction_selection_record(result.friction_selection, result.robot.joint_names)
        replace_file(draft / "friction.json", to_json(record) + "\n")
    replace_file(draft / "validation.json", to_json(validation_record(result.validation)) + "\n")
    record = estimate_record(result.estimate)
    record["links"] = link_record(link_table(result.model, result.estimate))
    replace_file(draft / MARKER, to_json(record) + "\n")

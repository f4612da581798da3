"""Run: the folder that an identification writes, and its reader.

    study.json  robot.npz  model.json  information.npz  estimate.npz  estimate.json  validation.json

The folder is written under a temporary name and renamed when it is complete, so no run is incomplete.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from armid.errors import ArmidError
from armid.estimation.estimate import Estimate
from armid.estimation.link_properties import LinkTable, link_record, link_table
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.dynamics import DynamicsModel
from armid.notebook import Displayed, Summary
from armid.robot import Robot
from armid.study.atomic_folder import refuse, whole_folder
from armid.study.config import ModelChoice, Study, build_model
from armid.study.identify import Result
from armid.study.provenance import RunOrigin, origin_now, origin_of, origin_record
from armid.study.records import estimate_record, friction_selection_record, to_json, validation_record
from armid.values import load, replace_file, save

__all__ = ["Run", "load_run", "refuse_folder", "save_run"]

MARKER = "estimate.json"


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Run(Displayed):
    """Contents of a run's folder that prediction needs.

    Attributes:
        folder: The folder.
        robot: The arm.
        model: Arm and torque terms.
        estimate: The parameters.
        processing: Processing options.
        reading: Log format of the first training recording.
        trained_on: Digests of the training recordings (sha256).
        verdict: Verdict of its validation: `pass`, `fail` or `not judged`.
        made: Time, place and version.
    """

    folder: str
    robot: Robot
    model: DynamicsModel
    estimate: Estimate
    processing: ProcessingOptions
    reading: LogFormat
    trained_on: tuple[str, ...]
    verdict: str = "not judged"
    made: RunOrigin = field(default_factory=RunOrigin)

    def summary(self) -> Summary:
        """Arm, model, method and verdict."""
        fit = self.estimate.fit
        rows = (
            ("arm", self.estimate.robot),
            ("joints", ", ".join(self.robot.joint_names)),
            ("terms", ", ".join(dict.fromkeys(term.name for term in self.model.terms))),
            ("method", self.estimate.method),
            ("parameters", str(len(fit.names))),
            ("verdict on held-out motion", self.verdict),
        )
        return Summary(f"run {self.folder}", ("", ""), rows, "values: run.estimate; bodies of the links: run.links")

    @property
    def links(self) -> LinkTable:
        """Mass, centre of mass and inertia about it of each link, as described and as estimated."""
        return link_table(self.model, self.estimate)


def save_run(result: Result, folder: Path | str, *, further_records: Mapping[str, Any] | None = None) -> Path:
    """Writes a run's folder. An existing run is replaced; anything else is refused.

    Args:
        result: Result of an identification.
        folder: Output folder.
        further_records: Further records to write as JSON, by the name of their file.

    Raises:
        OutputError: The folder cannot be written, or holds something that is no run.
    """
    with whole_folder(folder, MARKER, "run") as draft:
        _write(result, draft)
        for name, record in (further_records or {}).items():
            replace_file(draft / name, to_json(record) + "\n")
    return Path(folder)


def refuse_folder(folder: Path | str) -> None:
    """Refuses a folder that a run cannot or must not replace, before any work is done.

    Raises:
        OutputError: It holds something that is no run, is the working folder, or is not writable.
    """
    refuse(folder, MARKER, "run")


def load_run(folder: Path | str) -> Run:
    """Reads a run.

    Raises:
        ArmidError: The folder is no run.
    """
    folder = Path(folder)
    if not (folder / MARKER).is_file():
        raise ArmidError(f"{folder} is no run of armid.", remedy="give the folder that armid identify made.")
    try:
        robot, estimate = load(Robot, folder / "robot.npz"), load(Estimate, folder / "estimate.npz")
    except (KeyError, TypeError) as error:  # fields that another version did not have
        raise ArmidError(
            f"{folder} was made by another version of armid: its robot.npz or estimate.npz has other fields "
            f"({type(error).__name__}: {error}).",
            remedy="identify again.",
        ) from error
    try:
        kept: dict[str, Any] = json.loads((folder / "model.json").read_text(encoding="utf-8"))
        return Run(
            str(folder),
            robot,
            _model(robot, kept),
            estimate,
            ProcessingOptions(**kept["processing"]),
            LogFormat(**kept["reading"]),
            tuple(kept["trained_on"]),
            _verdict(folder),
            origin_of(kept),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ArmidError(
            f"{folder} is damaged or of another version: its model.json or validation.json cannot be read "
            f"({type(error).__name__}: {error}).",
            remedy="identify again.",
        ) from error


def _verdict(folder: Path) -> str:
    """Verdict of a run's validation."""
    return str(json.loads((folder / "validation.json").read_text(encoding="utf-8"))["verdict"])


def _model(robot: Robot, record: Mapping[str, Any]) -> DynamicsModel:
    """The model as it was used, with the link parameters of its load torque, if it has one."""
    model = build_model(robot, ModelChoice(tuple(record["terms"]), record["shapes"]))
    return dataclasses.replace(model, load_parameters=record.get("load_parameters"))


def _write(result: Result, draft: Path) -> None:
    study = result.study
    # Guessed columns are not stored, since other recordings of the arm may have other columns.
    asked = result.asked or next(r.reading for r in study.recordings if r.role == "train")
    model = {
        "terms": study.model.terms,
        "shapes": study.model.shapes,
        "load_parameters": result.model.load_parameters,
        "processing": dataclasses.asdict(study.processing),
        "reading": _given(asked),
        "trained_on": [each.sha256 for each in result.training],
        "made": origin_record(origin_now()),
    }
    replace_file(draft / "study.json", to_json(_study_record(study)) + "\n")
    replace_file(draft / "model.json", to_json(model) + "\n")
    save(result.robot, draft / "robot.npz")
    save(result.information, draft / "information.npz")
    save(result.estimate, draft / "estimate.npz")
    if result.ladder is not None:
        record = friction_selection_record(result.ladder, result.robot.joint_names)
        replace_file(draft / "friction.json", to_json(record) + "\n")
    replace_file(draft / "validation.json", to_json(validation_record(result.validation)) + "\n")
    record = estimate_record(result.estimate)
    record["links"] = link_record(link_table(result.model, result.estimate))
    replace_file(draft / MARKER, to_json(record) + "\n")


def _study_record(study: Study) -> dict[str, Any]:
    """The resolved study, without default values of log formats."""
    record: dict[str, Any] = dataclasses.asdict(study)
    record["folder"] = str(Path(study.folder).resolve())  # independent of the working folder
    for recording, choice in zip(record["recordings"], study.recordings, strict=True):
        recording["reading"] = _given(choice.reading)
    return record


def _given(reading: LogFormat) -> dict[str, Any]:
    """Fields of a log format that are given."""
    return {key: value for key, value in dataclasses.asdict(reading).items() if value is not None}

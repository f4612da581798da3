"""A run: the folder that an identification leaves behind, and what is read back from it.

    study.json  robot.npz  model.json  information.npz  estimate.npz  estimate.json  validation.json

The folder is made under another name and renamed when it is complete, so that a run is there whole or not at all.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armid.errors import ArmidError, OutputError
from armid.estimation.estimate import Estimate
from armid.measurement.processing import Processing
from armid.measurement.reading import Reading
from armid.model.dynamics import DynamicsModel
from armid.robot import Robot
from armid.study.identify import Result
from armid.study.records import estimate_record, to_json, validation_record
from armid.study.study import ModelChoice, Study, build_model
from armid.values import load, replace_file, save

__all__ = ["Run", "load_run", "save_run"]

MARKER = "estimate.json"


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """What a run's folder holds, as far as prediction needs it.

    Attributes:
        folder: The folder.
        robot: The arm.
        model: Arm and torque terms.
        estimate: The parameters.
        processing: How recordings were processed.
        reading: How the first training recording was read.
        trained_on: Digests of the training recordings (sha256).
    """

    folder: str
    robot: Robot
    model: DynamicsModel
    estimate: Estimate
    processing: Processing
    reading: Reading
    trained_on: tuple[str, ...]


def save_run(result: Result, folder: Path | str) -> Path:
    """Write a run's folder. An existing run there is replaced; anything else is left alone.

    Raises:
        OutputError: The folder cannot be written, or holds something that is no run.
    """
    folder = Path(folder)
    if folder.exists() and not (folder / MARKER).is_file() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{folder} exists and is no run of armid.", remedy="choose another folder with --out.")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    except OSError as error:
        raise OutputError(
            f"{folder} could not be written: {error.strerror or error}.",
            remedy="choose a folder that is writable with --out.",
        ) from error
    try:
        _write(result, draft)
        draft.chmod(0o755)
        old = folder.with_name(f".{folder.name}.old")
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)
            folder.rename(old)
        draft.rename(folder)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise OutputError(f"{folder} could not be written: {error.strerror or error}.") from error
    finally:
        if draft.exists():
            shutil.rmtree(draft, ignore_errors=True)
    return folder


def load_run(folder: Path | str) -> Run:
    """Read a run back.

    Raises:
        ArmidError: The folder is no run.
    """
    folder = Path(folder)
    if not (folder / MARKER).is_file():
        raise ArmidError(f"{folder} is no run of armid.", remedy="give the folder that armid identify made.")
    robot = load(Robot, folder / "robot.npz")
    kept: dict[str, Any] = json.loads((folder / "model.json").read_text())
    choice = ModelChoice(tuple(kept["terms"]), kept["shapes"])
    return Run(
        str(folder),
        robot,
        build_model(robot, choice),
        load(Estimate, folder / "estimate.npz"),
        Processing(**kept["processing"]),
        Reading(**kept["reading"]),
        tuple(kept["trained_on"]),
    )


def _write(result: Result, draft: Path) -> None:
    study = result.study
    validating = {each.sha256 for each in result.validation.recordings}
    names = tuple(term.name for term in result.estimate.terms)
    shapes = {name: dict(options) for name, options in study.model.shapes.items()}
    for term in result.estimate.terms:
        if term.shapes:
            shapes[term.name] = {**shapes.get(term.name, {}), **term.shapes}
    model = {
        "terms": names,
        "shapes": shapes,
        "processing": dataclasses.asdict(study.processing),
        "reading": _given(next(r.reading for r in study.recordings if r.role == "train")),
        "trained_on": [each.sha256 for each in result.training if each.sha256 not in validating],
    }
    replace_file(draft / "study.json", to_json(_study_record(study)) + "\n")
    replace_file(draft / "model.json", to_json(model) + "\n")
    save(result.robot, draft / "robot.npz")
    save(result.information, draft / "information.npz")
    save(result.estimate, draft / "estimate.npz")
    replace_file(draft / "validation.json", to_json(validation_record(result.validation)) + "\n")
    replace_file(draft / MARKER, to_json(estimate_record(result.estimate)) + "\n")


def _study_record(study: Study) -> dict[str, Any]:
    """The study as it was resolved, without what stands at its default in a recording."""
    record = dataclasses.asdict(study)
    for recording, choice in zip(record["recordings"], study.recordings, strict=True):
        recording["reading"] = _given(choice.reading)
    return record


def _given(reading: Reading) -> dict[str, Any]:
    """What a reading says beyond its defaults."""
    return {key: value for key, value in dataclasses.asdict(reading).items() if value is not None}

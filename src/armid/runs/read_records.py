"""Records of a run as typed values: study, validation, friction selection and comparison of methods.

The records are made from a result in memory or read from the folder of a run, with the same values.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.friction.selection import SelectionEvidence
from armid.estimation.uncertainty.prediction_error import ExpectedError
from armid.input_boundary import boundary, read_json
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.parameter_name import ParameterName
from armid.runs.run import Run
from armid.study.compare_methods import MethodEstimate, MethodScore, MethodTable
from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, Study, parse_robot, resolve_model
from armid.study.identify import Result
from armid.study.servos.choice import ServoChoice
from armid.study.storage.records import SelectionSummary, selection_summary
from armid.validation.left_out_error import LeftOutError
from armid.validation.torque_validation import Check, Score, Validation


@dataclass(frozen=True, eq=False, slots=True)
class RunRecords:
    """Records of a run.

    Attributes:
        study: Study, in which automatic choices are replaced by their results; its folder is an absolute path.
        validation: Torque error on the validation recordings.
        friction: Friction selection, if there was one.
        methods: Comparison of methods, if there was one.
    """

    study: Study
    validation: Validation
    friction: SelectionSummary | None = None
    methods: MethodTable | None = None


def records_of(result: Result, methods: MethodTable | None = None) -> RunRecords:
    """Makes the records of a run from the result of an identification, equal to those read from its folder.

    Args:
        result: Result of the identification.
        methods: Table of the estimators that were compared; `None` if none were compared.
    """
    study = replace(result.study, folder=str(Path(result.study.folder).resolve()))
    selection = result.friction_selection
    summary = None if selection is None else selection_summary(selection)
    return RunRecords(study, result.validation, summary, methods)


def read_records(run: Run) -> RunRecords:
    """Reads the records of a run.

    Raises:
        ArmidError: A record is missing or damaged.
    """
    study, validation = _read(run, "study"), _read(run, "validation")
    friction, methods = (_read(run, name) if _path(run, name).is_file() else None for name in ("friction", "compare"))
    with boundary("records of a run of this version of armid", run.folder, remedy="identify again."):
        return RunRecords(
            study_of_record(study),
            _of_joints(_validation(validation), run.robot.n),
            None if friction is None else _selection(friction),
            None if methods is None else _methods(methods),
        )


def trained_and_validated(run: Run, study: Study) -> list[tuple[RecordingChoice, str]]:
    """Recordings for training and validation in the study of a run, each with its digest (sha256).

    Raises:
        ArmidError: The estimate was made from another number of recordings.
    """
    digests = run.estimate.recording_digests
    if len(digests) != len(study.recordings):
        raise ArmidError(
            f"{run.folder}: study.json has {len(study.recordings)} recordings, and estimate.npz the digests of "
            f"{len(digests)}.",
            remedy="restore the folder from a copy, or identify again.",
        )
    return list(zip(study.recordings, digests, strict=True))


def study_of_run(run: Run) -> Study:
    """Study of the earlier run, in which the folder of the run replaces the recordings.

    Raises:
        ArmidError: The file `study.json` of the run is damaged.
    """
    path = Path(run.folder) / "study.json"
    record = read_json(path, "the study of a run", remedy="identify again.")
    with boundary("the study of a run", path, remedy="identify again."), _as_value_error():
        return Study(
            parse_robot(record["robot"]),
            resolve_model(run.model),
            (RecordingChoice(run.folder),),
            run.processing,
            EstimationChoice(**record["estimation"]),
            record["folder"],
        )


def read_values(path: Path | str) -> dict[str, float]:
    """Reads parameters by name from a JSON object.

    Raises:
        ArmidError: The file is missing or is not a JSON object of numbers.
    """
    values = read_json(path, "a JSON object of parameters", remedy="give a JSON object {name: value}.")
    if not values:
        raise ArmidError(f"{path} is not a JSON object of parameters.", remedy='write {"ZZR_1": 0.05, …}.')
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ArmidError(
                f"{path}: {name} must be a finite number; found {value!r}.", remedy="correct this value."
            )
    return {str(name): float(value) for name, value in values.items()}


def _path(run: Run, name: str) -> Path:
    return Path(run.folder) / f"{name}.json"


def _read(run: Run, name: str) -> dict[str, Any]:
    return read_json(_path(run, name), "a record of a run", remedy="identify again.")


def study_of_record(record: Mapping[str, Any]) -> Study:
    """Study from the record `study.json` of a run.

    Raises:
        ValueError: The study contradicts itself.
    """
    with _as_value_error():
        recordings = tuple(
            RecordingChoice(each["path"], each["role"], LogFormat(**each["reading"]), tuple(each["part"]))
            for each in record["recordings"]
        )
        return Study(
            parse_robot(record["robot"]),
            ModelChoice(**record["model"]),
            recordings,
            ProcessingOptions(**record["processing"]),
            EstimationChoice(**record["estimation"]),
            str(record["folder"]),
            ServoChoice(**record.get("servo", {})),
        )


@contextmanager
def _as_value_error() -> Generator[None]:
    """Context in which an error about a value becomes a ValueError, to which the boundary adds the file."""
    try:
        yield
    except ArmidError as fault:
        raise ValueError(fault.problem) from fault


def _validation(record: Mapping[str, Any]) -> Validation:
    """Validation from the record `validation.json` of a run."""
    scores = tuple(
        Score(
            each["path"],
            each["sha256"],
            rms := _numbers(each["rms"]),
            _numbers(each["rms_raw"]),
            _spread(rms, _numbers(each["relative"])),
            _numbers(each["peak"]),
            _numbers(each["coverage95"]),
            None if each["prior_rms"] is None else _numbers(each["prior_rms"]),
            _numbers(each.get("offset", ())),
            None if each.get("share") is None else _numbers(each["share"]),
        )
        for each in record["recordings"]
    )
    checks = tuple(Check(c["name"], _number(c["value"]), _number(c["bound"]), c["ok"]) for c in record["checks"])
    return Validation(
        tuple(record["joints"]), scores, str(record["verdict"]), checks, _left_out(record.get("left_out"))
    )


def _of_joints(validation: Validation, n: int) -> Validation:
    """The validation, after a check that it has one value for each of n joints.

    Raises:
        ValueError: A list has another length.
    """
    lists = {"joints": validation.joints}
    for score in validation.recordings:
        lists |= {name: getattr(score, name) for name in OF_JOINTS}
        lists |= {"offset": score.offset} if len(score.offset) else {}
    if (left := validation.left_out) is not None:
        lists |= {"left_out.rms": left.rms, "left_out.description_rms": left.description}
        lists |= {f"expected.{name}": getattr(left.expected, name) for name in ("rms", "low", "high")}
    for name, values in lists.items():
        if values is not None and len(values) != n:
            raise ValueError(f"{name} has {len(values)} values for {n} joints")
    return validation


OF_JOINTS = ("rms", "rms_raw", "spread", "peak", "coverage95", "prior_rms", "share")
"""Values of a score that have one entry for each joint."""


def _left_out(record: Mapping[str, Any] | None) -> LeftOutError | None:
    """Error on left-out training data from the record of a validation; `None` in runs of earlier versions."""
    if record is None:
        return None
    described, expected = record["description_rms"], record["expected"]
    return LeftOutError(
        record["kind"],
        _numbers(record["rms"]),
        None if described is None else _numbers(described),
        ExpectedError(*(_numbers(expected[key]) for key in ("rms", "low", "high"))),
    )


def _spread(rms: Array, relative: Array) -> Array:
    """Standard deviation of the torque of each joint, from RMS error and relative RMS; all of shape (n,).

    The result is zero if the relative RMS is infinite or was stored as null.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = rms / relative
    return np.where(np.isnan(relative) & np.isfinite(rms), 0.0, spread)


def _selection(record: Mapping[str, Any]) -> SelectionSummary:
    """Friction selection from the record `friction.json` of a run."""
    evidence = tuple(
        SelectionEvidence(
            each["joint"],
            each.get("rung", ""),
            each["candidate"],
            _number(each["ratio"]),
            _number(each["deviation"]),
            each["chosen"],
        )
        for each in record["evidence"]
    )
    ratio, deviation = (_numbers([each[key] for each in record["joints"]]) for key in ("ratio", "deviation"))
    return SelectionSummary(evidence, ratio, deviation, record["prior_weight"], record["why"])


def _methods(record: Mapping[str, Any]) -> MethodTable:
    """Comparison of methods from the record `compare.json` of a run."""
    scores = tuple(
        MethodScore(
            each["name"],
            _numbers(each["training_rms"]),
            _numbers(each["unseen_rms"]),
            each["consistent"],
            _number(each["distance"]),
            _number(each["relative_distance"]),
            each["smallest_eigenvalue"],
            each["dropped"],
            each["seconds"],
            each["failure"] or "",
        )
        for each in record["methods"]
    )
    share = None if record.get("share") is None else _numbers(record["share"])
    estimates = tuple(
        MethodEstimate(each["name"], _numbers(each["base"]), _bodies(each["bodies"]))
        for each in record.get("estimates", ())
    )
    names = tuple(ParameterName.read(name) for name in record.get("base_parameters", ()))
    return MethodTable(tuple(record["joints"]), record["unseen"], scores, record["seconds"], share, names, estimates)


def _number(value: float | None) -> float:
    """Number in a record; null becomes NaN."""
    return np.nan if value is None else float(value)


def _bodies(values: Any) -> Array | None:
    """Properties of the links in a record as an array (n, 10); `None` for a method that does not estimate links."""
    return None if values is None else np.array([_numbers(row) for row in values])


def _numbers(values: Any) -> Array:
    """List of numbers in a record as an array; null becomes NaN."""
    return np.array([_number(value) for value in values], dtype=np.float64)

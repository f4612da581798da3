"""Folder that `armid servo` writes, and its reader.

    servo.json  robot.npz  and the files of the deliveries, such as model.xml

The folder is written under a temporary name and renamed when it is complete.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from armid.atomic_file import replace_file
from armid.checked_array import Array
from armid.dataclass_files import load, save
from armid.errors import ArmidError, Finding
from armid.hashes import sha256_of_file
from armid.input_boundary import boundary, read_json
from armid.model.terms import TERMS
from armid.robot import Robot
from armid.runs.read_records import study_of_record
from armid.servo.estimate_table import EstimatedValue, Origin
from armid.servo.identify_servo import SHORTEST_STEP
from armid.servo.parameters import LONGEST_STEP, ServoModel, ServoParameters, make_servo_model
from armid.servo.score import ClosedLoopError
from armid.study.config import Study
from armid.study.servos.identification import ServoResult, ServoScore
from armid.study.servos.record import PARAMETERS, SERVO_FORMAT, servo_record
from armid.study.storage.archive_digests import refuse_changed_archive
from armid.study.storage.atomic_folder import completed, refuse, whole_folder
from armid.study.storage.provenance import RunOrigin, origin_now, origin_of, origin_record
from armid.study.storage.records import to_json

MARKER, KIND = "servo.json", "result of armid servo"
"""File by which the folder is known, and its name in messages."""

ROBOT = "robot.npz"

AGAIN = "identify again with armid servo."


@dataclass(frozen=True, eq=False, slots=True)
class ServoErrors:
    """Closed-loop errors of a result, and the band of the position.

    Attributes:
        training: Error on the training runs.
        left_out: Error on left-out parts of the training runs, of an estimate without them.
        score: Errors on the validation runs; `None` without such runs.
        band: Half width of the 95 % band of the position of each joint, shape (n,) [rad or m].
    """

    training: ClosedLoopError
    left_out: ClosedLoopError
    score: ServoScore | None
    band: Array

    @property
    def verdict(self) -> Literal["pass", "fail", "not judged"]:
        """`pass` if the arm predicts validation motion better than its commands do."""
        return "not judged" if self.score is None else self.score.verdict


@dataclass(frozen=True, eq=False, slots=True)
class StoredServo:
    """Contents of a folder of `armid servo`.

    Attributes:
        folder: The folder.
        study: The study; its folder is an absolute path.
        model: Arm and friction laws.
        parameters: Identified parameters.
        values: Gains, friction, rotor inertias, offsets and delays with intervals.
        errors: Closed-loop errors and the band of the position.
        findings: Findings about description, recordings and estimate.
        seconds: Duration of the identification [s].
        digests: Digests (sha256) of the recordings of the study, in its order.
        made: Time and computer of the identification, and version of armid.
    """

    folder: str
    study: Study
    model: ServoModel
    parameters: ServoParameters
    values: tuple[EstimatedValue, ...]
    errors: ServoErrors
    findings: tuple[Finding, ...]
    seconds: float
    digests: tuple[str, ...]
    made: RunOrigin

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.model.robot

    def joint_values(self, joint: int) -> dict[str, EstimatedValue]:
        """Values of a joint, by their kind."""
        return {each.kind: each for each in self.values if each.joint == joint}


def is_servo_folder(folder: Path | str) -> bool:
    """Tests whether a folder is one that `armid servo` wrote."""
    return (Path(folder) / MARKER).is_file()


def refuse_servo_folder(folder: Path | str) -> None:
    """Raises an error, before any work is done, if a folder must not be replaced by a result of `armid servo`.

    Raises:
        OutputError: The folder has other contents, is the current working folder, or is not writable.
    """
    refuse(folder, MARKER, KIND)


def stored_servo_of(result: ServoResult, folder: Path | str, made: RunOrigin | None = None) -> StoredServo:
    """Contents of the folder of a result, equal to those that are read from it.

    Args:
        result: Result of the identification.
        folder: The folder.
        made: Time and computer of the identification; if not given, the present ones.
    """
    estimate = result.estimate
    return StoredServo(
        str(folder),
        replace(result.study, folder=str(Path(result.study.folder).resolve())),
        estimate.model,
        estimate.parameters,
        result.values,
        ServoErrors(estimate.training, estimate.left_out[0 if estimate.refined else 1], result.score, result.band),
        result.findings,
        result.seconds,
        result.digests,
        made or origin_now(),
    )


def save_servo(
    result: ServoResult, stored: StoredServo, files: Mapping[str, bytes], check: Mapping[str, Any]
) -> None:
    """Writes the folder of a result. An earlier result is replaced; any other folder is refused.

    Args:
        result: Result of the identification.
        stored: Contents of the folder, with all findings.
        files: Contents of further files, by their name.
        check: Comparison of the roll-out of MuJoCo, which is recorded.

    Raises:
        OutputError: The folder cannot be written, or its contents are not a result of `armid servo`.
    """
    record = servo_record(replace(result, findings=stored.findings))
    record |= {"rollout_check": check or None, "made": origin_record(stored.made)}
    with whole_folder(stored.folder, MARKER, KIND) as draft:
        save(result.robot, draft / ROBOT)
        record["sha256"] |= {"robot": sha256_of_file(draft / ROBOT)}
        replace_file(draft / MARKER, to_json(record) + "\n")
        for name, data in files.items():
            (draft / name).write_bytes(data)


def load_servo(folder: Path | str) -> StoredServo:
    """Reads the folder of a result of `armid servo`.

    Raises:
        ArmidError: The folder is not such a result, is damaged, or has a format that this version does not know.
    """
    folder = completed(folder)
    if not is_servo_folder(folder):
        raise ArmidError(f"{folder} is not a {KIND}.", remedy="give the folder that armid servo made.")
    path = folder / MARKER
    record = read_json(path, f"a {KIND}", remedy=AGAIN)
    found = record.get("format")
    if found != SERVO_FORMAT:
        raise ArmidError(
            f"{path} has format {found}; this version of armid reads format {SERVO_FORMAT}.",
            remedy=f"update armid, or {AGAIN}",
        )
    with boundary(f"a {KIND}", path, remedy=AGAIN):
        digest = record["sha256"]["robot"]
    refuse_changed_archive(folder / ROBOT, digest, MARKER, AGAIN)
    robot = load(Robot, folder / ROBOT)
    with boundary(f"a {KIND}", path, remedy=AGAIN):
        study = study_of_record(record["study"])
        model = make_servo_model(robot, [TERMS[name]() for name in study.servo.terms])
        model = replace(model, longest_step=_longest_step(record["longest_step"]))
        left_out = record["left_out"]["refined" if record["refined"] else "first"]
        score = record["validation"]
        digests = tuple(str(each) for each in record["sha256"]["recordings"])
        if len(digests) != len(study.recordings):
            raise ValueError(f"{len(study.recordings)} recordings have {len(digests)} digests")
        return StoredServo(
            str(folder),
            study,
            model,
            _parameters_of(model, record),
            tuple(_value(each, robot.joint_names) for each in record["values"]),
            ServoErrors(
                _error(record["training"], robot.n),
                _error(left_out, robot.n),
                None if score is None else _score(score, robot.n),
                _of_joints(record["band"], robot.n),
            ),
            tuple(_finding(each) for each in record["warnings"]),
            float(record["seconds"]),
            digests,
            origin_of(record),
        )


def _longest_step(value: Any) -> float:
    """Longest step of the integration from a record [s]."""
    if not SHORTEST_STEP <= float(value) <= LONGEST_STEP:
        raise ValueError(f"the longest step of the integration is {value}, not {SHORTEST_STEP} to {LONGEST_STEP} s")
    return float(value)


def _parameters_of(model: ServoModel, record: Mapping[str, Any]) -> ServoParameters:
    """Parameters in the record `servo.json`, after a check that they are those of a model."""
    parameters = parameters_of_record(record)
    found, wanted = (len(parameters.stiffness), len(parameters.friction)), (model.n, len(model.laws))
    if found != wanted:
        raise ValueError(f"the parameters are those of {found} joints and laws; the arm has {wanted}")
    return parameters


def parameters_of_record(record: Mapping[str, Any]) -> ServoParameters:
    """Parameters in the record `servo.json`; a limit that is null is infinite."""
    values = {name: _numbers(record["parameters"][name]) for name in PARAMETERS}
    values["limit"] = np.where(np.isnan(values["limit"]), np.inf, values["limit"])
    return ServoParameters(**values)


def _numbers(values: Any) -> Array:
    """Numbers of a record; null becomes NaN."""
    return np.array(values, dtype=np.float64)


def _of_joints(values: Any, n: int) -> Array:
    """Numbers of a record, one for each of n joints."""
    found = _numbers(values)
    if found.shape != (n,):
        raise ValueError(f"a list for {n} joints has the shape {found.shape}")
    return found


def _error(record: Mapping[str, Any], n: int) -> ClosedLoopError:
    return ClosedLoopError(_of_joints(record["joints"], n), _numbers(record["runs"]))


def _score(record: Mapping[str, Any], n: int) -> ServoScore:
    described = record["described"]
    return ServoScore(
        _error(record["model"], n),
        _error(record["command"], n),
        None if described is None else _error(described, n),
        _of_joints(record["coverage"], n),
    )


def _value(record: Mapping[str, Any], joints: tuple[str, ...]) -> EstimatedValue:
    low, high, value, information = (
        float("nan") if record[key] is None else float(record[key]) for key in ("low", "high", "value", "information")
    )
    joint = joints.index(record["joint"])
    if record["origin"] not in get_args(Origin):
        raise ValueError(f"{record['origin']} is no origin of a value")
    return EstimatedValue(record["kind"], joint, value, low, high, information, record["origin"], record["reason"])


def _finding(record: Mapping[str, Any]) -> Finding:
    return Finding(*(record[key] for key in ("code", "severity", "channel", "evidence", "remedy")))

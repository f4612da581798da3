"""Result of an identification of servos as a JSON object with stable keys."""

from __future__ import annotations

from typing import Any

from armid.servo.score import ClosedLoopError
from armid.study.servos.identification import ServoResult, ServoScore
from armid.study.storage.records import finding_record, study_record

SERVO_FORMAT = 2
"""Number of the format of `servo.json`."""

PARAMETERS = ("inertial", "rotor_inertia", "friction", "stiffness", "damping", "limit", "offset", "delay")
"""Fields of `ServoParameters` in a record."""


def servo_record(result: ServoResult) -> dict[str, Any]:
    """Values with intervals, closed-loop errors, parameters and inputs of an identification of servos."""
    estimate, joints = result.estimate, result.robot.joint_names
    values = [
        {
            "kind": each.kind,
            "joint": joints[each.joint],
            "value": each.value,
            "low": each.low,
            "high": each.high,
            "information": each.information,
            "origin": each.origin,
            "reason": each.reason,
        }
        for each in result.values
    ]
    return {
        "format": SERVO_FORMAT,
        "verdict": "not judged" if result.score is None else result.score.verdict,
        "robot": result.robot.name,
        "joints": list(joints),
        "values": values,
        "parameters": {name: getattr(estimate.parameters, name) for name in PARAMETERS},
        "longest_step": estimate.model.longest_step,
        "laws": [{"symbol": law.symbol, "joint": joints[law.joint], "unit": law.unit} for law in estimate.model.laws],
        "refined": estimate.refined,
        "left_out": {"refined": error_record(estimate.left_out[0]), "first": error_record(estimate.left_out[1])},
        "training": error_record(estimate.training),
        "band": result.band,
        "validation": None if result.score is None else score_record(result.score),
        "noise": {"rms": estimate.fit.rms, "correlation_rows": estimate.fit.correlation},
        "seconds": result.seconds,
        "sha256": {"description": result.robot.sha256, "recordings": list(result.digests)},
        "warnings": [finding_record(each) for each in result.findings],
        "study": study_record(result.study),
    }


def score_record(score: ServoScore) -> dict[str, Any]:
    """Errors on validation runs, and the share of the samples of each joint inside the band of the position."""
    return {
        "model": error_record(score.model),
        "command": error_record(score.command),
        "described": None if score.described is None else error_record(score.described),
        "coverage": score.coverage,
    }


def error_record(error: ClosedLoopError) -> dict[str, Any]:
    """Closed-loop error: of each joint, of each run, and over all [rad or m]."""
    return {"joints": error.joints, "runs": error.runs, "total": error.total}

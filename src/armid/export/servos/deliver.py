"""Files about an identified servo arm for other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from armid.errors import Finding
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.runs.servos.stored_servo import StoredServo
from armid.servo.servo_run import ServoRun

MODEL = "model.xml"


@dataclass(frozen=True, eq=False, slots=True)
class Delivery:
    """Files for other programs.

    Attributes:
        files: Contents of the files, by their name.
        findings: Findings about values that a format cannot store, and about checks of the files.
    """

    files: Mapping[str, bytes]
    findings: tuple[Finding, ...]


def delivered(stored: StoredServo, runs: Sequence[ServoRun]) -> Delivery:
    """Makes the files of a result, and checks them.

    Args:
        stored: The result.
        runs: Runs on which the roll-out of MuJoCo is compared with that of armid.
    """
    return Delivery({MODEL: servo_mjcf(stored.model, stored.parameters)}, ())

"""Data of the page of a servo result: the result, its recordings and the simulated motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from armid.checked_array import Array
from armid.notebook_display import names_apart
from armid.robot import Joint
from armid.runs.servos.servo_recordings import read_servo_runs
from armid.runs.servos.stored_servo import StoredServo
from armid.servo.closed_loop import simulate
from armid.servo.servo_run import ServoRun


@dataclass(frozen=True, eq=False, slots=True)
class ServoPageData:
    """Data of a servo result for the sections of its page.

    Attributes:
        stored: The result.
        role: Role of the recordings that are drawn: those for validation, or those for training if there are none.
        runs: Parts without gaps of these recordings.
        simulated: Simulated positions of each run, shape (N, n) [rad or m].
        missing: Messages about recordings that could not be read.
    """

    stored: StoredServo
    role: Literal["train", "validate"]
    runs: tuple[ServoRun, ...] = ()
    simulated: tuple[Array, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the arm."""
        return self.stored.robot.joints

    @property
    def names(self) -> list[str]:
        """Names of the runs: of their recordings, with a number where a recording has several parts."""
        short = names_apart(run.source for run in self.runs)
        sources = [run.source for run in self.runs]
        return [
            short[source] + (f", part {sources[:k].count(source) + 1}" if sources.count(source) > 1 else "")
            for k, source in enumerate(sources)
        ]


def gather_servo(
    stored: StoredServo, runs: Sequence[ServoRun] | None = None, *, data: Path | str | None = None
) -> ServoPageData:
    """Gathers the recordings of a servo result that are drawn, and simulates their motion.

    Args:
        stored: The result.
        runs: Runs of the role that is drawn, if they are in memory; otherwise they are read again.
        data: Folder that is searched first for recordings.
    """
    role: Literal["train", "validate"] = "train" if stored.errors.score is None else "validate"
    missing: tuple[str, ...] = ()
    if runs is None:
        runs, missing = read_servo_runs(stored, role, data)
    simulated = simulate(stored.model, stored.parameters, runs)
    return ServoPageData(stored, role, tuple(runs), tuple(each.q for each in simulated), missing)

"""Data of a page: the run's records, its processed recordings, and its certificate."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError
from armid.measurement.log_format import LogFormat
from armid.report.data.recording_data import RecordingData, evaluate_recording
from armid.robot import Joint
from armid.runs.certification import Verdict, certify_run
from armid.runs.locate_recording import read_recording_of
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.processed import ProcessedRecording, process_each
from armid.values import Array

__all__ = ["PageData", "choices_of", "gather", "records_of", "velocity_unit", "with_recordings"]

MAX_DRAWN = 3
"""Largest number of plotted recordings of each role; the tables include all."""


@dataclass(frozen=True, eq=False, slots=True)
class PageData:
    """Data of a run for the sections of its page.

    Attributes:
        run: The run.
        study: `study.json`.
        validation: `validation.json`.
        recordings: Its recordings, processed again.
        missing: Messages about recordings that could not be read.
        verdict: Physical consistency of the parameters; `None` if the model has no rigid bodies.
    """

    run: Run
    study: Mapping[str, Any]
    validation: Mapping[str, Any]
    recordings: tuple[RecordingData, ...] = ()
    missing: tuple[str, ...] = ()
    verdict: Verdict | None = None

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The arm's joints."""
        return self.run.robot.joints

    def of_role(self, role: str) -> tuple[RecordingData, ...]:
        """Recordings of a role, `train` or `validate`."""
        return tuple(each for each in self.recordings if each.choice.role == role)

    @property
    def drawn(self) -> tuple[RecordingData, ...]:
        """Recordings to plot: the first few of each role, validation first."""
        return (*self.of_role("validate")[:MAX_DRAWN], *self.of_role("train")[:MAX_DRAWN])

    def training_rms(self) -> Array:
        """RMS error per joint in training (n,) [N·m or N]."""
        return self.run.estimate.fit.residual_rms

    def validation_rms(self) -> Array:
        """RMS error per joint over all validation recordings (n,) [N·m or N]; NaN without one."""
        rows = [_numbers(each["rms"]) for each in self.validation["recordings"]]
        return np.sqrt(np.mean(np.square(rows), axis=0)) if rows else np.full(len(self.joints), np.nan)

    def validation_column(self, key: str) -> Array:
        """Mean per joint (n,) of a number over all validation recordings; NaN without one."""
        rows = [_numbers(each[key]) for each in self.validation["recordings"] if each[key] is not None]
        return np.mean(rows, axis=0) if rows else np.full(len(self.joints), np.nan)


def velocity_unit(joint: Joint) -> str:
    """Unit of a joint's velocity."""
    return f"{joint.unit}/s"


def gather(
    run: Run,
    *,
    recordings: Sequence[ProcessedRecording] | None = None,
    data: Path | str | None = None,
) -> PageData:
    """Gather a run's records, certificate and, if they are still available, its recordings.

    Args:
        run: The run.
        recordings: What the run was made from, where it is at hand and need not be read and processed again.
        data: Folder in which recordings are looked for first, by their path in the study or by their name.

    Raises:
        ArmidError: A record of the run is damaged.
    """
    page_data = with_recordings(run, recordings=recordings, data=data)
    return replace(page_data, verdict=certify_run(run) if run.model.has_rigid_bodies else None)


def with_recordings(
    run: Run,
    *,
    recordings: Sequence[ProcessedRecording] | None = None,
    data: Path | str | None = None,
) -> PageData:
    """Gather a run's records and recordings, without its certificate, which plots do not need.

    Args:
        run: The run.
        recordings: What the run was made from, where it is at hand and need not be read and processed again.
        data: Folder in which recordings are looked for first, by their path in the study or by their name.

    Raises:
        ArmidError: A record of the run is damaged.
    """
    page_data = records_of(run)
    folder = str(page_data.study["folder"])
    processed: list[RecordingData] = []
    missing: list[str] = []
    for choice, sha256 in choices_of(run, page_data.study) if recordings is None else ():
        try:
            read = choice, read_recording_of(run, choice, sha256, folder, data)
            processed += [evaluate_recording(run, each) for each in process_each([read], run.processing, run.robot)]
        except ArmidError as error:
            missing.append(error.problem)
    processed += [evaluate_recording(run, each) for each in recordings or ()]
    return replace(page_data, recordings=tuple(processed), missing=tuple(missing))


def records_of(run: Run) -> PageData:
    """A run's records, without recordings and certificate.

    Raises:
        ArmidError: One of them is damaged.
    """
    return PageData(run, _record(run, "study"), _record(run, "validation"))


def _record(run: Run, name: str) -> dict[str, Any]:
    path = Path(run.folder) / f"{name}.json"
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArmidError(f"{path} cannot be read: {error}.", remedy="identify again.") from error
    if not isinstance(record, dict):
        raise ArmidError(f"{path} does not hold a record of a run.", remedy="identify again.")
    return record


def choices_of(run: Run, study: Mapping[str, Any]) -> list[tuple[RecordingChoice, str]]:
    """The recordings that a run's study names, with their digests (sha256)."""
    choices = [
        RecordingChoice(each["path"], each["role"], LogFormat(**each["reading"]), tuple(each["part"]))
        for each in study["recordings"]
    ]
    return list(zip(choices, _digests(run), strict=True))


def _digests(run: Run) -> list[str]:
    """Digests of the recordings, in the study's order."""
    pairs = [entry.rpartition(" ") for entry in run.estimate.made_from]
    return [sha256 for role, _, sha256 in pairs if role in ("train", "validate")]


def _numbers(values: Any) -> Array:
    """Numbers of a record's list; null becomes NaN."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)

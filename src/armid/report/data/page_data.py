"""Data of a page: records, processed recordings and certificate of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.report.data.recording_data import RecordingData, evaluate_recording
from armid.robot import Joint
from armid.runs.consistency_check import Verdict, certify_run
from armid.runs.locate_recording import read_recording_of
from armid.runs.read_records import RunRecords, read_records, trained_and_validated
from armid.runs.run import Run
from armid.study.config import Study
from armid.study.recordings.processed import ProcessedRecording, judged_without_memory, process_each
from armid.validation.torque_validation import PredictedRecording, Score, Validation

MAX_DRAWN = 3
"""Largest number of plotted recordings of each role; the tables include all."""


@dataclass(frozen=True, eq=False, slots=True)
class PageData:
    """Data of a run for the sections of its page.

    Attributes:
        run: The run.
        records: Study, validation, friction selection and comparison of methods.
        recordings: Measured and predicted torque of the recordings of the run.
        missing: Messages about recordings that could not be read.
        verdict: Physical consistency of the parameters; `None` if the model has no rigid bodies.
    """

    run: Run
    records: RunRecords
    recordings: tuple[RecordingData, ...] = ()
    missing: tuple[str, ...] = ()
    verdict: Verdict | None = None

    @property
    def study(self) -> Study:
        """Study of the run, in which automatic choices are replaced by their results."""
        return self.records.study

    @property
    def validation(self) -> Validation:
        """Result of the validation of the run: torque errors, checks and verdict."""
        return self.records.validation

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the arm."""
        return self.run.robot.joints

    def of_role(self, role: str) -> tuple[RecordingData, ...]:
        """Recordings of the run that have a role, `train` or `validate`."""
        return tuple(each for each in self.recordings if each.choice.role == role)

    @property
    def drawn(self) -> tuple[RecordingData, ...]:
        """Plotted recordings: the first `MAX_DRAWN` for validation, then the first `MAX_DRAWN` for training."""
        return (*self.of_role("validate")[:MAX_DRAWN], *self.of_role("train")[:MAX_DRAWN])

    def training_rms(self) -> Array:
        """RMS torque error of each joint in training, shape (n,) [N·m or N]."""
        return self.run.estimate.fit.residual_rms

    def validation_rms(self) -> Array:
        """RMS torque error of each joint over all validation recordings (n,) [N·m or N]; NaN without recordings."""
        rows = [each.rms for each in self.validation.recordings]
        return np.sqrt(np.mean(np.square(rows), axis=0)) if rows else np.full(len(self.joints), np.nan)

    def validation_column(self, of: Callable[[Score], Array | None]) -> Array:
        """Mean of `of(score)` over all validation recordings, for each joint, shape (n,); NaN without recordings."""
        rows = [row for each in self.validation.recordings if (row := of(each)) is not None]
        return np.mean(rows, axis=0) if rows else np.full(len(self.joints), np.nan)


def velocity_unit(joint: Joint) -> str:
    """Unit of a joint's velocity."""
    return f"{joint.unit}/s"


def gather(
    run: Run,
    *,
    records: RunRecords | None = None,
    recordings: Sequence[tuple[ProcessedRecording, PredictedRecording]] | None = None,
    data: Path | str | None = None,
) -> PageData:
    """Gathers the records and the certificate of a run, and its recordings if they are available.

    Args:
        run: The run.
        records: Records of the run; if not given, they are read from its folder.
        recordings: Processed recordings of the run, each with the predicted torque, if they are in memory.
        data: Folder that is searched first for recordings, by their path in the study or by their name.

    Raises:
        ArmidError: A record of the run is damaged.
    """
    page_data = with_recordings(run, records=records, recordings=recordings, data=data)
    return replace(page_data, verdict=certify_run(run) if run.model.has_rigid_bodies else None)


def with_recordings(
    run: Run,
    *,
    records: RunRecords | None = None,
    recordings: Sequence[tuple[ProcessedRecording, PredictedRecording]] | None = None,
    data: Path | str | None = None,
) -> PageData:
    """Gathers the records and recordings of a run; the certificate, which plots do not need, is left out.

    The arguments and errors are those of `gather`.
    """
    records = records or read_records(run)
    processed: list[RecordingData] = []
    missing: list[str] = []
    for choice, sha256 in trained_and_validated(run, records.study) if recordings is None else ():
        try:
            read = choice, read_recording_of(run, choice, sha256, records.study.folder, data)
            each = judged_without_memory(process_each([read], run.processing, run.robot), run.model)
            processed += [evaluate_recording(run, recording) for recording in each]
        except ArmidError as error:
            missing.append(error.problem)
    processed += [evaluate_recording(run, *each) for each in recordings or ()]
    return PageData(run, records, tuple(processed), tuple(missing))


def stored(run: Run) -> PageData:
    """Page data of a run from its stored records, without recordings and certificate.

    Raises:
        ArmidError: A record is damaged.
    """
    return PageData(run, read_records(run))

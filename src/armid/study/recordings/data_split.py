"""Parts of recordings that a study selects, and the check that the study uses no sample twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from armid.errors import StudyError
from armid.measurement.recording import Recording
from armid.study.config import RecordingChoice

ROWS = ("time", "q", "dq", "ddq", "effort", "command", "valid", "number")
"""Fields of a recording with one entry for each sample."""

FEWEST_ROWS = 10
"""Smallest number of rows of a part of a recording; fewer rows are not sufficient for derivatives and residuals."""


def cut_recording(recording: Recording, part: tuple[float, float]) -> Recording:
    """Part of a recording: its rows between two shares of its length, from 0 (first row) to 1 (last row).

    Raises:
        StudyError: The part is too short to contain a motion.
    """
    if part == (0.0, 1.0):
        return recording
    samples = len(recording.q)
    rows = slice(round(part[0] * samples), round(part[1] * samples))
    if rows.stop - rows.start < FEWEST_ROWS:
        raise StudyError(
            f"{recording.source}: the part from {part[0]:g} to {part[1]:g} of {samples} rows contains only "
            f"{rows.stop - rows.start} rows.",
            remedy=f"choose a part with at least {FEWEST_ROWS} rows.",
        )

    def of(x: object) -> object:
        return None if x is None else x[rows]  # pyright: ignore[reportIndexIssue]

    changed = {name: of(getattr(recording, name)) for name in ROWS}
    return replace(recording, **changed)  # pyright: ignore[reportArgumentType]


def refuse_shared(recordings: Sequence[tuple[RecordingChoice, Recording]]) -> None:
    """Raises an error if samples are used twice: for training and for validation, or twice for training.

    Raises:
        StudyError: A file is listed twice, and its parts overlap.
    """
    for k, (one, a) in enumerate(recordings):
        for other, b in recordings[k + 1 :]:
            apart = one.part[1] <= other.part[0] or other.part[1] <= one.part[0]
            if not a.sha256 or a.sha256 != b.sha256 or apart or {one.role, other.role} == {"validate"}:
                continue
            both = (
                "both are used to train"
                if one.role == other.role
                else "one is used to train and the other to validate"
            )
            raise StudyError(
                f"{one.path} and {other.path} contain the same data (sha256 {a.sha256[:12]}…), but {both}.",
                possible="different recordings, or parts of one recording that do not overlap",
                remedy="use different parts, for instance part = [0.0, 0.7] to train and part = [0.7, 1.0] to "
                "validate.",
            )

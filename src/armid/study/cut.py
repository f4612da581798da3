"""Parts of recordings, and the rule that no sample both trains and validates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from armid.errors import StudyError
from armid.measurement.recording import Recording
from armid.study.study import RecordingChoice

__all__ = ["cut", "refuse_shared"]


def cut(recording: Recording, part: tuple[float, float]) -> Recording:
    """The rows between two shares of a recording's length."""
    if part == (0.0, 1.0):
        return recording
    samples = len(recording.q)
    rows = slice(round(part[0] * samples), round(part[1] * samples))

    def of(x: object) -> object:
        return None if x is None else x[rows]  # pyright: ignore[reportIndexIssue]

    changed = {name: of(getattr(recording, name)) for name in ("time", "q", "dq", "ddq", "effort", "valid")}
    return replace(recording, **changed)  # pyright: ignore[reportArgumentType]


def refuse_shared(recordings: Sequence[tuple[RecordingChoice, Recording]]) -> None:
    """Refuse validation on samples that also train.

    Raises:
        StudyError: One file has both roles, and the parts used overlap.
    """
    for one, a in recordings:
        for other, b in recordings:
            if one.role == "train" and other.role == "validate" and a.sha256 == b.sha256 and a.sha256:
                if one.part[1] <= other.part[0] or other.part[1] <= one.part[0]:
                    continue
                raise StudyError(
                    f"{other.path} is to validate, but the same data train: {one.path}, sha256 {a.sha256[:12]}….",
                    possible="another recording, or parts of one that do not overlap",
                    remedy="for instance part = [0.0, 0.7] to train and part = [0.7, 1.0] to validate.",
                )

"""Gaps that were filled by straight lines before the log reached the doctor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.measurement.recording import Recording
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

CODE = "rows-not-consecutive"


def filled(log: Recording, starts: np.ndarray, rows: int) -> Recording:
    """The log without some stretches of rows, filled in by linear interpolation in all channels."""
    assert log.time is not None
    known = np.ones(log.samples, dtype=bool)
    for start in starts:
        known[start : start + rows] = False
    names = [name for name in ("q", "dq", "ddq", "effort") if getattr(log, name) is not None]
    lines = {
        name: np.column_stack([np.interp(log.time, log.time[known], x[known]) for x in getattr(log, name).T])
        for name in names
    }
    return replace(log, **lines)


def told(case: Case, log: Recording) -> list[tuple[str, str]]:
    found = diagnose_recording(case.robot, log, case.reading)
    return [(f.severity, f.evidence) for f in found if f.code == CODE]


@pytest.mark.parametrize(("count", "rows"), [(12, 30), (4, 8), (20, 100)])
def test_gaps_filled_by_straight_lines_are_named(count: int, rows: int):
    case = sound(11, name="ur10e")
    starts = np.linspace(100, case.recording.samples - 200, count).astype(int)
    ((severity, evidence),) = told(case, filled(case.recording, starts, rows))
    assert severity == "warning" and f"In {count} stretches" in evidence


def test_the_remedy_leaves_the_rows_out_and_ends_the_warning():
    case = sound(11, name="ur10e")
    log = filled(case.recording, np.linspace(100, case.recording.samples - 200, 12).astype(int), 30)
    assert log.time is not None
    valid = np.ones(log.q.shape, dtype=bool)
    for start in np.linspace(100, case.recording.samples - 200, 12).astype(int):
        valid[start - 1 : start + 31] = False  # as the lines of the remedy mark them
    assert told(case, replace(log, valid=valid)) == []


def test_one_short_gap_and_none_are_told_nothing():
    case = sound(11, name="ur10e")
    assert told(case, filled(case.recording, np.array([500]), 30)) == []
    assert told(case, case.recording) == []

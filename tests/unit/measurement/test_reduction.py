"""Reduction of recordings to a lower sample rate while they are read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.catalogue import READERS
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording, select_rows
from armid.measurement.reduction import reduce
from armid.measurement.reduction.reduce import reduce_pieces, reduce_recording
from armid.measurement.reduction.reduced_rate import LOWEST_RATE, MOST_SAMPLES, reduction_step
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb
from armid.robot import load_robot
from armid.study.config import parse_study
from motions import clock, codes, motion, recording
from recordings import write_parquet

RATE = 8000.0
PLAIN = LogFormat()
GAIN = 5e-5
"""Largest relative change of amplitudes in the pass band of the filter (`DECIMATION_ATTENUATION`)."""


def log(seconds: float = 3.0, *, smooth: bool = True, **more: object) -> Recording:
    """A recording at 8 kHz; the effort is the velocity, or friction with a sharp sign."""
    t = clock(seconds, RATE)
    if smooth:
        more = {"effort": motion(t)[1]} | more
    return recording(t, consecutive=True, **more)


def whole(found: Recording) -> Recording:
    """The recording without its findings and the mark of the reduction."""
    return replace(found, findings=(), logged_rate=None)


def test_the_step_depends_on_rate_and_length():
    assert reduction_step(1000, 999.0, None) == reduction_step(1000, 1999.0 * 0.99, None) == 1
    assert reduction_step(1000, 8000.0, None) == 8
    assert reduction_step(1000, 7999.0, None) == 8  # a clock that is a little slow
    assert reduction_step(2 * MOST_SAMPLES, 1000.0, None) == 2
    assert reduction_step(1000 * MOST_SAMPLES, 1000.0, None) == round(1000.0 / LOWEST_RATE)
    assert reduction_step(1000, 8000.0, 0.0) == 1
    assert reduction_step(100 * MOST_SAMPLES, 8000.0, 500.0) == 16


def test_motion_and_torque_stay_those_of_their_times():
    found = reduce_recording(log(), PLAIN)
    assert found.time is not None and found.effort is not None and found.logged_rate == pytest.approx(RATE)
    assert np.allclose(np.diff(found.time), 1e-3, rtol=0.0, atol=1e-12)
    q, dq, _ = motion(found.time)
    assert np.abs(found.q - q).max() < GAIN and np.abs(found.effort - dq).max() < GAIN * np.abs(dq).max()
    assert codes(found.findings) == ["rate-reduced"]
    assert len(found.time) == pytest.approx(3000, abs=20)  # without the ends that the filter reaches


def test_noise_is_averaged():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(round(20 * RATE), 2))
    t = clock(20.0, RATE)
    found = reduce_recording(recording(t, consecutive=True, effort=motion(t)[1] + noise), PLAIN)
    assert found.effort is not None and found.time is not None
    rest = found.effort - motion(found.time)[1]
    # White noise keeps its density, so its variance falls with the rate; the transition band adds to it.
    assert 0.9 / np.sqrt(8.0) < rest.std() < 1.1 / np.sqrt(8.0)


def test_lower_rates_and_other_recordings_are_left_alone():
    slow = recording(clock(3.0, 1000.0))
    assert reduce_recording(slow, PLAIN) is slow
    fast = log()
    assert reduce_recording(fast, LogFormat(highest_rate=0)) is fast
    assert reduce_recording(replace(fast, consecutive=False), PLAIN).samples == fast.samples
    clockless = replace(fast, time=None)
    assert reduce_recording(clockless, PLAIN) is clockless
    once = reduce_recording(fast, PLAIN)
    assert reduce_recording(once, LogFormat(highest_rate=100.0)) is once


@pytest.mark.parametrize("piece", [300, 1024, 5000])
def test_pieces_do_not_change_the_result(piece: int):
    fast = log()
    parts = [reduce._cut(fast, a, a + piece) for a in range(0, fast.samples, piece)]
    found, known = reduce_pieces(parts, fast.samples, PLAIN), reduce_recording(fast, PLAIN)
    for name in ("time", "q", "effort", "valid"):
        assert np.array_equal(getattr(found, name), getattr(known, name)), name


def spoilt(case: str) -> tuple[Recording, LogFormat]:
    """A fast recording whose samples must be treated before they are filtered."""
    fast = log()
    assert fast.time is not None and fast.effort is not None
    effort, time, q = fast.effort.copy(), fast.time.copy(), fast.q.copy()
    if case == "missing":
        effort[12000, 0] = np.nan
    elif case == "repeated":
        q[5000:5010], effort[5000:5010] = q[5000], effort[5000]
    elif case == "bursts":
        time = np.repeat(time[::8], 8) + 2e-5 * (np.arange(len(time)) % 8)
    elif case == "lost":
        keep = np.random.default_rng(0).uniform(size=len(time)) > 0.2
        return replace(fast, time=time[keep], q=q[keep], effort=effort[keep], valid=np.True_), PLAIN
    changed = replace(fast, time=time, q=q, effort=effort)
    if case == "numbered":
        return replace(changed, number=np.arange(fast.samples)), PLAIN
    if case == "clockless":
        return replace(changed, time=None, rate=RATE), LogFormat(rate=RATE)
    formats = {"excluded": LogFormat(exclude=[[1.0, 1.5]]), "mixed": LogFormat(units=("deg", "rad"))}
    return changed, formats.get(case, PLAIN)


@pytest.mark.parametrize(
    "case", ["missing", "repeated", "bursts", "lost", "numbered", "clockless", "excluded", "mixed"]
)
def test_samples_that_must_be_treated_first_are_not_reduced(case: str):
    recording_, log_format = spoilt(case)
    assert reduce_recording(recording_, log_format) is recording_


def test_nothing_is_filtered_across_a_gap():
    fast = log()
    assert fast.time is not None
    keep = (fast.time < 1.0) | (fast.time > 1.5)
    found = reduce_recording(replace(select_rows(fast, keep), number=None), PLAIN)
    assert found.time is not None and found.effort is not None
    steps = np.diff(found.time)
    assert (steps > 2e-3).sum() == 1 and 0.5 < steps.max() < 0.53  # the gap and the reach of the filter
    assert np.abs(found.effort - motion(found.time)[1]).max() < 1e-3


def test_a_spike_does_not_spread():
    fast = log()
    assert fast.effort is not None
    effort, q = fast.effort.copy(), fast.q.copy()
    effort[9000, 1], q[15000, 0] = 1e6, 40.0
    found = reduce_recording(replace(fast, effort=effort, q=q), PLAIN)
    assert found.effort is not None and found.time is not None
    assert codes(found.findings).count("spikes") == 2
    # A sample of 8 kHz is interpolated, by less than the motion in a step.
    assert np.abs(found.effort - motion(found.time)[1]).max() < 1e-3
    assert np.abs(found.q - motion(found.time)[0]).max() < 1e-3
    assert not found.valid[np.argmin(np.abs(found.time - 9000 / RATE)), 1]
    kept = reduce_recording(replace(fast, effort=effort), LogFormat(spikes="keep"))
    assert kept.effort is not None and np.abs(kept.effort).max() > 1e4


@pytest.mark.parametrize(("units", "turn"), [(None, 2 * np.pi), ("deg", 360.0)])
def test_wrapped_angles_become_continuous(units: str | None, turn: float):
    t = clock(3.0, RATE)
    angle = turn * np.column_stack([0.7 * t, 0.4 - 0.9 * t])
    wrapped = (angle + turn / 2) % turn - turn / 2
    found = reduce_recording(recording(t, consecutive=True, q=wrapped), LogFormat(units=units))  # pyright: ignore[reportArgumentType]
    assert found.time is not None
    expected = turn * np.column_stack([0.7 * found.time, 0.4 - 0.9 * found.time])
    off = found.q - expected
    assert np.ptp(off, axis=0).max() < GAIN * turn
    assert np.abs(off / turn - np.round(off / turn)).max() < GAIN
    assert "position-wrapped" in codes(found.findings)


def test_a_file_with_a_missing_value_is_read_as_a_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("armid.measurement.readers.PIECE", 4000)
    fast, _ = spoilt("missing")
    assert fast.time is not None and fast.effort is not None
    table = {"t": fast.time, "q1": fast.q[:, 0], "q2": fast.q[:, 1]}
    table |= {"tau1": fast.effort[:, 0], "tau2": fast.effort[:, 1]}
    found = load_recording(written(tmp_path / "log.parquet", table))
    assert found.samples == fast.samples and found.logged_rate is None
    assert found.effort is not None and np.isnan(found.effort).sum() == 1


def test_findings_name_the_time_and_each_jump_once():
    """Ends of pieces are examined twice, with the piece before and the one behind."""
    t = clock(20.0, RATE)
    angle = np.column_stack([2.0 * t, 0.4 - 0.3 * t])
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    effort = motion(t)[1].copy()
    effort[144_000, 0] = 1e5
    found = reduce_recording(recording(t, consecutive=True, q=wrapped, effort=effort), PLAIN)
    jumps = [each for each in found.findings if each.code == "position-wrapped" and each.channel == "1"]
    assert len(jumps) == 1 and "6 times" not in jumps[0].evidence
    (spike,) = [each for each in found.findings if each.code == "spikes"]
    assert "t = 18.000 s" in spike.evidence and "other stretches" not in spike.evidence


def written(path: Path, table: dict[str, np.ndarray]) -> Path:
    """Path of a file of the format of its suffix with columns of numbers."""
    if path.suffix == ".parquet":
        pytest.importorskip("pyarrow")
        write_parquet(path, table)
    elif path.suffix == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, values in table.items():
                file[name] = values
    else:
        rows = np.column_stack(list(table.values()))
        np.savetxt(path, rows, "%.17g", ";" if path.stem == "other" else ",", header=",".join(table), comments="")
        if path.stem == "other":
            path.write_text("# a note\n" + path.read_text().replace(",", ";"))
    return path


@pytest.mark.parametrize("name", ["log.parquet", "log.h5", "log.csv", "other.csv"])
def test_files_are_read_in_pieces(tmp_path, monkeypatch, name: str):
    """Pieces give what the whole file gives, for every reader that has pieces."""
    t = clock(3.0, RATE)
    q, dq, _ = motion(t)
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": dq[:, 0], "tau2": dq[:, 1]}
    path = written(tmp_path / name, table)
    form = next(each for each in READERS.values() if path.suffix in each.suffixes)
    known = reduce_recording(form.reader.read(path, PLAIN), PLAIN)
    monkeypatch.setattr("armid.measurement.readers.csv.LONG", 0)
    monkeypatch.setattr("armid.measurement.readers.csv.HEAD", 50_000)
    monkeypatch.setattr("armid.measurement.readers.PIECE", 4000)
    assert form.piece_reader is not None
    pieces = form.piece_reader.pieces(path, PLAIN, None, 4000)
    assert pieces is not None and len(list(pieces.pieces)) in (6, 7)
    assert pieces.samples == pytest.approx(len(t), rel=0.1)  # lines of a text have different lengths
    found = load_recording(path)
    assert found.time is not None and known.time is not None
    for quantity in ("time", "q", "effort"):
        assert np.array_equal(getattr(found, quantity), getattr(known, quantity)), quantity
    assert codes(found.findings) == codes(known.findings) and found.findings[-1] == known.findings[-1]
    assert found.source == str(path) and len(found.sha256) == 64
    every = load_recording(path, LogFormat(highest_rate=0))
    assert every.samples == len(t) and np.array_equal(every.q, q)


def test_errors_and_the_end_of_a_long_table_are_those_of_the_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("armid.measurement.readers.csv.LONG", 0)
    monkeypatch.setattr("armid.measurement.readers.csv.HEAD", 2000)
    monkeypatch.setattr("armid.measurement.readers.PIECE", 500)
    t = clock(3.0, 500.0)
    q, dq, _ = motion(t)
    path = written(tmp_path / "log.csv", {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": dq[:, 0], "tau2": dq[:, 1]})
    text = path.read_text()
    path.write_text(text[:-40].rstrip("0123456789."))
    found = load_recording(path)
    assert found.samples == len(t) - 1 and "row-incomplete" in codes(found.findings)
    lines = text.splitlines()
    lines[1200] = lines[1200].replace(",", ",x", 1)
    path.write_text("\n".join(lines))
    with pytest.raises(RecordingError, match="line 1201"):
        load_recording(path)


def test_dry_friction_is_found_as_at_the_full_rate():
    """The column of the friction has passed the filter of the torque."""
    names = load_robot("iiwa14-r820").joint_names
    model = DynamicsModel(load_robot("iiwa14-r820", lock=list(names[2:])), (Coulomb(),))
    found = reduce_recording(log(40.0, smooth=False), LogFormat(highest_rate=100.0))
    observations, _ = process_recordings([found], ProcessingOptions(cutoff=5.0), periods=[None])
    (run,) = observations.runs
    off = {
        filtered: np.linalg.norm(10.0 * model.term_columns(motion).values.T - run.torque)
        for filtered, motion in ((True, run.motion), (False, replace(run.motion, sign_deviation=None)))
    }
    # What is left is the shift of reversals by the low-pass filter of the positions.
    assert off[True] < 0.3 * off[False]


def test_a_cut_off_above_the_reduced_band_is_refused():
    found = reduce_recording(log(20.0), LogFormat(highest_rate=50.0))
    with pytest.raises(RecordingError, match="reduced from 8000 Hz to 50 Hz") as refused:
        process_recordings([found], ProcessingOptions(cutoff=10.0))
    assert "highest_rate = 80" in str(refused.value)


@pytest.mark.parametrize("options", [{"family": "none"}, {"decimate": 0.0}, {"edges": "periodic"}])
def test_a_reduced_recording_is_refused_where_all_samples_are_needed(options: dict[str, object]):
    found = reduce_recording(log(20.0), PLAIN)
    with pytest.raises(RecordingError, match="all samples are needed") as refused:
        process_recordings([found], ProcessingOptions(**options))  # pyright: ignore[reportArgumentType]
    assert "highest_rate = 0" in str(refused.value)


def test_studies_whose_rows_are_samples_keep_them():
    table = {
        "robot": {"description": "ur10e"},
        "recording": [{"path": "a.csv"}, {"path": "b.csv", "highest_rate": 500}],
    }
    for processing, rates in (
        ({}, (None, 500.0)),
        ({"family": "none"}, (0.0, 500.0)),
        ({"decimate": 0}, (0.0, 500.0)),
        ({"columns": False}, (0.0, 500.0)),
        ({"edges": "periodic"}, (0.0, 500.0)),
    ):
        study = parse_study(table | {"processing": processing})
        assert tuple(each.reading.highest_rate for each in study.recordings) == rates


@pytest.mark.parametrize("value", [-1.0, "fast", True, np.nan])
def test_a_highest_rate_is_a_number(value: object):
    with pytest.raises(RecordingError, match="highest_rate"):
        LogFormat(highest_rate=value)  # pyright: ignore[reportArgumentType]

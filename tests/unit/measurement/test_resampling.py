"""Clocks made even: gaps, jitter, missing samples."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.pipeline import ProcessingOptions, process_recording
from armid.measurement.processing.row_checks import clean
from armid.measurement.processing.uniform_runs import Segment, is_even, jitter, uniform
from armid.measurement.recording import Recording
from motions import clock, codes, motion, one, recording


def test_a_gap_splits_the_run_and_is_named():
    t = np.r_[clock(5.0), 5.16 + clock(6.0)]
    runs, findings = process_recording(recording(t), ProcessingOptions(family="none"))
    assert [run.motion.samples for run in runs] == [500, 600]
    assert codes(findings) == ["clock-gap"] and "0.17 s" in findings[0].evidence
    # Across the gap nothing is differentiated: velocities stay those of the motion.
    for run in runs:
        assert np.abs(run.motion.dq - motion(run.motion.time)[1]).max() < 1e-2


def test_a_gap_is_told_from_the_start_of_the_log():
    t = np.r_[clock(5.0), 5.16 + clock(6.0)]
    for start in (0.0, 1.7e9):  # seconds since 1970 are those of most clocks of computers
        _, (finding,) = process_recording(recording(start + t), ProcessingOptions(family="none"))
        assert "from 4.99 s after the start of the log" in finding.evidence


def test_a_short_step_is_no_gap_for_a_low_cutoff_but_one_for_none():
    t = np.delete(clock(10.0), slice(500, 504))  # four samples lost: 50 ms, a quarter of a period of 5 Hz
    runs, findings = process_recording(recording(t), ProcessingOptions())
    assert len(runs) == 1 and codes(findings) == ["clock-jitter"]
    t = np.delete(clock(10.0), slice(500, 505))
    assert len(process_recording(recording(t), ProcessingOptions(cutoff=2.0))[0]) == 1
    assert len(process_recording(recording(t), ProcessingOptions())[0]) == 2
    assert len(process_recording(recording(t), ProcessingOptions(family="none"))[0]) == 2


def test_packets_lost_at_random_cost_no_rows():
    rng = np.random.default_rng(3)
    t = clock(20.0)[np.sort(rng.choice(2000, 1800, replace=False))]  # a tenth is lost; steps of up to 50 ms
    whole, _ = one(recording(clock(20.0)), ProcessingOptions())
    run, findings = one(recording(t), ProcessingOptions())
    assert codes(findings) == ["clock-jitter"]
    assert run.mask.sum() >= 0.97 * whole.mask.sum()
    q, dq, _ = motion(run.motion.time)
    inner = slice(100, -100)  # away from the ends, which are left out
    assert np.abs(run.motion.q - q)[inner].max() < 1e-4  # a spline over 50 ms of motion at 0.5 Hz: 1e-5
    assert np.abs(run.motion.dq - dq)[inner].max() < 1e-3


def test_many_gaps_and_lost_runs_are_one_finding_each():
    t = np.concatenate([3.0 * k + clock(0.6 if k % 2 else 2.5) for k in range(10)])
    runs, findings = process_recording(recording(t), ProcessingOptions())
    assert len(runs) == 5 and codes(findings) == ["clock-gap", "run-short"]
    gap, lost = findings
    assert "9 gaps; 12.2 s" in gap.evidence and "2.49 s after the start" in gap.evidence
    assert "No row of 5 runs of 0.6 to 0.6 s" in lost.evidence and "together 3 s" in lost.evidence


def test_a_stub_between_gaps_is_left_out_and_named():
    t = np.r_[clock(0.3), 1.0 + clock(6.0)]
    runs, findings = process_recording(recording(t), ProcessingOptions())
    assert len(runs) == 1 and runs[0].motion.time[0] == 1.0
    assert codes(findings) == ["clock-gap", "run-short"]
    with pytest.raises(RecordingError, match=r"no row is left.*0\.5 s at each end"):
        process_recording(recording(clock(0.9)), ProcessingOptions())


def test_a_jittered_clock_is_moved_to_a_multiple_of_the_row_rate():
    rng = np.random.default_rng(1)
    t = (np.arange(2000) + rng.uniform(-0.4, 0.4, 2000)) / 97.0
    run, findings = one(recording(t), ProcessingOptions())
    assert codes(findings) == ["clock-jitter"]
    assert (run.rate, run.step) == (100.0, 4)
    np.testing.assert_allclose(np.diff(run.motion.time), 0.01, rtol=1e-9)
    q, _, ddq = motion(run.motion.time)
    kept = run.rows[run.mask[:, 0]]
    assert np.abs(run.motion.q - q)[kept].max() < 1e-4
    assert np.abs(run.motion.ddq - ddq)[kept].max() < 1e-3 * np.abs(ddq).max()


@pytest.mark.parametrize("timed", [True, False])
def test_samples_left_out_of_an_even_clock_are_filled_and_no_other_is_moved(timed: bool):
    t = clock(20.0, 1000.0)
    again = np.arange(len(t))
    lost = np.sort(np.random.default_rng(4).choice(len(t) // 4, 600, replace=False)) * 4 + 2
    again[lost] -= 1
    q, dq, _ = motion(t)
    x = {"q": q[again], "effort": dq[again], "source": "log.csv"}
    raw = Recording(time=t, **x) if timed else Recording(time=None, rate=1000.0, **x)
    log, noticed = clean(raw, LogFormat())
    assert codes(noticed) == ["rows-repeated"]
    run, findings = one(log, ProcessingOptions())
    assert codes(findings) == ["rows-filled"] and "600 of 20000" in findings[0].evidence
    assert run.rate == 1000.0
    kept = np.isin(np.arange(len(t)), lost, invert=True)
    np.testing.assert_array_equal(run.torque[kept], dq[kept])
    np.testing.assert_allclose(run.motion.time, t, rtol=0, atol=1e-12)
    assert np.abs(run.torque - dq).max() < 1e-6


def test_jitter_is_that_of_the_stamps_as_recorded_whatever_was_left_out():
    t = clock(20.0) + 1e-3 * np.random.default_rng(5).normal(size=2000)
    number = np.flatnonzero(np.random.default_rng(6).random(2000) > 0.1)
    assert jitter(t[number], number) == pytest.approx(jitter(t), rel=0.1)
    assert jitter(t[number]) > 10 * jitter(t)
    _, findings = one(recording(t[number], number=number), ProcessingOptions(cutoff=2.0))
    assert codes(findings) == ["clock-jitter"]
    assert "by 0.099 steps (standard deviation) from a uniform clock of 99.995 Hz" in findings[0].evidence


def test_a_jittered_clock_is_left_where_nothing_needs_an_even_one():
    rng = np.random.default_rng(1)
    t = (np.arange(500) + rng.uniform(-0.4, 0.4, 500)) / 97.0
    _, dq, ddq = motion(t)
    log = recording(t, dq=dq, ddq=ddq)
    run, findings = one(log, ProcessingOptions(family="none"))
    assert np.array_equal(run.motion.time, t) and np.array_equal(run.torque, log.effort)
    assert codes(findings) == ["clock-jitter"] and "were not interpolated" in findings[0].remedy


def test_jitter_is_measured_in_steps_and_a_lost_sample_near_an_end_is_seen():
    t = clock(100.0)
    assert jitter(t) < 1e-9 and is_even(t) and is_even(t[:2])
    noisy = t + 0.002 * np.random.default_rng(2).normal(size=len(t))
    assert jitter(noisy) == pytest.approx(0.2, rel=0.05) and not is_even(noisy)
    lost = np.delete(t, 3)
    assert jitter(lost) < 0.05 and not is_even(lost)


def test_a_rate_stands_for_a_missing_clock_and_neither_is_refused():
    t = clock(5.0)
    run, _ = one(recording(t, time=None, rate=100.0), ProcessingOptions())
    assert run.rate == 100.0
    np.testing.assert_allclose(run.motion.time, t, atol=1e-12)
    with pytest.raises(RecordingError, match="no time column"):
        process_recording(recording(t, time=None), ProcessingOptions())


def test_bad_clocks_and_values_are_refused_with_the_sample():
    t = clock(5.0)
    with pytest.raises(RecordingError, match=r"does not increase from t = 1\.99 s \(sample 199\)"):
        process_recording(recording(np.r_[t[:200], t[150:]]), ProcessingOptions())
    effort = np.ones((500, 2))
    effort[123, 1] = np.nan
    with pytest.raises(RecordingError, match="sample 123"):
        process_recording(recording(t, effort=effort), ProcessingOptions())
    with pytest.raises(RecordingError, match="no effort"):
        process_recording(recording(t, effort=None), ProcessingOptions())


def test_a_cutoff_above_half_the_rate_is_refused():
    with pytest.raises(Exception, match="between 0 and 50 Hz"):
        process_recording(recording(clock(5.0)), ProcessingOptions(cutoff=60.0))


def test_uniform_marks_samples_beside_a_bad_one():
    t = np.array([0.0, 1.0, 2.0, 3.5, 4.5, 6.0])
    bad = np.zeros((6, 1), dtype=bool)
    bad[3] = True
    x = t[:, None]
    even = uniform(Segment(t, 1.0, x, x, None, x, bad), 1.0)
    assert np.array_equal(np.flatnonzero(even.bad), [2, 3, 4])
    np.testing.assert_allclose(even.q[:, 0], np.arange(7.0), atol=1e-12)
    assert even.ddq is None and even.dq is not None


def test_stamps_a_billionth_of_a_second_apart_between_gaps_make_no_long_filter():
    t = clock(30.0)
    t[1000:] += 1.0
    t[1001:] += 1.0
    t = np.insert(t, 1001, t[1000] + 1e-9)
    runs, findings = process_recording(recording(t), ProcessingOptions())
    assert len(runs) == 2 and codes(findings) == ["clock-gap", "clock-gap", "run-short"]
    assert "2 samples in 2e-09 s, less than a period of the cut-off of 5 Hz" in findings[-1].evidence


@pytest.mark.parametrize("unit", [1e-9, 1e-12])
def test_a_clock_of_much_too_short_steps_is_refused_with_what_to_check(unit: float):
    with pytest.raises(RecordingError, match=r"in 3e-\d+ s, less than a period of the cut-off") as caught:
        process_recording(recording(clock(30.0) * unit), ProcessingOptions())
    assert "`time_unit`" in caught.value.remedy


@pytest.mark.parametrize("row", [1, 1500, -1])
def test_a_stamp_far_away_is_a_gap_like_another(row: int):
    t = clock(30.0)
    t[row:] += 1e9
    runs, findings = process_recording(recording(t), ProcessingOptions(), period="find")
    assert findings[0].code == "clock-gap" and sum(run.motion.samples for run in runs) >= len(t) - 1

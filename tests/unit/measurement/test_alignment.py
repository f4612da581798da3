"""Repetitions of a motion: where they are, how late, and their mean."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.processing.pipeline import ProcessingOptions, process_recording
from armid.measurement.processing.repetitions import average, windows
from armid.measurement.processing.uniform_runs import Segment, cut_at_gaps
from motions import PERIOD, clock, codes, motion, one, recording


def test_repetitions_are_blocks_and_what_lies_around_them_is_approach():
    t = clock(34.0)
    run, _ = one(recording(t), ProcessingOptions(), period=PERIOD, start=2.0)
    times = run.motion.time[run.rows]
    kept = run.mask.all(axis=1)
    assert np.array_equal(kept, (times >= 2.0) & (times < 32.0))
    assert np.array_equal(run.block[kept], ((times[kept] - 2.0) // PERIOD).astype(int) + run.block[kept][0])


def test_unaveraged_periodic_runs_are_cut_to_whole_repetitions():
    run, _ = one(recording(clock(34.0)), ProcessingOptions(edges="periodic"), period=PERIOD, start=2.0)
    assert run.motion.samples == 3000 and run.motion.time[0] == 2.0
    assert run.mask.all() and np.array_equal(np.bincount(run.block), [250, 250, 250])
    assert np.abs(run.motion.q - motion(run.motion.time)[0]).max() < 1e-7


@pytest.mark.parametrize("repetitions", [4, 16])
def test_averaging_lowers_the_noise_by_the_root_of_the_repetitions(repetitions: int):
    t = clock(PERIOD * repetitions)
    log = recording(t, noise=1e-3)
    run, findings = one(
        log, ProcessingOptions(edges="periodic", average=True, family="none", trim=0.0), period=PERIOD
    )
    assert run.motion.samples == 1000 and not findings
    assert run.mask.all() and run.block.max() == 9  # one period: blocks of a second
    noise = np.std(run.motion.q - motion(run.motion.time)[0])
    # 2000 values: their deviation is known to 1/√4000 = 1.6 %; five of these.
    assert noise == pytest.approx(1e-3 / np.sqrt(repetitions), rel=0.08)


def test_late_repetitions_are_aligned_by_whole_samples_and_the_rest():
    delays = np.array([0.0, 0.003, 0.0217, -0.0134])  # s, at 100 Hz: 0.3, 2.17 and -1.34 samples
    t = clock(PERIOD * 4)
    late = t - delays[np.minimum(t // PERIOD, 3).astype(int)]
    log = recording(t, q=motion(late)[0], effort=motion(late)[1])
    run, findings = one(log, ProcessingOptions(edges="periodic", average=True, cutoff=20.0), period=PERIOD)
    q, dq, _ = motion(run.motion.time)
    # Moved by whole samples, a window still holds one sample of its neighbour, off by at most 3.5 samples: the
    # delay errs by 3.5 / 1000 of a sample, 3.5e-5 s, at 1 rad/s and 1 rad/s²; the mean of four by less.
    assert np.abs(run.motion.q - q)[10:-10].max() < 3.5e-5
    assert np.abs(run.torque - dq)[10:-10].max() < 3.5e-5
    assert codes(findings) == ["period-misaligned"] and findings[0].severity == "info"
    assert "2.2 samples" in findings[0].evidence


def test_a_repetition_after_a_pause_is_taken_from_where_it_begins():
    moving = clock(PERIOD)
    q = np.concatenate([motion(moving)[0], np.repeat(motion(np.zeros(1))[0], 30, axis=0), motion(moving)[0]])
    t = clock(len(q) / 100.0)
    log = recording(t, q=q, effort=q)
    run, findings = one(log, ProcessingOptions(edges="periodic", average=True, cutoff=20.0), period=PERIOD)
    # Once the window has left the pause, both repetitions are the same.
    assert np.abs(run.motion.q - motion(run.motion.time)[0]).max() < 1e-7
    assert codes(findings) == ["period-misaligned"] and "+0.3 s" in findings[0].evidence


def test_a_sample_that_is_bad_in_one_repetition_does_not_count_in_the_mean():
    valid = np.ones((3000, 2), dtype=bool)
    valid[1500, 1] = False
    log = recording(clock(30.0), valid=valid)
    run, _ = one(log, ProcessingOptions(edges="periodic", average=True), period=PERIOD)
    assert run.mask[:, 0].all()
    assert np.array_equal(run.motion.time[run.rows[~run.mask[:, 1]]], [4.92, 4.96, 5.0, 5.04, 5.08])


def test_differences_of_a_periodic_run_wrap_around():
    run, _ = one(recording(clock(PERIOD, 20.0)), ProcessingOptions(edges="periodic", cutoff=5.0))
    _, dq, ddq = motion(run.motion.time)
    for have, true in ((run.motion.dq, dq), (run.motion.ddq, ddq)):
        error = np.abs(have - true)
        # One-sided formulas at the ends would err 2 and 11 times more than the central ones inside.
        assert error[[0, -1]].max() < 1.5 * error[1:-1].max()


def test_a_fraction_of_a_sample_a_period_is_taken_up_by_the_alignment():
    rate = 100.003  # 0.03 samples a period, 0.12 in all
    t = np.arange(round(40 * rate)) / rate
    run, findings = one(recording(t), ProcessingOptions(edges="periodic", average=True), period=PERIOD)
    assert run.rate == 100.003 and not findings
    _, findings = one(recording(t), ProcessingOptions(edges="periodic"), period=PERIOD)
    assert codes(findings) == ["clock-jitter"]


def test_a_delay_is_recovered_exactly_from_windows_that_close():
    t = clock(PERIOD)
    pieces = [
        Segment(t, 100.0, motion(t - d)[0], None, None, motion(t - d)[1], np.zeros((1000, 2), dtype=bool))
        for d in (0.0, 0.0123, -0.5)
    ]
    mean, findings = average([(piece, 0) for piece in pieces], PERIOD, "log")
    assert np.abs(mean.q - motion(t)[0]).max() < 1e-9
    assert np.abs(mean.effort - motion(t)[1]).max() < 1e-9
    assert "-0.5 s" in findings[0].evidence


def test_a_wrong_period_is_a_warning_or_refused():
    log = recording(clock(40.0))
    (segment,), _ = cut_at_gaps(log, None)
    _, findings = average([(segment, begin) for begin in windows(segment, 9.0, 0.0)], 9.0, "log")
    assert codes(findings) == ["period-misaligned"] and findings[0].severity == "warning"
    with pytest.raises(RecordingError, match=r"ends .* from where it began"):
        process_recording(log, ProcessingOptions(edges="periodic"), period=9.0)
    with pytest.raises(RecordingError, match="no whole period of 60 s"):
        process_recording(log, ProcessingOptions(edges="periodic"), period=60.0)


def test_a_run_that_does_not_close_cannot_have_periodic_edges():
    with pytest.raises(RecordingError, match='edges = "periodic", but joint'):
        process_recording(recording(clock(13.0)), ProcessingOptions(edges="periodic"))
    with pytest.raises(RecordingError, match="a gap splits the run"):
        process_recording(recording(np.r_[clock(5.0), 6.0 + clock(4.0)]), ProcessingOptions(edges="periodic"))


def test_a_gap_costs_averaging_only_the_repetition_it_hits():
    t = clock(40.0)
    log = recording(np.delete(t, slice(1200, 1300)))
    run, findings = one(log, ProcessingOptions(edges="periodic", average=True), period=PERIOD)
    assert run.motion.samples == 1000 and codes(findings) == ["clock-gap"]
    assert np.abs(run.motion.q - motion(run.motion.time)[0]).max() < 1e-7


@pytest.mark.parametrize("average_them", [False, True])
def test_a_period_that_is_no_whole_number_of_samples_is_resampled(average_them: bool):
    rate = 97.3431
    t = np.arange(round(30 * rate) + 1) / rate
    run, findings = one(recording(t), ProcessingOptions(edges="periodic", average=average_them), period=PERIOD)
    assert codes(findings) == ["clock-jitter"]
    repetitions = 1 if average_them else 3
    assert run.motion.samples == 1000 * repetitions and run.step == 4
    q, _, ddq = motion(run.motion.time)
    assert np.abs(run.motion.q - q).max() < 1e-5  # the spline at 100 Hz, see test_sampling
    assert np.abs(run.motion.ddq - ddq).max() < 2e-3 * np.abs(ddq).max()


def test_a_single_jittered_period_is_closed_from_its_own_beginning():
    rng = np.random.default_rng(4)
    t = (np.arange(970) + rng.uniform(-0.3, 0.3, 970)) / 97.0
    t -= t[0]
    run, _ = one(recording(t), ProcessingOptions(edges="periodic"), period=PERIOD)
    assert run.motion.samples == 1000
    assert np.abs(run.motion.q - motion(run.motion.time)[0]).max() < 1e-4


def test_rows_go_round_a_period_of_any_length():
    for samples, step in ((1000, 4), (1001, 1), (1002, 3), (1003, 1)):
        t = np.arange(samples) * PERIOD / samples
        run, _ = one(recording(t), ProcessingOptions(edges="periodic"), period=PERIOD)
        assert (run.motion.samples, run.step) == (samples, step)


def test_a_log_that_lacks_its_last_sample_still_has_its_last_repetition():
    segment, _ = cut_at_gaps(recording(clock(20.0)[:-1]), None)
    assert windows(segment[0], PERIOD, 0.0) == [0, 999]
    assert windows(segment[0], PERIOD, 2.0) == [200]
    assert windows(segment[0], 30.0, 0.0) == []

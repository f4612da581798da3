"""Recordings made into observations: options, motion, masks, bands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import RecordingError, StudyError
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.processing.options import THESIS
from armid.measurement.processing.pipeline import (
    ProcessingOptions,
    process_recording,
    process_recordings,
    resolve_options,
)
from motions import PERIOD, clock, codes, motion, one, recording

# Options -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cutoff": -1.0}, "cutoff must be a number above 0"),
        ({"cutoff": "automatic"}, 'or "auto"'),
        ({"cutoff": True}, "cutoff"),
        ({"order": 0}, "`order` must be a whole number"),
        ({"order": 4.0}, "`order` must be a whole number"),
        ({"family": "bessel"}, "butterworth, fir, none"),
        ({"edges": "reflect"}, "drop, periodic, pad"),
        ({"derivatives": "spline"}, "given, velocity, central, periodic, filter"),
        ({"columns": 1}, "columns = 1"),
        ({"decimate": -5.0}, "decimate"),
        ({"decimate": float("nan")}, "decimate"),
        ({"trim": -0.1}, "trim"),
        ({"slow": float("inf")}, "slow"),
        ({"motion_cutoff": 0.0}, "motion_cutoff"),
        ({"saturation": 1.5}, "share of the effort limit"),
        ({"standstill": "mask"}, "drop, keep"),
        ({"average": True}, "because the mean of the repetitions is one closed period"),
        ({"derivatives": "periodic"}, 'needs edges = "periodic"'),
        ({"derivatives": "filter", "family": "none"}, "computes derivatives with the filter"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, object], message: str):
    with pytest.raises(StudyError, match=message):
        ProcessingOptions(**options)  # pyright: ignore[reportArgumentType]


def test_whole_numbers_from_a_study_are_taken_as_numbers():
    assert ProcessingOptions(cutoff=5, trim=0, family="none").trim == 0.0
    assert isinstance(ProcessingOptions(cutoff=5).cutoff, float)


def test_the_band_is_what_the_options_say():
    band = ProcessingOptions(cutoff=4.0, order=6, family="fir", edges="pad", columns=False).band
    assert (band.family, band.cutoff, band.order, band.edges, band.columns) == ("fir", 4.0, 6, "pad", False)
    assert ProcessingOptions(family="none").band.is_open
    with pytest.raises(StudyError, match="not yet been replaced"):
        _ = ProcessingOptions(cutoff="auto").band


def test_the_preset_of_the_thesis_is_section_3_2_2():
    assert (THESIS.order, THESIS.cutoff, THESIS.motion_cutoff) == (20, 3.5, 3.0)
    assert (THESIS.columns, THESIS.average, THESIS.derivatives) == (False, True, "central")


# Motion --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("derivatives", ["central", "filter"])
@pytest.mark.parametrize("family", ["butterworth", "fir"])
def test_kept_rows_hold_the_true_motion(derivatives: str, family: str):
    run, _ = one(recording(clock(20.0)), ProcessingOptions(derivatives=derivatives, family=family))  # pyright: ignore[reportArgumentType]
    q, dq, ddq = motion(run.motion.time)
    kept = run.rows[run.mask.all(axis=1)]
    # Three-point differences at 100 Hz lose (ω/rate)²/6 = 1.6e-4 of 0.5 Hz; the FIR ripples by 1e-3.
    bound = 1e-3 if family == "butterworth" else 3e-3
    for have, true in ((run.motion.q, q), (run.motion.dq, dq), (run.motion.ddq, ddq)):
        assert np.abs(have - true)[kept].max() < bound * np.abs(true).max()
    assert np.array_equal(run.torque, 10.0 * np.sign(dq))  # the band is applied later, to both sides


@pytest.mark.parametrize("derivatives", ["central", "periodic", "filter"])
def test_periodic_edges_are_exact_to_the_last_row(derivatives: str):
    log = recording(clock(PERIOD, 1000.0))
    run, _ = one(log, ProcessingOptions(edges="periodic", derivatives=derivatives))  # pyright: ignore[reportArgumentType]
    assert run.mask.all()
    q, dq, ddq = motion(run.motion.time)
    # Gain at 0.5 Hz: 1 - (0.5/5)^8; differences at 1 kHz: (ω/rate)²/6 = 2e-6 of a velocity of order one.
    assert np.abs(run.motion.q - q).max() < 1e-7
    assert np.abs(run.motion.dq - dq).max() < 5e-6
    assert np.abs(run.motion.ddq - ddq).max() < 1e-5


def test_recorded_derivatives_are_used_as_they_stand_only_if_both_are_there():
    t = clock(10.0)
    q, dq, ddq = motion(t)
    wrong = np.full_like(q, 7.0)  # recognisable
    run, _ = one(recording(t, dq=wrong, ddq=2 * wrong), ProcessingOptions())
    assert np.array_equal(run.motion.dq, wrong) and np.array_equal(run.motion.ddq, 2 * wrong)
    assert np.array_equal(run.motion.q, q)
    run, _ = one(recording(t, dq=wrong), ProcessingOptions())  # velocities alone: filtered, differentiated once
    assert np.allclose(run.motion.dq, 7.0, atol=1e-9) and np.allclose(run.motion.ddq, 0.0, atol=1e-6)
    run, _ = one(recording(t, dq=wrong), ProcessingOptions(derivatives="central"))
    assert np.abs(run.motion.dq - dq)[100:-100].max() < 1e-2
    run, _ = one(recording(t, dq=dq), ProcessingOptions(derivatives="velocity"))
    assert np.abs(run.motion.ddq - ddq)[100:-100].max() < 1e-2
    run, _ = one(recording(t, dq=wrong, ddq=wrong), ProcessingOptions(derivatives="central"))
    assert np.abs(run.motion.ddq - ddq)[100:-100].max() < 1e-2
    with pytest.raises(RecordingError, match="the recording has no accelerations"):
        process_recording(recording(t, dq=wrong), ProcessingOptions(derivatives="given"))
    with pytest.raises(RecordingError, match="the recording has no velocities"):
        process_recording(recording(t), ProcessingOptions(derivatives="given"))
    with pytest.raises(RecordingError, match="the recording has no velocities"):
        process_recording(recording(t), ProcessingOptions(derivatives="velocity"))


def test_positions_have_their_own_cutoff():
    t = clock(PERIOD)
    log = recording(t, q=np.sin(2 * np.pi * 3.0 * t)[:, None] * [1.0, 1.0])
    half, _ = one(log, ProcessingOptions(edges="periodic", motion_cutoff=3.0, cutoff=20.0))
    assert np.abs(half.motion.q).max() == pytest.approx(0.5, rel=1e-6)  # -6 dB at the cut-off
    assert half.rate == 100.0


def test_without_a_family_nothing_is_filtered_and_every_sample_is_a_row():
    log = recording(clock(5.0), noise=1e-3)
    run, _ = one(log, ProcessingOptions(family="none", decimate=25.0))
    assert run.step == 1 and np.array_equal(run.motion.q, log.q)


def test_the_ends_are_dropped_as_far_as_the_filter_reaches():
    t = clock(20.0)
    for order, cutoff, seconds in ((4, 5.0, 0.5), (4, 1.0, 1.38), (20, 3.0, 2.05)):
        # 0.5 s is the trim; the others the reach of 1 % of the kernel, found by summing the kernel at 1 kHz.
        run, _ = one(recording(t), ProcessingOptions(order=order, cutoff=cutoff, decimate=0.0))
        kept = run.motion.time[run.rows[run.mask.all(axis=1)]]
        assert kept[0] == pytest.approx(seconds, abs=0.03)
        assert t[-1] - kept[-1] == pytest.approx(seconds, abs=0.03)
    run, _ = one(recording(t), ProcessingOptions(edges="pad"))
    assert run.mask.all()
    run, _ = one(recording(t), ProcessingOptions(edges="pad", trim=1.0))
    assert run.motion.time[run.rows[run.mask[:, 0]]][0] == pytest.approx(1.0, abs=0.05)


# Rows that do not follow each other --------------------------------------------------------------------------


def test_separate_rows_are_left_untouched():
    order = np.random.default_rng(3).permutation(200)
    t = clock(2.0)[order]
    q, dq, ddq = motion(t)
    valid = np.ones(200, dtype=bool)
    valid[17] = False
    log = recording(t, time=None, dq=dq, ddq=ddq, consecutive=False, valid=valid)
    run, findings = one(log, ProcessingOptions(slow=0.01))
    assert not run.consecutive and run.step == 1 and run.motion.samples == 200
    for have, given in ((run.motion.q, q), (run.motion.dq, dq), (run.motion.ddq, ddq), (run.torque, log.effort)):
        assert np.array_equal(have, given)
    assert np.array_equal(run.mask, valid[:, None] & (np.abs(dq) >= 0.01))  # no neighbour is masked
    assert run.block.max() == 7 and codes(findings) == ["rows-not-consecutive"]


def test_separate_rows_need_recorded_derivatives():
    t = clock(2.0)
    with pytest.raises(RecordingError, match="cannot be computed from positions"):
        process_recording(recording(t, time=None, consecutive=False, dq=motion(t)[1]), ProcessingOptions())
    log = recording(t, time=None, consecutive=False, dq=motion(t)[1], ddq=motion(t)[2])
    with pytest.raises(RecordingError, match="cannot be computed from positions"):
        process_recording(log, ProcessingOptions(derivatives="central"))


# Masks ---------------------------------------------------------------------------------------------------------


def test_a_bad_sample_masks_the_rows_its_filtered_trace_reaches():
    valid = np.ones((2000, 2), dtype=bool)
    valid[1001, 1] = False
    run, _ = one(recording(clock(20.0), valid=valid), ProcessingOptions(edges="pad"))
    assert run.mask[:, 0].all()
    # Rows every 40 ms; the main lobe of 5 Hz is 0.1 s to either side of t = 10.01 s.
    assert np.array_equal(run.motion.time[run.rows[~run.mask[:, 1]]], [9.92, 9.96, 10.0, 10.04, 10.08])


def test_without_a_filter_only_the_bad_sample_itself_and_its_neighbours_are_masked():
    valid = np.ones((300, 2), dtype=bool)
    valid[101, 1] = False
    run, _ = one(recording(clock(3.0), valid=valid), ProcessingOptions(family="none", trim=0.0))
    assert np.array_equal(np.flatnonzero(~run.mask[:, 1]), [100, 101, 102])  # those that differences touch


def test_bad_samples_go_round_a_periodic_run():
    valid = np.ones((1000, 2), dtype=bool)
    valid[998] = [False, True]
    run, _ = one(recording(clock(PERIOD), valid=valid), ProcessingOptions(edges="periodic"))
    assert np.array_equal(run.rows[~run.mask[:, 0]], [0, 4, 8, 988, 992, 996])


def test_specks_that_count_for_no_joint_are_bridged_and_long_segments_masked():
    t = clock(10.0, 1000.0)
    valid = np.ones(10000, dtype=bool)
    valid[3000:3015] = False  # 16 ms, less than a tenth of a period of 5 Hz
    log = recording(t, valid=valid)
    q = np.array(log.q)
    q[3000:3015] = 99.0
    run, findings = one(replace(log, q=q), ProcessingOptions(edges="pad"))
    assert run.mask.all() and codes(findings) == ["rows-filled"]
    # A row leans on the 16 ms by the spline, and at the padded end on the curvature there.
    assert np.abs(run.motion.q - motion(run.motion.time)[0])[100:-100].max() < 1e-5
    valid[3000:3200] = False
    run, _ = one(recording(t, valid=valid), ProcessingOptions(edges="pad"))
    masked = run.motion.time[run.rows[~run.mask[:, 0]]]
    # What is bad for longer than the lobe is felt as far as the end of a run: 0.28 s at 5 Hz.
    assert masked[0] == pytest.approx(2.76) and masked[-1] == pytest.approx(3.44)


def test_a_contact_that_is_excluded_leaves_no_trace():
    """A step of 40 N·m for a second: what its filtered edge leaves in rows that count is below two hundredths."""
    t = clock(20.0, 500.0)
    valid = np.ones(len(t), dtype=bool)
    touched = slice(5000, 5500)
    valid[touched] = False
    effort = np.zeros((len(t), 2))
    effort[touched] = 40.0
    for order, cutoff in ((4, 5.0), (4, 2.0), (20, 3.5)):
        processing = ProcessingOptions(order=order, cutoff=cutoff)
        run, _ = one(recording(t, valid=valid, effort=effort), processing)
        felt = zero_phase(butterworth(order, cutoff, 500.0), run.torque)[run.rows]
        assert np.abs(felt[run.mask]).max() < 0.02 * 40.0


def test_values_that_are_not_finite_may_stand_where_nothing_counts():
    t = clock(10.0)
    valid = np.ones(1000, dtype=bool)
    valid[400:450] = False
    effort = np.ones((1000, 2))
    effort[400:450] = np.nan
    runs, findings = process_recording(recording(t, valid=valid, effort=effort), ProcessingOptions())
    assert len(runs) == 2 and "clock-gap" in codes(findings)


def test_slow_rows_are_masked_joint_by_joint():
    run, _ = one(recording(clock(20.0)), ProcessingOptions(slow=0.1, trim=0.0, edges="pad"))
    speed = np.abs(run.motion.dq[run.rows])
    assert np.array_equal(run.mask, speed >= 0.1)
    assert run.mask.any(axis=0).all() and not run.mask.all()


def test_saturated_samples_mask_their_rows_and_are_reported():
    t = clock(20.0)
    effort = np.ones((2000, 2))
    effort[1000, 0] = -9.6
    limits = [10.0, np.inf]
    log = recording(t, effort=effort, joint_names=("shoulder", "elbow"))
    run, findings = one(log, ProcessingOptions(saturation=0.95, edges="pad"), effort_limits=limits)
    assert np.array_equal(run.motion.time[run.rows[~run.mask[:, 0]]], [9.92, 9.96, 10.0, 10.04, 10.08])
    assert run.mask[:, 1].all()
    assert codes(findings) == ["saturation"] and findings[0].channel == "shoulder"
    with pytest.raises(RecordingError, match="needs the effort limits"):
        process_recording(log, ProcessingOptions(saturation=0.95))


def test_blocks_are_about_a_second_and_numbered_without_gaps():
    run, _ = one(recording(clock(10.4)), ProcessingOptions())
    assert np.array_equal(np.unique(run.block), np.arange(10))
    assert (np.diff(run.block) >= 0).all()
    assert {int(n) for n in np.bincount(run.block)} == {26}


# Several recordings ----------------------------------------------------------------------------------------------


def test_observations_join_recordings_under_one_band():
    logs = [recording(clock(10.0)), recording(clock(12.0, 200.0))]
    observations, findings = process_recordings(logs, ProcessingOptions(cutoff=4.0))
    assert [run.recording for run in observations.runs] == [0, 1]
    assert [run.step for run in observations.runs] == [4, 8]
    assert observations.band == ProcessingOptions(cutoff=4.0).band and not findings
    assert observations.samples == sum(run.mask.any(axis=1).sum() for run in observations.runs)


def test_the_automatic_cutoff_is_the_widest_that_any_recording_needs():
    slow = recording(clock(20.0))
    fast = recording(clock(20.0) * 1.0, q=np.sin(2 * np.pi * 0.9 * clock(20.0))[:, None] * [1.0, 0.0])
    alone = resolve_options(ProcessingOptions(cutoff="auto"), [slow]).cutoff
    both, _ = process_recordings([slow, fast], ProcessingOptions(cutoff="auto"))
    assert 5.0 <= float(alone) < 6.5  # ten times 0.5 Hz, and the spread of the window
    assert 9.0 <= both.band.cutoff < 10.5
    assert (
        resolve_options(ProcessingOptions(cutoff="auto"), [recording(clock(2.0), consecutive=False)]).family == "none"
    )


def test_periods_are_found_where_none_are_given():
    observations, findings = process_recordings([recording(clock(25.0))])
    assert [run.repetition is not None for run in observations.runs] == [True]
    assert "period-found" in {finding.code for finding in findings}
    assert process_recordings([recording(clock(25.0))], periods=[None])[0].runs[0].repetition is None


def test_periods_and_starts_belong_to_their_recordings():
    logs = [recording(clock(25.0)), recording(clock(8.0))]
    observations, _ = process_recordings(logs, ProcessingOptions(), periods=[PERIOD, None], starts=[1.0, None])
    first, second = observations.runs
    assert first.motion.time[first.rows[first.mask[:, 0]]][[0, -1]] == pytest.approx([1.0, 20.96])
    assert second.block.max() == 7


def test_an_average_without_a_period_is_remarked():
    _, findings = one(recording(clock(PERIOD)), ProcessingOptions(edges="periodic", average=True))
    assert codes(findings) == ["period-unknown"]

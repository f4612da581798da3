from dataclasses import replace

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.remedy import Remedy
from armid.robot.robot import Frame, Joint, Link, Robot
from armid.study.remedy_translation import OPTIONS, at_the_prompt

RATE = 100.0
N = 400
TIME = np.arange(N) / RATE
SPEED = np.array([1.1, 1.7, 2.3])
Q = np.sin(TIME[:, None] * SPEED + [0.1, 0.9, 2.0])
DQ = SPEED * np.cos(TIME[:, None] * SPEED + [0.1, 0.9, 2.0])
DDQ = -(SPEED**2) * Q
TAU = 3 * DDQ + 2 * np.cos(Q) + np.sign(DQ)
NAMES = ("base", "shoulder", "elbow")

ROUNDING = 1e-12
"""A linear map and its inverse of condition below 100 in double precision."""


def arm(kinds=("revolute", "revolute", "revolute"), limit=2.9):
    joints = tuple(
        Joint(
            name,
            kind,
            i - 1,
            [0.0, 0.0, 1.0],
            np.eye(4),
            [-limit, limit] if kind == "revolute" else [-np.inf, np.inf],
        )
        for i, (name, kind) in enumerate(zip(NAMES, kinds, strict=True))
    )
    return Robot("arm", joints, tuple(Link(name) for name in NAMES), Frame("tip", 2, np.eye(4)))


def recorded(**change):
    return Recording(**({"time": TIME, "q": Q, "dq": DQ, "ddq": DDQ, "effort": TAU, "source": "run.csv"} | change))


def read(recording, robot=None, **reading):
    return to_robot_convention(recording, LogFormat(**reading), robot or arm())


def refused(words, recording, robot=None, **reading):
    with pytest.raises(RecordingError, match=words) as caught:
        read(recording, robot, **reading)
    return caught.value


def codes(interpreted):
    return [finding.code for finding in interpreted.findings]


def assert_truth(recording):
    for name, truth in (("q", Q), ("dq", DQ), ("ddq", DDQ), ("effort", TAU)):
        np.testing.assert_allclose(getattr(recording, name), truth, rtol=0, atol=ROUNDING * np.abs(truth).max())


def test_a_plain_recording_comes_through_unchanged():
    result = read(recorded(sha256="ab"))
    assert result.findings == ()
    for name, truth in (("q", Q), ("dq", DQ), ("ddq", DDQ), ("effort", TAU)):
        np.testing.assert_array_equal(getattr(result.recording, name), truth)
    assert result.recording.joint_names == NAMES
    assert result.recording.consecutive is True
    assert (result.recording.source, result.recording.sha256) == ("run.csv", "ab")


# Joints


def test_channels_are_matched_by_name_in_any_order():
    order = [2, 0, 1]
    shuffled = recorded(
        q=Q[:, order],
        dq=DQ[:, order],
        ddq=DDQ[:, order],
        effort=TAU[:, order],
        joint_names=[NAMES[i] for i in order],
    )
    assert_truth(read(shuffled).recording)


def test_renaming_and_leaving_out():
    extra = np.column_stack([Q[:, 1], Q[:, 0] * 0.3, Q[:, 0], Q[:, 2]])
    recording = Recording(time=TIME, q=extra, joint_names=("lift", "finger", "base", "elbow"))
    result = read(recording, joints={"lift": "shoulder", "finger": ""})
    np.testing.assert_array_equal(result.recording.q, Q)
    numbered = read(Recording(time=TIME, q=extra), joints=["shoulder", "", "base", "elbow"])
    np.testing.assert_array_equal(numbered.recording.q, Q)


def test_missing_and_extra_joints_are_named():
    error = refused("missing: elbow; extra: wrist", recorded(joint_names=("base", "shoulder", "wrist")))
    assert "base, shoulder, elbow" in error.possible
    refused("missing: elbow", Recording(time=TIME, q=Q[:, :2], joint_names=NAMES[:2]))
    refused("extra: 3", recorded(), joints=["base", "shoulder", "finger"])
    refused("2 channels; arm has 3 joints: base, shoulder, elbow", Recording(time=TIME, q=Q[:, :2]))
    refused("twice: base", recorded(joint_names=("base", "b", "elbow")), joints={"b": "base"})
    refused("channels that the file does not have: lift", recorded(joint_names=NAMES), joints={"lift": "base"})
    refused("missing: elbow", recorded(), joints=["base", "shoulder"])


def test_named_channels_of_other_joints_are_left_out_and_said():
    result = read(
        recorded(q=np.hstack([Q, 9.0 + Q[:, :1]]), dq=None, ddq=None, effort=None, joint_names=(*NAMES, "finger"))
    )
    np.testing.assert_array_equal(result.recording.q, Q)
    (finding,) = (f for f in result.findings if f.code == "joints-extra")
    assert finding.severity == "info" and "finger" in finding.evidence


def test_a_numbered_log_of_all_joints_needs_no_list_where_one_is_held():
    held = arm().lock(["shoulder"])
    result = read(recorded(), held)
    np.testing.assert_array_equal(result.recording.q, Q[:, [0, 2]])
    (finding,) = (f for f in result.findings if f.code == "locked-joint")
    assert finding.channel == "shoulder" and finding.severity == "warning"  # it did move
    two = arm().lock({"elbow": 0.1, "base": 0.2})
    assert two.described_joints == NAMES and [h.position for h in two.held] == [0.1, 0.2]
    np.testing.assert_array_equal(read(recorded(), two).recording.q, Q[:, [1]])
    refused(
        "2 channels; arm has 1 joints: shoulder, and the locked joints elbow, base",
        Recording(time=TIME, q=Q[:, :2]),
        two,
    )


def test_the_name_of_a_joint_is_written_as_it_is():
    result = read(recorded(q=Q + np.array([0.0, 0.0, 900.0]), dq=None, ddq=None))
    (finding,) = (f for f in result.findings if f.code == "position-offset")
    assert finding.evidence.startswith("Joint elbow moves from")
    refused("run.csv: joint elbow moves from", recorded(q=Q * np.array([1.0, 1.0, 57.3]), dq=None, ddq=None))


def test_lists_must_be_as_long_as_the_robot_has_joints():
    refused("`drive_gain` has 2 entries, but arm has 3 joints", recorded(), drive_gain=[1.0, 2.0])
    refused("`transmission` has 2 entries", recorded(), transmission=np.eye(2))


# Units and the joint side


def test_degrees_become_radians():
    degrees = recorded(q=np.degrees(Q), dq=np.degrees(DQ), ddq=np.degrees(DDQ))
    assert_truth(read(degrees, units="deg").recording)


def test_degrees_leave_a_sliding_joint_alone():
    robot = arm(("revolute", "prismatic", "revolute"))
    q = np.column_stack([np.degrees(Q[:, 0]), Q[:, 1], np.degrees(Q[:, 2])])
    result = read(Recording(time=TIME, q=q, effort=TAU), robot, units="deg")
    np.testing.assert_allclose(result.recording.q, Q, atol=ROUNDING)


def test_degrees_taken_for_radians_are_given_away_by_the_limits():
    error = refused("degrees", recorded(q=np.degrees(Q)))
    assert 'units = "deg"' in error.remedy


def test_far_outside_the_limits_but_not_in_degrees_is_noted():
    result = read(recorded(q=Q + np.array([0.0, 500.0, 0.0])))
    assert codes(result) == ["position-offset"]
    assert result.findings[0].channel == "shoulder"


def test_limits_that_say_nothing_give_no_false_alarm():
    for limit in (0.0, 10000.0, np.inf):
        assert codes(read(recorded(q=40 * Q, dq=40 * DQ), arm(limit=limit))) == []


def test_motor_side_is_undone_with_coupled_joints():
    gear = np.diag([32.0, -48.0, 45.0])
    gear[2, 1] = 45.0
    offset = np.array([0.0, -np.pi / 2, 0.3])
    motor = recorded(
        q=(Q - offset) @ gear.T, dq=DQ @ gear.T, ddq=DDQ @ gear.T, effort=TAU @ np.linalg.inv(gear), joint_names=()
    )
    result = read(motor, transmission=gear, joint_offset=offset)
    assert_truth(result.recording)
    # The power is the same on both sides.
    np.testing.assert_allclose(
        (result.recording.effort * result.recording.dq).sum(1), (motor.effort * motor.dq).sum(1), rtol=1e-9
    )
    assert result.findings == ()


def test_an_offset_needs_no_transmission():
    np.testing.assert_allclose(read(recorded(q=Q - 0.2), joint_offset=[0.2] * 3).recording.q, Q, atol=ROUNDING)


def test_drive_gains_and_torque_sign_give_the_torque():
    gain = np.array([14.0, 11.0, 10.0])
    current = recorded(effort=-TAU / gain, effort_is_current=True)
    result = read(current, drive_gain=gain, torque_sign=-1)
    assert_truth(result.recording)
    assert not result.recording.effort_is_current
    signs = np.array([1, -1, 1])
    assert_truth(read(recorded(effort=signs * TAU), torque_sign=signs).recording)


def test_one_drive_gain_counts_for_all_joints():
    current = recorded(effort=TAU / 12.0, effort_is_current=True)
    for gain in (12.0, [12.0], [12.0] * 3):
        assert_truth(read(current, drive_gain=gain, drive_gain_deviation=[0.1, 0.2, 0.1]).recording)
    refused("has 2 entries", current, drive_gain=[12.0, 12.0])


def test_a_current_without_gain_is_refused_with_both_ways_out():
    error = refused("current-without-gain", recorded(effort_is_current=True))
    assert "`drive_gain = […]`" in error.remedy and "N·m/A" in error.remedy
    assert "`armid doctor` estimates it from the masses" in error.remedy
    assert "has no masses, give `drive_gain = 1` with `drive_gain_deviation = 10`" in error.remedy
    assert "armid payload RUN LOG --mass KG" in error.remedy
    refused("`drive_gain` is given, but the recording has no effort", recorded(effort=None), drive_gain=[1.0] * 3)


def test_a_masked_motor_masks_every_joint_made_from_it():
    valid = np.ones((N, 3), dtype=bool)
    valid[7, 2] = False
    gear = np.eye(3)
    gear[2, 1] = 1.0
    motor = recorded(q=Q @ gear.T, dq=DQ @ gear.T, ddq=DDQ @ gear.T, effort=TAU @ np.linalg.inv(gear), valid=valid)
    result = read(motor, transmission=gear)
    np.testing.assert_array_equal(result.recording.valid[7], [True, False, False])
    assert result.recording.valid.sum() == 3 * N - 2


# Wrapped angles


def wrapped(q, turn=2 * np.pi):
    return (q + turn / 2) % turn - turn / 2


def test_wrapped_angles_are_made_continuous():
    far = Q + np.array([3.0, 0.0, 0.0]) + np.outer(TIME, [4.0, 0.0, -3.0])
    robot = arm(("continuous", "revolute", "continuous"))
    result = read(Recording(time=TIME, q=wrapped(far), effort=TAU), robot)
    np.testing.assert_allclose(np.diff(result.recording.q, axis=0), np.diff(far, axis=0), atol=1e-9)
    assert [f.channel for f in result.findings if f.code == "position-wrapped"] == ["base", "elbow"]
    degrees = read(Recording(time=TIME, q=wrapped(np.degrees(far), 360.0), effort=TAU), robot, units="deg")
    np.testing.assert_allclose(np.diff(degrees.recording.q, axis=0), np.diff(far, axis=0), atol=1e-9)


def test_jumps_that_are_no_whole_turn_are_left_alone():
    q = Q.copy()
    q[200:, 1] += 4.0
    result = read(Recording(time=TIME, q=q, effort=TAU), arm(limit=10.0))
    np.testing.assert_array_equal(result.recording.q, q)


def test_fast_motors_are_not_taken_for_wrapped():
    steps = np.full(N, 2 * np.pi - 0.1)
    steps[::7] = 1.0
    q = np.column_stack([np.cumsum(steps), Q[:, 1], Q[:, 2]])
    result = read(Recording(time=TIME, q=q, effort=TAU), arm(limit=np.inf), transmission=np.eye(3))
    np.testing.assert_array_equal(result.recording.q, q)


def test_separate_samples_and_sliding_joints_are_never_unwrapped():
    q = wrapped(Q + 3.0)
    separate = read(recorded(q=q), arm(limit=np.inf), consecutive=False)
    np.testing.assert_array_equal(separate.recording.q, q)
    sliding = read(recorded(q=q), arm(("prismatic", "prismatic", "prismatic"), np.inf))
    np.testing.assert_array_equal(sliding.recording.q, q)


# Rows


def spoiled(name, row, joint, value):
    values = {"q": Q, "dq": DQ, "effort": TAU}[name].copy()
    values[row, joint] = value
    return recorded(**{name: values})


def test_nan_is_refused_with_channel_and_row():
    error = refused(
        r"effort of shoulder is nan in row 18 \(number of such rows: 1\)", spoiled("effort", 17, 1, np.nan)
    )
    assert error.remedy == "exclude = [[0.17, 0.1701]]"  # outwards, or the row would not lie inside
    error = refused("dq of shoulder is inf in row 1 ", spoiled("dq", 0, 1, np.inf))
    assert error.remedy == "exclude = [[0.0, 0.0]]"
    gone = refused("dq of shoulder is nan", spoiled("dq", slice(None), 1, np.nan))
    assert gone.remedy.startswith('columns = { dq = "" }')
    time = TIME.copy()
    time[4] = np.nan
    refused("time is nan in row 5", recorded(time=time))


def test_nan_inside_an_excluded_interval_is_dropped():
    result = read(spoiled("dq", 0, 1, np.nan), exclude=[[0.0, 0.004]])
    assert result.recording.samples == N - 1
    assert result.recording.time[0] == TIME[1]


def test_excluded_intervals_are_masked_and_stay_on_the_grid():
    result = read(recorded(), exclude=[[0.5, 1.0], [2.0, 2.0]])
    inside = ((TIME >= 0.5) & (TIME <= 1.0)) | (TIME == 2.0)
    assert inside.sum() == 52
    np.testing.assert_array_equal(result.recording.valid, np.repeat(~inside[:, None], 3, axis=1))
    refused("lies outside the time of the recording", recorded(), exclude=[[100.0, 101.0]])
    refused("contain all rows", recorded(), exclude=[[-1.0, 101.0]])


def test_excluded_intervals_without_a_clock_count_from_the_first_row():
    result = read(recorded(time=None), rate=RATE, exclude=[[0.0, 0.095]])
    np.testing.assert_array_equal(np.flatnonzero(~result.recording.valid[:, 0]), np.arange(10))
    refused("neither a time column nor a sample rate", recorded(time=None), consecutive=False, exclude=[[0.0, 1.0]])


def test_repeated_rows_are_dropped_where_a_clock_says_when():
    rows = np.sort(np.concatenate([np.arange(N), [10, 50, 50, 50]]))
    stutter = recorded(q=Q[rows], dq=DQ[rows], ddq=DDQ[rows], effort=TAU[rows], time=np.arange(N + 4) / RATE)
    result = read(stutter)
    assert codes(result) == ["rows-repeated"]
    assert "4 of 404 rows" in result.findings[0].evidence and "4 of them were dropped" in result.findings[0].evidence
    np.testing.assert_array_equal(result.recording.q, Q)
    assert result.recording.time[11] - result.recording.time[10] == pytest.approx(2 / RATE)


def test_repeated_rows_are_masked_where_dropping_would_break_the_grid():
    rows = np.sort(np.concatenate([np.arange(N), [10, 50, 50]]))
    stutter = recorded(q=Q[rows], dq=None, ddq=None, effort=TAU[rows], time=None)
    result = read(stutter, rate=RATE)
    assert result.recording.samples == N + 3
    np.testing.assert_array_equal(np.flatnonzero(~result.recording.valid[:, 0]), [11, 52, 53])
    pause = np.sort(np.concatenate([np.arange(N), np.full(30, 60)]))
    long = read(recorded(q=Q[pause], dq=DQ[pause], ddq=DDQ[pause], effort=TAU[pause], time=np.arange(N + 30) / RATE))
    assert long.recording.samples == N + 30
    assert (~long.recording.valid[:, 1]).sum() == 30


def coarse(x, step):
    return step * np.round(x / step)


def test_equal_rows_at_rest_are_no_repeats_and_repeats_in_motion_are():
    """A coarse log at 1 kHz: rest, a motion with a few repeated rows, rest."""
    rng = np.random.default_rng(3)
    time = np.arange(3000) / 1000.0
    phase = np.clip((time - 0.5) / 2.0, 0.0, 1.0)
    angle = 2 * np.pi * (phase - np.sin(2 * np.pi * phase) / (2 * np.pi))
    q = coarse(np.sin(angle[:, None] * [1.0, 2.0, 1.0]) * [1.0, 0.5, 0.8], 1e-4)
    effort = coarse(5.0 * np.cos(q) + 0.01 * rng.normal(size=q.shape), 0.05)
    equal = ((q[1:] == q[:-1]) & (effort[1:] == effort[:-1])).all(axis=1)
    assert equal[:450].sum() > 50 and not equal[900:2100].any()
    assert read(recorded(time=time, q=q, dq=None, ddq=None, effort=effort)).findings == ()

    again = np.arange(3000)
    again[[1000, 1001, 1600, 2000]] = [999, 999, 1599, 1999]
    result = read(recorded(time=time, q=q[again], dq=None, ddq=None, effort=effort[again]))
    assert codes(result) == ["rows-repeated"] and result.findings[0].evidence.startswith("4 of 3000 rows")
    assert set(range(3000)) - set(result.recording.number) == {1000, 1001, 1600, 2000}


def test_standing_still_with_a_live_torque_is_no_repeat():
    q, dq, ddq = Q.copy(), DQ.copy(), DDQ.copy()
    q[100:200], dq[100:200], ddq[100:200] = q[100], 0.0, 0.0
    result = read(recorded(q=q, dq=dq, ddq=ddq))
    assert result.findings == () and result.recording.valid.all()


def test_one_sample_and_hardly_any_are_refused():
    def first(k):
        return recorded(q=Q[:k], dq=DQ[:k], ddq=DDQ[:k], effort=TAU[:k], time=TIME[:k])

    refused("usable samples is too small: 1\\.", first(1))
    refused("usable samples is too small: 9\\.", first(9))
    assert read(first(10)).recording.samples == 10


# Channels


@pytest.mark.parametrize("name", ["dq", "ddq", "effort", "q"])
def test_a_dead_channel_is_named(name):
    values = {"q": Q, "dq": DQ, "ddq": DDQ, "effort": TAU}[name].copy()
    values[:, 2] = 0.0
    error = refused(rf"{name} of elbow is 0 in all 400 rows. \[channel-dead\]", recorded(**{name: values}))
    assert error.remedy
    if name in ("dq", "ddq"):
        assert f'columns = {{ {name} = "" }}' in error.remedy


def test_a_constant_effort_is_dead_whatever_its_value():
    effort = TAU.copy()
    effort[:, 0] = 1.25
    refused("effort of base is 1.25", recorded(effort=effort))


def test_an_arm_that_stands_still_is_refused_in_words():
    still = recorded(q=np.tile(Q[0], (N, 1)), dq=0 * DQ, ddq=0 * DDQ)
    refused("the arm stands still", still)


def test_one_joint_held_still_is_noted():
    q, dq, ddq = Q.copy(), DQ.copy(), DDQ.copy()
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.7, 0.0, 0.0
    result = read(recorded(q=q, dq=dq, ddq=ddq))
    assert codes(result) == ["standstill"] and result.findings[0].channel == "shoulder"


# The clock


def test_no_clock_and_no_rate_is_refused_and_the_implied_rate_told():
    error = refused("clock-missing", recorded(time=None))
    assert "100 Hz" in error.remedy
    remedy = refused("clock-missing", recorded(time=None, dq=None, ddq=None)).remedy
    assert "rate = HZ" in remedy and "columns = {" in remedy
    at_prompt = at_the_prompt(remedy, OPTIONS)
    assert "--rate HZ (in a study: rate = HZ)" in at_prompt and "--columns time=NAME" in at_prompt


def test_stamps_that_scatter_around_an_even_clock_are_replaced_by_it_and_not_sorted():
    """Rows are in order; their stamps scatter by 0.4 of a step, so that some are earlier than the one before."""
    scatter = 0.4 * (TIME[1] - TIME[0]) * np.random.default_rng(2).standard_normal(len(TIME))
    remedy = refused("around a uniform clock of", recorded(time=TIME + scatter)).remedy
    assert Remedy.read(remedy).keys == {
        "columns": {"time": ""},
        "rate": pytest.approx(1.0 / (TIME[1] - TIME[0]), rel=1e-9),
    }


def test_a_clock_that_runs_backwards_or_in_milliseconds_is_refused():
    time = TIME.copy()
    time[200:] -= 1.0
    refused("time runs backwards from row 200 to 201", recorded(time=time))
    refused("milliseconds, not seconds", recorded(time=1000 * TIME))
    assert read(recorded(time=1000 * TIME), consecutive=False).recording.consecutive is False


def test_a_rate_that_contradicts_the_clock_is_refused():
    refused("the time column gives 100 Hz, but the key `rate` gives 500 Hz", recorded(), rate=500.0)
    assert read(recorded(), rate=101.0).recording.rate is None


def test_a_few_equal_time_stamps_are_dropped_and_many_refused():
    time = TIME.copy()
    time[101] = time[100]
    result = read(recorded(time=time))
    assert codes(result) == ["clock-jitter"] and result.recording.samples == N - 1
    refused("have the time stamp of the row before", recorded(time=np.floor(TIME * 50) / 50))


def test_rows_without_a_clock_are_found_to_be_consecutive():
    result = read(recorded(time=None), rate=RATE)
    assert result.recording.consecutive is True and result.recording.rate == RATE and result.findings == ()
    plain = read(recorded(time=None, dq=None, ddq=None), rate=RATE)
    assert plain.recording.consecutive is True
    turning = wrapped(Q + np.outer(TIME, [5.0, 0.0, 0.0]))
    spinning = recorded(time=None, q=turning, dq=DQ + np.array([5.0, 0.0, 0.0]))
    assert read(spinning, arm(limit=np.inf), rate=RATE).recording.consecutive is True


def test_shuffled_rows_are_found_to_be_separate_samples():
    rows = np.random.default_rng(1).permutation(N)
    shuffled = recorded(time=None, q=Q[rows], dq=DQ[rows], ddq=DDQ[rows], effort=TAU[rows])
    result = read(shuffled, rate=RATE)
    assert result.recording.consecutive is False
    assert codes(result) == ["rows-not-consecutive"]
    refused("have no dq and no ddq", replace(shuffled, dq=None, ddq=None), rate=RATE)
    insisted = read(shuffled, rate=RATE, consecutive=True)
    assert insisted.recording.consecutive is True and codes(insisted) == ["rows-not-consecutive"]


def test_separate_samples_need_no_clock():
    result = read(recorded(time=None), consecutive=False)
    assert result.recording.consecutive is False and result.findings == ()
    refused("have no ddq", recorded(time=None, ddq=None), consecutive=False)


def test_a_wrong_rate_is_given_away_by_the_velocities():
    refused("imply 100 Hz, but the key `rate` gives 50 Hz", recorded(time=None), rate=50.0)

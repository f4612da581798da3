"""Spikes are left out and interpolated before anything is filtered; real motion is not touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import Finding, RecordingError
from armid.estimation.problem import build_problem
from armid.estimation.run_estimator import estimate
from armid.lab.inverse_dynamics_recording import Sensors
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.measurement.processing.spikes import without_spikes
from armid.measurement.recording import Recording, select_rows
from armid.model.motion import Motion
from labs import small_model, small_recording, small_truth
from sick import sound

ROBOT = small_model().robot
ROWS = np.array([40, 333, 334, 720, 1201])
KEEP = LogFormat(spikes="keep")


def log(rate: float = 100.0) -> Recording:
    return small_recording(1, sensors=Sensors(position=1e-5, torque=0.02, rate=rate))


def changed(recording: Recording, name: str, rows: object, value: object) -> Recording:
    values = getattr(recording, name).copy()
    values[rows] = value
    return replace(recording, **{name: values})


def told(findings: tuple[Finding, ...]) -> list[Finding]:
    return [each for each in findings if each.code == "spikes"]


def read(recording: Recording, reading: LogFormat | None = None) -> tuple[Recording, list[Finding]]:
    result = to_robot_convention(recording, reading or LogFormat(), ROBOT)
    return result.recording, told(result.findings)


def curvature(x: np.ndarray) -> float:
    """Largest second difference; a straight line across two samples is off by it, and by the noise on both sides."""
    return float(np.abs(np.diff(x, 2, axis=0)).max())


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_lost_packets_of_positions_are_left_out_for_all_joints(rate: float):
    there = log(rate)
    there = replace(there, q=there.q + 1.0)  # at 50 Hz a quarter of a radian is possible from sample to sample
    found, (finding,) = read(changed(there, "q", ROWS[:3], 0.0))
    assert finding.severity == "warning" and finding.evidence.startswith(f"In 3 of {there.samples} rows the position")
    expected = np.ones(there.samples, dtype=np.bool_)
    expected[ROWS[:3]] = False
    np.testing.assert_array_equal(found.valid, np.repeat(expected[:, None], 3, axis=1))
    assert np.abs(found.q - there.q).max() <= 2.0 * curvature(there.q)


@pytest.mark.parametrize("name", ["q", "command"])
def test_a_jump_at_a_low_rate_needs_an_acceleration_that_no_arm_has(name: str):
    """A third of a radian in 20 ms and back: 17 rad/s, but at least 8 · 0.33 / 0.04² = 1700 rad/s²."""
    there = log(50.0)
    there = replace(there, effort=None, command=there.q)
    away = getattr(there, name)[ROWS[1], 1] + 0.35
    found, (finding,) = read(changed(there, name, (ROWS[1], 1), away))
    assert finding.channel == there.channels[1] and "1e+03 rad/s²" in finding.evidence
    assert not found.valid[ROWS[1], 1] and found.valid[ROWS[1] - 1].all()


@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0, 1000.0])
def test_motion_with_the_acceleration_of_a_fast_arm_is_left_alone(rate: float):
    """Rest, and swings out and back within a tenth of a second, with up to 490 rad/s² and 8 rad/s."""
    there = log(rate)
    time = np.arange(there.samples) / rate
    swing = np.where(time % 1.0 < 0.1, 0.125 * (1.0 - np.cos(2.0 * np.pi * (time % 1.0) / 0.1)), 0.0)
    moved = replace(there, q=np.repeat(swing[:, None], 3, axis=1))
    assert read(moved)[1] == []


def test_a_position_of_one_joint_is_left_out_for_all():
    there = log()
    found, (finding,) = read(changed(there, "q", (ROWS, 1), 5.0))
    assert finding.channel == there.channels[1]
    assert not found.valid[ROWS].any() and found.valid.sum() == 3 * (there.samples - len(ROWS))


def test_a_torque_is_left_out_for_its_joint_alone():
    there = log()
    assert there.effort is not None
    found, (finding,) = read(changed(there, "effort", (ROWS, 2), 999.0))
    assert finding.channel == there.channels[2] and "999" in finding.evidence
    expected = np.ones((there.samples, 3), dtype=np.bool_)
    expected[ROWS, 2] = False
    np.testing.assert_array_equal(found.valid, expected)
    assert found.effort is not None
    assert np.abs(found.effort - there.effort).max() <= 2.0 * curvature(there.effort)


def test_a_torque_packet_of_zeros_is_left_out_for_all_joints():
    """Some of the torques are near zero anyhow; one that is not shows that the packet was lost."""
    found, (finding,) = read(changed(log(), "effort", ROWS, 0.0))
    assert finding.evidence.startswith(f"In {len(ROWS)} of") and not found.valid[ROWS].any()


def test_velocities_are_left_out_for_all_joints():
    case = sound(1, name="ur10e")
    seed = next(seed for seed in range(1, 20) if sound(seed, name="ur10e").recording.dq is not None)
    case = sound(seed, name="ur10e")
    broken = changed(case.recording, "dq", (ROWS, 3), 200.0)
    result = to_robot_convention(broken, case.reading, case.robot)
    (finding,) = told(result.findings)
    assert "velocity" in finding.evidence and not result.recording.valid[ROWS].any()


@pytest.mark.parametrize("units", ["rad", "deg"])
def test_angles_that_wrap_are_no_spikes_and_spikes_are_no_wraps(units: str):
    there = log()
    wrapped = np.mod(there.q - 0.5, 2.0 * np.pi)
    assert (np.abs(np.diff(wrapped, axis=0)) > np.pi).any()  # otherwise nothing is tested
    scale = 180.0 / np.pi if units == "deg" else 1.0
    sane, none = read(replace(there, q=wrapped * scale), LogFormat(units=units))
    assert not none
    lost, (finding,) = read(changed(replace(there, q=wrapped * scale), "q", ROWS, 0.0), LogFormat(units=units))
    assert finding.evidence.startswith(f"In {len(ROWS)} of")
    # Unwrapping ends on the same turn, with lost packets next to a wrap as well.
    assert np.abs(lost.q - sane.q).max() <= 2.0 * curvature(there.q)


def test_spikes_of_motors_are_found_before_they_spread_over_joints():
    gear = np.array([[50.0, 0.0, 0.0], [0.0, 80.0, 0.0], [0.0, 40.0, 60.0]])
    there = log()
    assert there.effort is not None
    motors = replace(there, q=there.q @ gear.T, effort=there.effort @ np.linalg.inv(gear))
    reading = LogFormat(transmission=gear)
    assert not read(motors, reading)[1]
    found, (finding,) = read(changed(motors, "q", (ROWS, 2), 0.0), reading)
    assert finding.channel == there.channels[2] and not found.valid[ROWS].any()


def test_steps_contacts_and_coarse_channels_are_kept():
    """An encoder that slips does not return, and converters and reversals of friction step often."""
    there, slipped = log(), log().q.copy()
    slipped[800:, 2] += 0.5
    assert there.effort is not None
    pushed = there.effort.copy()
    pushed[900:910] += 40.0
    for recording in (
        there,
        replace(there, q=slipped),
        replace(there, effort=pushed),
        replace(there, q=np.round(there.q, 2), effort=np.round(there.effort)),
        replace(there, q=np.round(there.q, 1)),
    ):
        found, findings = read(recording)
        assert not findings and found.valid.all()


def poses(rate: float, rest: float, move: float, *, noise: float = 0.0) -> Recording:
    """Sixty static poses with fast motion between them; velocities are exactly zero at rest."""
    rng = np.random.default_rng(4)
    time = np.arange(round(60 * (rest + move) * rate)) / rate
    targets, number = rng.uniform(-0.8, 0.8, (62, 3)), (time // (rest + move)).astype(int)
    s = np.clip((time % (rest + move)) / move, 0.0, 1.0)[:, None]
    change = targets[number + 1] - targets[number]
    q, dq = targets[number] + change * s**2 * (3.0 - 2.0 * s), change * 6.0 * s * (1.0 - s) / move
    ddq = change * (6.0 - 12.0 * s) / move**2 * ((s > 0.0) & (s < 1.0))
    effort = small_model().torque(Motion(time, q, dq, ddq), small_truth())
    return Recording(
        time,
        q + 1e-3 * noise * rng.standard_normal(q.shape),
        np.where(dq == 0.0, 0.0, dq + 0.1 * noise * rng.standard_normal(q.shape)),
        effort=effort + 5.0 * noise * rng.standard_normal(q.shape),
    )


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    ("rate", "rest", "move"),
    [(1000.0, 0.5, 0.2), (100.0, 10.0, 0.3), (20.0, 10.0, 0.3), (10.0, 5.0, 0.4), (4.0, 10.0, 1.0)],
)
def test_fast_motion_between_static_poses_is_kept(rate: float, rest: float, move: float, noise: float):
    found, findings = without_spikes(poses(rate, rest, move, noise=noise), LogFormat(), ROBOT)
    assert not findings and found.valid.all()


def test_simulated_logs_without_noise_are_kept():
    there = small_recording(1, sensors=Sensors(position=0.0, torque=0.0, rate=20.0))
    found, findings = read(replace(there, dq=np.gradient(there.q, 0.05, axis=0)))
    assert not findings and found.valid.all()


def test_positions_spike_in_slow_logs_as_well():
    there = poses(4.0, 10.0, 1.0)
    rows = ROWS[[0, 3, 4]]
    found, (finding,) = read(changed(there, "q", (rows, 1), 30.0))
    assert "position" in finding.evidence and not found.valid[rows].any()


@pytest.mark.parametrize("length", [1, 2, 3])
def test_a_velocity_that_the_positions_confirm_is_kept(length: int):
    """Brief jogs; the same velocities without a change of the positions are spikes."""
    there = poses(1000.0, 1.0, 1.0, noise=0.01)
    assert there.dq is not None
    rows = (ROWS[[0, 1, 3]] + 100)[:, None] + np.arange(length)
    jogged = there.dq.copy()
    jogged[rows, 1] += 5.0  # of a limit of 4, and 3 times this is possible
    moved = there.q.copy()
    moved[:, 1] += np.cumsum(jogged[:, 1] - there.dq[:, 1]) / 1000.0
    found, findings = read(replace(there, q=moved, dq=jogged))
    assert not findings and found.valid.all()
    found, (finding,) = read(replace(there, dq=jogged))
    assert "velocity" in finding.evidence and not found.valid[rows].any()


def test_a_position_that_slips_does_not_confirm_an_impossible_velocity():
    there = poses(1000.0, 1.0, 1.0, noise=0.01)
    slipped = there.q.copy()
    slipped[500:, 1] += 0.4  # 200 rad/s in the difference over two samples
    broken = changed(replace(there, q=slipped), "dq", (500, 1), 200.0)
    _, (finding,) = read(broken)
    assert "velocity" in finding.evidence


def test_a_log_of_which_no_row_is_left_is_an_error():
    """Each row is a spike of one of the three joints."""
    there = select_rows(poses(100.0, 1.0, 1.0), np.arange(12000) < 1198)
    lost = (np.arange(1198)[:, None] + 5) // 8 % 3 == np.arange(3)
    found, (finding,) = without_spikes(replace(there, q=np.where(lost, 9.0, there.q), dq=None), LogFormat(), ROBOT)
    assert finding.severity == "error" and not found.valid.any()


def test_keep_uses_the_samples_and_says_so():
    there = changed(log(), "q", ROWS, 0.0)
    found, (finding,) = read(there, KEEP)
    np.testing.assert_array_equal(found.q, there.q)
    assert found.valid.all() and finding.severity == "warning" and 'spikes = "keep"' in finding.remedy
    with pytest.raises(RecordingError, match="spikes"):
        LogFormat(spikes="drop")  # pyright: ignore[reportArgumentType]


def test_excluded_spikes_are_not_reported():
    there = changed(log(), "q", ROWS[-1:], 0.0)
    assert there.time is not None
    at = float(there.time[ROWS[-1]])
    assert not read(there, LogFormat(exclude=[[at - 0.05, at + 0.05]]))[1]


def test_many_spikes_are_an_error():
    rows = np.random.default_rng(3).choice(log().samples, round(0.01 * log().samples), replace=False)
    _, (finding,) = read(changed(log(), "q", (rows, 1), 9.0))
    assert finding.severity == "error" and "record again" in finding.remedy


def test_an_estimate_is_that_without_the_rows():
    """The rows of lost packets count as missing, as if they were excluded by hand."""
    there, rows = log(), ROWS[[0, 1, 3, 4]]  # without the second of two rows, which count as a gap
    lost, _ = read(changed(there, "q", rows, 0.0))
    assert there.time is not None
    by_hand = LogFormat(exclude=[[float(t) - 1e-4, float(t) + 1e-4] for t in there.time[rows]])
    excluded, _ = read(there, by_hand)
    sound_values, values = (estimated(each) for each in (excluded, lost))
    np.testing.assert_array_equal(values, sound_values)
    # Torques lose a twentieth of the rows of a joint; the standard deviations from its noise are below 0.01.
    spiky, _ = read(changed(there, "effort", (rows, 1), 500.0))
    assert np.abs(estimated(spiky) - estimated(there)).max() < 0.01


def estimated(recording: Recording) -> np.ndarray:
    observations, _ = process_recordings([recording], ProcessingOptions())
    return estimate(build_problem(small_model(), observations)).values

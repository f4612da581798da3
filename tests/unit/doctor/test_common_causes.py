"""Causes in all torques together, and causes of one torque that compete with changes within a log, are named."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.doctor import explanations_of
from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics import torque_gain
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.residuals.residual_causes import causes_of
from armid.doctor.residuals.wave_in_time import strongest_wave
from armid.measurement.convention_conversion import to_robot_convention
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

UR10E = 4
"""Seed of a log of this arm."""

HUM = 0.8
"""Frequency of a wave that no motion of these logs has [Hz]."""

ROUNDING = 1e-6
"""Relative difference of two orders of summing the same products."""


def told(case: Case) -> set[tuple[str, str, str]]:
    """Codes, channels and severities of all warnings and errors."""
    found = diagnose_recording(case.robot, case.recording, case.reading)
    return {(f.code, f.channel, f.severity) for f in found if f.severity != "info"}


def effort_of(case: Case) -> Array:
    """Torques as logged (N, n)."""
    assert case.recording.effort is not None
    return case.recording.effort


def test_a_hum_on_all_torques_is_named_with_its_frequency():
    case = sound(UR10E)
    effort = effort_of(case)
    wave = np.sin(2.0 * np.pi * HUM * case.motion.time)[:, None] * np.array([1, -1, 1, 1, -1, 1])
    case = case.logged(effort=effort + 0.5 * effort.std(axis=0) * wave)
    assert ("channel-noisy", "", "warning") in told(case)
    found = diagnose_recording(case.robot, case.recording, case.reading)
    assert any(f"{HUM:g} Hz" in f.evidence for f in found if f.code == "channel-noisy")


def test_gains_that_fall_with_the_load_of_the_arm_are_named():
    case = sound(UR10E)
    effort = effort_of(case)
    power = np.sum(np.abs(case.motion.dq * effort) / effort.std(axis=0), axis=1)
    load = np.clip(power / np.quantile(power, 0.98), 0.0, 1.0)[:, None]
    assert ("torque-gain", "", "warning") in told(case.logged(effort=effort / (1.0 - 0.45 * load)))


def test_torques_of_the_wrists_in_another_unit_are_found_together():
    case = sound(UR10E)
    factor = np.where(np.arange(case.robot.n) >= case.robot.n - 3, 1000.0, 1.0)
    found = torque_gain.explain(state_of(case.logged(effort=effort_of(case) * factor)))
    assert found is not None
    assert (found.channel, found.severity) == (", ".join(case.robot.joint_names[-3:]), "error")
    np.testing.assert_allclose(found.after.rows.torque, state_of(case).rows.torque)


@pytest.mark.parametrize("seed", [UR10E, 3, 11])
def test_sound_logs_have_no_cause_in_all_torques(seed: int):
    codes = {"channel-noisy", "torque-gain", "filtered-before-logging", "gravity-direction", "friction-missing"}
    assert not codes & {code for code, *_ in told(sound(seed))}


def test_a_base_that_is_tilted_by_three_degrees_is_a_warning():
    tilt = np.radians(3.0)
    case = sound(UR10E, gravity=9.80665 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)]))
    assert ("gravity-direction", "", "warning") in told(case)


def test_a_stop_at_the_end_of_the_range_is_no_change_within_the_log():
    case, joint = sound(UR10E), 2
    effort = effort_of(case).copy()
    q = case.motion.q[:, joint]
    pressed = np.clip(q - (q.max() - 0.125 * np.ptp(q)), 0.0, None)
    effort[:, joint] += 6.0 * effort[:, joint].std() * pressed / pressed.max()
    found = {(code, channel) for code, channel, _ in told(case.logged(effort=effort))}
    assert ("residual-by-angle", case.robot.joint_names[joint]) in found
    assert "changes-midway" not in {code for code, _ in found}


def state_of(case: Case):
    """The log with the doctor's model."""
    recording = to_robot_convention(case.recording, case.reading, case.robot).recording
    state = LogEvidence(case.robot, case.recording, case.reading, recording, explains=explanations_of()).state
    assert state is not None
    return state


def test_laws_lower_the_residual_together_as_they_do_alone():
    state = state_of(sound(UR10E))
    added, joint = AddedColumns(state), 1
    laws = [each.columns for each in causes_of(state, joint)]
    alone = [added.decrease_together(joint, law) for law in laws]
    np.testing.assert_allclose(added.decreases_of_laws(joint, laws), alone, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize("frequency", [0.37, 1.3, 3.1])
def test_the_frequency_of_a_wave_is_known_to_half_the_inverse_length_of_the_log(frequency: float):
    rows = state_of(sound(UR10E)).rows
    time = rows.motion.time - rows.motion.time[0]
    noise = np.random.default_rng(5).standard_normal((len(time), 2))
    wave = np.sqrt(2.0) * np.sin(2.0 * np.pi * frequency * time + 0.4)[:, None]
    found, _ = strongest_wave(rows, (wave + 0.5 * noise) / np.std(wave + 0.5 * noise, axis=0))
    assert abs(found - frequency) < 0.5 / float(np.ptp(time))

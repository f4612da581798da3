"""Faults that compete for the misfit of a log: which is accepted, and small faults that a clear gain shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.doctor import LogEvidence
from armid.doctor.check_input import Explain, Explanation
from armid.doctor.checks.dynamics import joint_order, torque_gain
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import RemedyTrial
from armid.doctor.stuck_channels import stuck_segments
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.recording import Recording
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

UR10E, UR5E, PANDA = 4, 12, 51
"""Seeds of logs of these arms."""

TILT = 6.0
"""Tilt of the base [deg], which is below 8° and above what unmodelled parts of sound arms look like."""


def evidence_of(case: Case, *explains: Explain) -> LogEvidence:
    read = to_robot_convention(case.recording, case.reading, case.robot).recording
    return LogEvidence(case.robot, case.recording, case.reading, read, explains=explains)


def with_wrong_gain(seed: int, joint: int) -> Case:
    case = sound(seed)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, joint] *= 2.0
    return case.logged(effort=effort)


def rival(*, confirmed: bool) -> Explain:
    """A delay with a large gain on the rows on which it is judged, whose correction changes nothing elsewhere."""

    def explain(state: LogState) -> Explanation:
        return Explanation(
            "channel-delay",
            2.0,
            "error",
            "effort",
            "",
            lambda evidence: "",
            state.on(state.log),
            (lambda evidence: True) if confirmed else (lambda evidence: False),
            trial=RemedyTrial(0.0, -1.0),
        )

    return explain


@pytest.mark.parametrize("confirmed", [True, False])
def test_a_fault_that_does_not_lower_the_residual_of_all_rows_stands_behind_one_that_does(*, confirmed: bool):
    evidence = evidence_of(with_wrong_gain(UR10E, 1), rival(confirmed=confirmed), torque_gain.explain)
    assert evidence.explanations[0].code == "torque-gain"


def test_instead_of_a_fault_that_the_log_does_not_confirm_a_similar_one_is_accepted():
    def unconfirmed(state: LogState) -> Explanation | None:
        found = torque_gain.explain(state)
        if found is None:
            return None
        return replace(found, code="channel-delay", gain=1.2 * found.gain, confirmed=lambda evidence: False)

    evidence = evidence_of(with_wrong_gain(UR10E, 1), unconfirmed, torque_gain.explain)
    assert [each.code for each in evidence.explanations] == ["torque-gain"]


@pytest.mark.parametrize("seed", [UR5E, PANDA])
def test_a_base_tilted_by_a_few_degrees_is_named(seed: int):
    case = sound(seed)
    angle = np.radians(TILT)
    tilted = case.robot.with_gravity((9.81 * float(np.sin(angle)), 0.0, -9.81 * float(np.cos(angle))))
    found = [f for f in diagnose_recording(tilted, case.recording, case.reading) if f.severity == "error"]
    assert [f.code for f in found] == ["gravity-direction"]
    assert f"{TILT:.0f}° from the gravity of the study" in found[0].evidence


def test_exchanged_torques_are_found_where_few_rows_are_away_from_reversals(monkeypatch: pytest.MonkeyPatch):
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort = case.recording.effort[:, [0, 5, 2, 3, 4, 1]]
    state = evidence_of(case.logged(effort=effort)).state
    assert state is not None
    few = np.zeros(state.rows.mask.shape, dtype=np.bool_)
    few[40:, 5] = True  # enough for the last joint, and too few for the second one
    judged = state.without(few)
    monkeypatch.setattr(joint_order, "judged_away_from_reversals", lambda _: (judged, np.ones(6, dtype=np.bool_)))
    found = joint_order.explain(state)
    assert found is not None
    assert found.channel == f"{case.robot.joint_names[1]}, {case.robot.joint_names[5]}"


def test_a_rest_of_the_arm_does_not_hide_a_stuck_channel():
    time = np.arange(2000) / 100.0
    moving = np.maximum(time - 5.0, 0.0)  # the arm rests for five seconds
    q = np.column_stack([np.sin(moving), np.cos(1.3 * moving), np.sin(0.7 * moving)])
    effort = 3.0 * q + np.sin(9.0 * moving)[:, None]
    effort[1000:1200, 1] = effort[1000, 1]
    assert stuck_segments(Recording(time, q, effort=effort), 100.0) == ((1, "effort", 1000, 1199),)

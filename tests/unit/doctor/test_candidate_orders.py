"""Joints exchanged in all quantities, where torque alone hardly tells and limits do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.doctor.candidate_orders import exchanges, shifts, usual_orders
from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from gantries import gantry
from healing import told_after
from sick import Case, sound


def filling(case: Case, fill: tuple[float, float], offset: tuple[float, float] = (0.0, 0.0)) -> Case:
    """A log whose joints move over a range [m] around an offset [m]; torque is that of the motion."""
    q = case.motion.q - case.motion.q.mean(axis=0)
    share = np.array(fill) / np.ptp(q, axis=0)
    effort = case.recording.effort
    assert effort is not None
    return case.logged(q=q * share + np.array(offset), dq=None, effort=effort * share)


def swapped(case: Case, order: list[int]) -> Case:
    effort = case.recording.effort
    assert effort is not None
    return case.logged(q=case.recording.q[:, order], dq=None, effort=effort[:, order])


def suspicions(case: Case) -> list[Finding]:
    found = diagnose_recording(case.robot, case.recording, case.reading)
    return [f for f in found if f.code in ("joint-order", "position-offset") and f.severity != "info"]


def with_own_limits(case: Case) -> Case:
    """The case with limits that the motion just fills, as in a plan of armid's own."""
    low, high = case.motion.q.min(axis=0), case.motion.q.max(axis=0)
    joints = [
        replace(joint, position_limits=np.array([a - 1e-3, b + 1e-3]))
        for joint, a, b in zip(case.robot.joints, low, high, strict=True)
    ]
    return replace(case, robot=replace(case.robot, joints=tuple(joints)))


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 5, 4], [5, 4, 3, 2, 1, 0], [5, 0, 1, 2, 3, 4], [0, 1, 2, 4, 5, 3]])
def test_exchanged_joints_are_named_and_put_back(order: list[int]):
    case = with_own_limits(sound(4))
    assert suspicions(case) == []
    found = [f for f in suspicions(swapped(case, order)) if f.code == "joint-order"]
    (back,) = found
    assert back.severity == "error" and "error" in back.evidence
    assert told_after(swapped(case, order), back) <= {"excitation-weak"}


def test_limits_name_an_exchange_that_the_torque_does_not_see(tmp_path: Path):
    case = filling(sound(2, robot=gantry(tmp_path)), (1.6, 0.5))
    assert suspicions(case) == []
    (told,) = suspicions(swapped(case, [1, 0]))
    assert (told.code, told.severity, told.channel) == ("joint-order", "warning", "x, y")
    assert "all joints are inside their limits" in told.evidence and "the torque agrees equally well" in told.evidence
    assert told.remedy == 'columns = { q = ["q2", "q1"], effort = ["tau2", "tau1"] }'


@pytest.mark.parametrize(
    ("fill", "offset"),
    [((0.4, 0.5), (0.0, 0.45)), ((0.4, 0.8), (0.0, 0.0)), ((1.6, 1.6), (0.0, 0.0))],
    ids=["another zero", "a little beyond", "both are far outside"],
)
def test_a_joint_beyond_its_limits_is_no_exchange_on_a_tie(
    tmp_path: Path, fill: tuple[float, float], offset: tuple[float, float]
):
    case = filling(sound(2, robot=gantry(tmp_path)), fill, offset)
    assert "joint-order" not in {f.code for f in suspicions(case)}


def test_joints_of_two_kinds_are_not_exchanged(tmp_path: Path):
    case = sound(2, robot=gantry(tmp_path, kind="revolute", axis="0 0 1"))
    case = swapped(filling(case, (1.6, 0.5)), [1, 0])
    assert {f.code for f in suspicions(case)} == {"position-offset"}


def test_usual_orders_are_permutations_and_each_is_given_once():
    for n in range(2, 8):
        orders = [tuple(each.tolist()) for each in usual_orders(n)]
        assert all(sorted(each) == list(range(n)) for each in orders)
        assert len(exchanges(n)) == n * (n - 1) // 2 and len(shifts(n)) == (n - 1) * (n - 2)
        assert len(set(orders)) == len(orders) and tuple(range(n)) not in orders

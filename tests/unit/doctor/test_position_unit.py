"""Angles that are no radians: degrees, also beside another fault, counts of encoders, or positions of motors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import Finding
from armid.study.config import RecordingChoice
from armid.study.diagnosis import diagnose_recording, run_checks
from sick import Case, sound

UR = 4  # the seed of a UR10e, whose description has inertias


def in_degrees(factor: float | Array = 1.0, offset: float | Array = 0.0) -> Case:
    """A log in degrees, or in multiples of them, without a unit in its columns [°]."""
    case = sound(UR)
    return case.logged(q=np.degrees(case.motion.q) * factor + offset, dq=None)


def errors(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity == "error"]


def one(joint: int, value: float, others: float) -> Array:
    values = np.full(6, others)
    values[joint] = value
    return values


@pytest.mark.parametrize(
    ("case", "codes"),
    [
        (in_degrees(), {"degrees"}),
        (in_degrees(offset=one(2, 120.0, 0.0)), {"degrees", "position-offset"}),
        (in_degrees(factor=one(2, -1.0, 1.0)), {"degrees", "position-sign"}),
    ],
    ids=["alone", "another zero", "another direction"],
)
def test_a_log_in_degrees_is_one_whatever_else_is_wrong(case: Case, codes: set[str]):
    found = errors(case)
    assert {f.code for f in found} == codes
    (degrees,) = (f for f in found if f.code == "degrees")
    assert degrees.remedy.startswith('units = "deg"')


def test_positions_of_motors_are_no_degrees():
    found = errors(in_degrees(factor=np.array([1.4, 1.7, 2.1, 2.8, 1.7, 2.1])))  # gear ratios of 80 to 160
    assert [f.code for f in found] == ["motor-side"]
    assert found[0].remedy.startswith("find out the matrix N")


def test_positions_of_motors_with_their_unit_and_currents_are_no_log_of_another_arm():
    """The unit of the angles is known, and currents say nothing about it."""
    ratio = np.array([214.0, 250.0, 230.0, 205.0, 170.0, 115.0])
    case = in_degrees(factor=ratio)
    case = replace(case, reading=replace(case.reading, units="deg"))
    for current in (False, True):
        effort = case.recording.effort
        assert effort is not None
        log = case.logged(effort=effort / 10.0, effort_is_current=current)
        codes = {f.code for f in errors(log)}
        assert "motor-side" in codes and "position-limits" not in codes


@pytest.mark.parametrize(
    ("turn", "zero", "example"), [(4096, 2048, "4096"), (65536, 32768, "65536"), (1000, 1000, "4096")]
)
def test_whole_numbers_are_counts_of_encoders(turn: int, zero: int, example: str):
    """The example is the next power of two above the largest count, from 4096 on."""
    case = sound(UR)
    (found,) = errors(case.logged(q=np.round(case.motion.q * turn / (2 * np.pi)) + zero, dq=None, ddq=None))
    assert (found.code, found.channel) == ("motor-side", "q")
    assert "whole numbers, from " in found.evidence and "counts of encoders" in found.evidence
    assert f"With {example} counts per turn" in found.evidence and "q = 2π (count - Z) / N" in found.remedy


def test_counts_are_named_without_limits_of_the_joints():
    """Joints without limits are nowhere outside them."""
    case = sound(UR)
    free = tuple(replace(joint, position_limits=(-np.inf, np.inf)) for joint in case.robot.joints)
    counts = case.logged(q=np.round(case.motion.q * 4096 / (2 * np.pi)) + 2048, dq=None, ddq=None)
    robot = replace(case.robot, joints=free)
    (found,) = errors(replace(counts, robot=robot))
    assert found.code == "motor-side" and "counts of encoders" in found.evidence
    model = replace(case.model, robot=robot)
    identified = run_checks(model, [(RecordingChoice("counts.csv"), counts.recording)])
    assert [each for _, each in identified if each.severity == "error"] == [found]


def test_whole_degrees_are_degrees():
    """Half a degree of rounding leaves the torque in agreement with degrees."""
    case = in_degrees()
    assert [f.code for f in errors(case.logged(q=np.round(case.recording.q)))] == ["degrees"]

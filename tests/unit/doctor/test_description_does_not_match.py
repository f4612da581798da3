"""A description of another arm: its torque has not the shape of the measured one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics import description_does_not_match
from armid.measurement.convention_conversion import to_robot_convention
from armid.robot import load_robot
from armid.robot.robot import InertialParameters
from sick import Case, sound

CODE = "description-does-not-match"


def told(case: Case) -> list[str]:
    log = to_robot_convention(case.recording, case.reading, case.robot).recording
    evidence = LogEvidence(case.robot, case.recording, case.reading, log)  # no fault explains the log
    return [finding.code for finding in description_does_not_match.check(evidence)]


@pytest.mark.parametrize(("name", "seed"), [("ur5e", 100), ("ur10e", 102), ("iiwa14-r820", 103)])
def test_the_arm_itself_matches_with_masses_off_by_some_percent(name: str, seed: int):
    assert told(sound(seed, name=name)) == []


@pytest.mark.parametrize("seed", [100, 102])
def test_another_arm_with_as_many_joints_does_not_match(seed: int):
    """A UR whose second to fourth joints turn the other way round: the same limits and names, other torques."""
    case = sound(seed, name="ur5e")
    other = load_robot("ur5e")
    turned = [replace(j, axis=-j.axis) if k in (1, 2, 3) else j for k, j in enumerate(other.joints)]
    lying = replace(other, joints=tuple(turned)).with_gravity((9.81, 0.0, 0.0))
    assert told(replace(case, robot=lying)) == [CODE]
    assert told(case) == []


def test_a_large_arm_is_not_a_small_one_with_as_many_joints():
    """The described torque is below the residuals of the log; a model of the log still fits."""
    case = sound(102, name="ur10e")
    other = load_robot("ur5e")
    small = [replace(j, axis=-j.axis) if k in (1, 2, 3) else j for k, j in enumerate(other.joints)]
    links = tuple(
        link
        if link.inertial is None
        else replace(link, inertial=InertialParameters.from_vector(1e-3 * link.inertial.vector))
        for link in other.links
    )
    lying = replace(other, joints=tuple(small), links=links).with_gravity((9.81, 0.0, 0.0))
    log = to_robot_convention(case.recording, case.reading, lying).recording
    (found,) = description_does_not_match.check(LogEvidence(lying, case.recording, case.reading, log))
    assert (found.code, found.severity) == (CODE, "error") and "times as large" in found.evidence

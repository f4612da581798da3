"""Logs of an arm with a load are compared with known links, and the load is no fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.doctor.earlier_run_links import KnownLinks
from armid.maths.inertia import com_inertia_to_vector
from armid.model.base_parameters import find_base_parameters
from armid.remedy import Remedy
from armid.robot import Robot, load_robot
from armid.study.config import RecordingChoice
from armid.study.diagnosis import run_checks
from sick import Case, sound

LOAD = com_inertia_to_vector(14.0, np.array([0.03, -0.02, 0.1]), np.diag([0.06, 0.05, 0.04]))
"""The largest load of the iiwa 14, in the frame of its last link; the wrist alone weighs a twentieth of it."""


def loaded(seed: int, *, name: str = "iiwa14-r820", robot: Robot | None = None, load: Array = LOAD) -> Case:
    """A sound log of an arm, by default the iiwa 14, with the load."""
    case = sound(seed, name=name, robot=robot)
    theta = case.theta.copy()
    theta[case.model.inertial_columns.reshape(-1, 10)[-1]] += load
    torque = case.model.torque(case.motion, theta)
    assert case.recording.effort is not None
    return replace(case.logged(effort=case.recording.effort - case.torque + torque), torque=torque)


def errors(case: Case, known: KnownLinks | None) -> set[str]:
    """Codes of the errors in a log."""
    found = run_checks(case.model, [(RecordingChoice("log", reading=case.reading), case.recording)], (), known)
    return {finding.code for _, finding in found if finding.severity == "error"}


def known_links(case: Case) -> KnownLinks:
    """The true links, without the load."""
    return KnownLinks(case.theta[case.model.inertial_columns].reshape(-1, 10), "the run", case.robot.n - 1)


def base_links(case: Case) -> KnownLinks:
    """The true links as base parameters, which have no masses."""
    base = find_base_parameters(case.model)
    theta = np.zeros(len(case.theta))
    theta[base.kept] = base.values_of(case.theta)
    return replace(known_links(case), bodies=theta[case.model.inertial_columns].reshape(-1, 10))


def one_joint(name: str) -> Robot:
    """The UR5e with all joints locked but one."""
    robot = load_robot("ur5e")
    return robot.lock([joint.name for joint in robot.joints if joint.name != name])


def test_a_load_is_a_fault_for_the_description_but_not_for_known_links():
    case = loaded(3)
    assert errors(case, None) == {"torque-unit"}
    assert errors(case, known_links(case)) == set()


@pytest.mark.parametrize(
    ("factor", "code"),
    [(-1.0, "torque-sign"), (0.01, "motor-side"), (0.1, "current-without-gain"), (1e3, "torque-unit")],
)
def test_the_scale_of_a_torque_is_not_taken_for_a_load(factor: float, code: str):
    case = loaded(3)
    assert case.recording.effort is not None
    assert errors(case.logged(effort=factor * case.recording.effort), known_links(case)) == {code}


def test_findings_name_what_the_log_is_compared_with():
    case = loaded(3)
    assert case.recording.effort is not None
    turned = case.logged(effort=0.01 * case.recording.effort)
    found = run_checks(turned.model, [(RecordingChoice("log"), turned.recording)], (), known_links(turned))
    (finding,) = (each for _, each in found if each.code == "motor-side")
    assert "the torque of the run" in finding.evidence and "description" not in f"{finding.evidence}{finding.remedy}"


@pytest.mark.parametrize(
    ("seed", "name", "mass"),
    [(3, "iiwa14-r820", 14.0), (5, "iiwa14-r820", 14.0), (5, "iiwa14-r820", 10.0), (5, "ur5e", 14.0)],
)
def test_a_load_is_no_fault_where_the_run_has_base_parameters_only(seed: int, name: str, mass: float):
    case = loaded(seed, name=name, load=LOAD * (mass / 14.0))
    links = base_links(case)
    assert errors(case, links) == set()
    assert case.recording.effort is not None
    assert errors(case.logged(effort=0.01 * case.recording.effort), links) == {"motor-side"}


@pytest.mark.parametrize("joint", ["shoulder_lift_joint", "elbow_joint"])
@pytest.mark.parametrize(
    ("factor", "code"), [(0.01, "motor-side"), (0.1, "current-without-gain"), (1e3, "torque-unit")]
)
@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_a_wrong_scale_in_motion_of_one_joint_is_not_taken_for_a_load(
    joint: str, factor: float, code: str, mass: float
):
    case = loaded(1, robot=one_joint(joint), load=LOAD * (mass / 14.0))
    assert errors(case, known_links(case)) == set()
    assert case.recording.effort is not None
    assert errors(case.logged(effort=factor * case.recording.effort), known_links(case)) == {code}


def test_the_gain_of_a_small_effort_of_one_joint_is_the_true_one():
    case = sound(1, robot=one_joint("shoulder_lift_joint"))
    assert case.recording.effort is not None
    small = case.logged(effort=0.01 * case.recording.effort)
    found = run_checks(small.model, [(RecordingChoice("log"), small.recording)], (), known_links(small))
    (finding,) = (each for _, each in found if each.code == "motor-side")
    (gain,) = Remedy.read(finding.remedy).keys["drive_gain"]
    assert gain == pytest.approx(100.0, rel=0.2)  # the stated deviation of such gains


@pytest.mark.parametrize("masses", [True, False])
def test_an_offset_agrees_with_the_masses_of_a_run_only_if_it_has_masses(masses: bool):
    case = sound(3, name="ur5e")
    q = case.recording.q.copy()
    q[:, 2] += 0.4
    moved = case.logged(q=q)
    links = known_links(case) if masses else base_links(case)
    found = run_checks(moved.model, [(RecordingChoice("log"), moved.recording)], (), links)
    (finding,) = (each for _, each in found if each.code == "position-offset")
    assert ("the masses agree better" in finding.evidence) == masses

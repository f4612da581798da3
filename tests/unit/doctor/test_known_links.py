"""Logs of an arm with a load are compared with known links, and the load is no fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.doctor.known_links import KnownLinks
from armid.maths.inertia import com_inertia_to_vector
from armid.study.config import RecordingChoice
from armid.study.diagnosis import run_checks
from sick import Case, sound

LOAD = com_inertia_to_vector(14.0, np.array([0.03, -0.02, 0.1]), np.diag([0.06, 0.05, 0.04]))
"""The largest load of the iiwa 14, in the frame of its last link; the wrist alone weighs a twentieth of it."""


def loaded(seed: int) -> Case:
    """A sound log of the iiwa 14 with the load."""
    case = sound(seed, name="iiwa14-r820")
    theta = case.theta.copy()
    theta[case.model.inertial_columns.reshape(-1, 10)[-1]] += LOAD
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

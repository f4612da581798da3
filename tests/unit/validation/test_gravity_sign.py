"""Signs of gravity that parameters alone show."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid import DynamicsModel, find_base_parameters, load_robot
from armid.checked_array import Array
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.model.base_parameters import BaseParameters
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.runs.consistency_check import certify_named
from armid.validation.gravity_sign import gravity_sign_finding

TRUTH = json.loads((Path(__file__).parents[2] / "golden" / "data" / "truth.json").read_text())
HANGING = (0.0, 0.0, 9.81)


def arm(name: str) -> tuple[BaseParameters, Array]:
    model = DynamicsModel(load_robot(name), (RigidBody(), Viscous(), Coulomb()))
    base = find_base_parameters(model)
    return base, base.values_of(thesis_truth(model))


def moments(base: BaseParameters) -> Array:
    return np.array([name[0] == "M" for name in base.names])


@pytest.mark.parametrize("name", ["iiwa14-r820", "ur10e", "ur5e"])
def test_a_description_raises_no_suspicion_and_its_first_moments_turned_do(name: str):
    base, values = arm(name)
    assert gravity_sign_finding(base, values) is None
    turned = np.where(moments(base), -values, values)
    found = gravity_sign_finding(base, turned)
    assert found is not None and found.code == "gravity-direction" and "9.81" in found.remedy


def test_with_friction_turned_too_it_is_the_torque():
    base, values = arm("iiwa14-r820")
    found = gravity_sign_finding(base, -values)
    assert found is not None and found.code == "torque-sign"


def test_table_41_is_suspected_of_the_wrong_gravity():
    values = {name: value for name, (value, _) in TRUTH["table41"].items()}
    findings = certify_named(load_robot("iiwa14-r820", gravity=HANGING), values).findings
    (found,) = (f for f in findings if f.code == "gravity-direction")
    assert "MYR_2 = -5.8" in found.evidence and "MYR_4 = -2.25" in found.evidence
    assert found.remedy == "gravity = [0, 0, -9.81]  # in [robot]"

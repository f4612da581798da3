"""What is remarked: a gravity that is none, a motion that tells little apart."""

from __future__ import annotations

from functools import cache

import numpy as np

from armid import DynamicsModel, find_base_parameters, inform, load_robot
from armid.excitation.plans import builtin_plan
from armid.lab.virtual import thesis_truth
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.study.plausibility import excitation_finding, gravity_finding
from armid.values import Array
from problems import one_run, raw


@cache
def measured() -> tuple[DynamicsModel, Motion, Array]:
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb()))
    motion = builtin_plan("thesis-a1").sample(50.0)
    return model, motion, model.torque(motion, thesis_truth(model))


def test_gravity_of_another_unit_is_remarked():
    robot = load_robot("ur5e")
    assert gravity_finding(robot) is None
    found = gravity_finding(robot.with_gravity((0.0, 0.0, -981.0)))
    assert found is not None and "981" in found.evidence


def test_a_motion_that_tells_little_apart_is_remarked():
    model, motion, torque = measured()
    base = find_base_parameters(model)
    torque = torque + 0.1 * np.random.default_rng(0).normal(size=torque.shape)
    assert excitation_finding(inform(model, base, raw(one_run(motion, torque, 50.0)))) is None
    short = motion[slice(0, 100)]  # two seconds from rest
    found = excitation_finding(inform(model, base, raw(one_run(short, torque[:100], 50.0))))
    assert found is not None and found.code == "excitation-weak"
    assert any(name in found.evidence for name in base.names)

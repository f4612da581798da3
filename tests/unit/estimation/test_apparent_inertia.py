"""Joints whose measured torque contains less inertia than their links have."""

from __future__ import annotations

import numpy as np
import pytest

from armid.estimation.friction.apparent_inertia import with_signed_inertia
from armid.estimation.problem import EstimationProblem, build_problem
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.robot import load_robot
from problems import lively_motion, one_run, raw

RATE, NOISE = 50.0, 0.05

JOINT = 3


def recorded(missing: float) -> EstimationProblem:
    """Problem of an arm whose measured torque lacks a share of the inertia of one joint."""
    model = DynamicsModel(load_robot("ur5e"), (RigidBody(), Viscous(), Coulomb(0.02), Offset(), RotorInertia()))
    rng = np.random.default_rng(3)
    motion = lively_motion(rng, model.n, RATE, 10.0)
    theta = model.nominal_parameters()
    assert theta is not None
    inertia = float(model.mass_matrix(motion.q, theta)[:, JOINT, JOINT].mean())
    names = [parameter.name for parameter in model.parameters]
    theta[[names.index(f"FV_{j + 1}") for j in range(model.n)]] = 1.0
    theta[names.index(f"IA_{JOINT + 1}")] = -missing * inertia
    torque = model.torque(motion, theta)
    return build_problem(model, raw(one_run(motion, torque + NOISE * rng.normal(size=torque.shape), RATE)))


@pytest.mark.parametrize(("missing", "signed"), [(0.5, True), (0.0, False), (-0.5, False), (5.0, False)])
def test_rotor_inertia_may_be_negative_where_the_torque_lacks_a_part_of_the_inertia(missing: float, signed: bool):
    """A part of the inertia may be missing, but not several times the inertia of the joint."""
    problem = recorded(missing)
    model, found = with_signed_inertia(problem, 1.0, ())
    assert found.model is model and found.standard is not None
    name = model.robot.joint_names[JOINT]
    (rotor,) = (term for term in model.terms if isinstance(term, RotorInertia))
    assert (name in rotor.signed) == signed
    bounded = dict(zip(found.standard.names, found.standard.nonnegative, strict=True))
    assert bounded[f"IA_{JOINT + 1}"] == (not signed)
    if missing == 0.0:
        assert found is problem

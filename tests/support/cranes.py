"""A slide on a turning tower, whose bodies can be known in part, and estimates of it."""

from __future__ import annotations

from functools import cache

import numpy as np

import armid
from armid.estimation.estimate_record import Estimate
from armid.estimation.estimators import PhysicallyConsistent, WeightedLeastSquares
from armid.estimation.problem import EstimationProblem, build_problem
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody, Viscous
from armid.robot.readers.urdf import read
from problems import lively_motion, one_run, raw

RATE = 50.0

CRANE = """<robot name="crane"><link name="base"/>
  <link name="tower"><inertial><origin xyz="0.1 0 0"/><mass value="4"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="trolley"><inertial><origin xyz="0.05 -0.03 0.1"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.002" ixz="0" iyz="0.001"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="tower"/><axis xyz="0 0 1"/></joint>
  <joint name="slide" type="prismatic"><parent link="tower"/><child link="trolley"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="80"/></joint>
</robot>"""
"""A slide on a turning tower: its force shows the mass that it moves, the tower's torque where the centre is."""


@cache
def model(text: str = CRANE) -> DynamicsModel:
    return DynamicsModel(read(text, source="small", locked={}, tip=None), (RigidBody(), Viscous()))


def problem(text: str = CRANE, seed: int = 0, noise: float = 0.3) -> EstimationProblem:
    arm = model(text)
    base, theta = find_base_parameters(arm), arm.nominal_parameters()
    assert theta is not None
    theta = theta.copy()
    theta[arm.law_columns] = 1.0
    motion = lively_motion(np.random.default_rng(1), arm.n, RATE, 12.0)
    torque = arm.torque(motion, theta) + noise * np.random.default_rng(seed).normal(size=(motion.samples, arm.n))
    samples = raw(one_run(motion, torque, RATE))
    return build_problem(arm, samples, base=base)


def estimate(data: EstimationProblem, *, bodies: bool = True) -> Estimate:
    assert data.model is not None and data.base is not None
    estimator = PhysicallyConsistent(prior="none") if bodies else WeightedLeastSquares()
    fit = armid.estimate(data, estimator)
    return Estimate(data.model.robot.name, estimator.name, (), data.base, fit)

"""An arm with and without a load, for the tests of loads, drive gains and recalibration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.information.accumulate import accumulate_information
from armid.information.information import Information
from armid.maths.inertia import com_inertia_to_vector
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from armid.robot import load_robot
from problems import lively_motion, one_run, raw

RATE, SECONDS, BLOCK = 25.0, 16.0, 20

NOISE = np.array([2.0, 2.0, 1.5, 0.4, 0.3, 0.3])
"""Deviation of each joint's torque [N·m]."""

FRICTION = {"FV": 4.0, "FS": 3.0, "FO": 0.5}

LOAD = com_inertia_to_vector(2.0, np.array([0.03, -0.02, 0.08]), np.diag([0.012, 0.015, 0.009]))
"""A box of 2 kg, well inside the set of real bodies, in the frame of the last link."""


class Carrying(NamedTuple):
    """Claims of a simulated recording, and what is true of it."""

    information: Information
    base_values: Array


@cache
def arm() -> tuple[DynamicsModel, BaseParameters]:
    """Six joints with friction and offsets."""
    model = DynamicsModel(load_robot("ur5e"), (RigidBody(), Viscous(), Coulomb(width=0.02), Offset()))
    return model, find_base_parameters(model)


def load_columns() -> Array:
    """Return what the load's ten parameters add to the base parameters."""
    model, base = arm()
    return base.regrouping[:, model.inertial_columns[-10:]]


def changing() -> Array:
    """Tell which base parameters are friction."""
    return np.array([name.startswith(tuple(FRICTION)) for name in arm()[1].names])


def truth(load: Array | None = None, friction: float = 1.0) -> Array:
    """Standard parameters, with a load on the last link and so many times the friction."""
    model, _ = arm()
    nominal = model.nominal_parameters()
    assert nominal is not None
    theta = nominal.copy()
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in FRICTION:
            theta[k] = friction * FRICTION[parameter.symbol]
    if load is not None:
        theta[model.inertial_columns[-10:]] += load
    return theta


@cache
def _columns(motion: int, seconds: float) -> Array:
    model, _ = arm()
    return model.regressor(lively_motion(np.random.default_rng(motion), model.n, RATE, seconds))


def carrying(
    motion: int,
    noise: np.random.Generator | None,
    load: Array | None = None,
    *,
    friction: float = 1.0,
    correction: Array | float = 0.0,
    seconds: float = SECONDS,
    still: tuple[int, ...] = (),
) -> Carrying:
    """A recording: true torque is (1 + correction) times what is measured, noise aside."""
    model, base = arm()
    theta = truth(load, friction)
    along = lively_motion(np.random.default_rng(motion), model.n, RATE, seconds)
    if still:
        q, dq, ddq = (np.array(x) for x in (along.q, along.dq, along.ddq))
        q[:, still], dq[:, still], ddq[:, still] = 0.3, 0.0, 0.0
        along = replace(along, q=q, dq=dq, ddq=ddq)
        torque = model.regressor(along) @ theta
    else:
        torque = _columns(motion, seconds) @ theta
    torque = torque / (1.0 + np.asarray(correction))
    if noise is not None:
        torque = torque + NOISE * noise.normal(size=torque.shape)
    information = accumulate_information(model, base, raw(one_run(along, torque, RATE, block_rows=BLOCK)))
    return Carrying(information, base.values_of(theta))


def known(information: Information) -> Fit:
    """The estimate of the arm without a load."""
    return estimate(EstimationProblem(information))

"""Joints whose measured torque contains less inertia than the links have.

The torque of a joint in a log is often computed by the controller, which subtracts inertia that the links may not
have. Rotor inertia then has to be negative. Consistent bodies with rotor inertia that is not negative do not explain
such torques: on the Panda, the training error of joint 6 was 1.6 times that with a negative value. But an inertia
that the data hardly determine must not become negative, because it would be wrong in faster motions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, UnsolvedError
from armid.estimation.estimators.physical import PhysicallyConsistent
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.problem import EstimationProblem, standard_of
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RotorInertia

CLEAR = 5.0
"""Number of standard deviations below zero from which a rotor inertia may stay negative; findings about systematic
errors have the same limit. With 3, the left-out errors of joints 1 and 2 of the LWR4+ and the Panda were up to a
fifth larger."""

WHOLE = 1.0
"""Largest ratio of a negative rotor inertia to the inertia of the joint by the description. With a larger ratio, the
sum of both would be negative, and a torque would accelerate the joint in the opposite direction. Without this limit,
slow recordings of the Med 7 gave the wrists negative inertias of more than a hundred times that of the links, and the
mean error on the other recording was 1.5 times as large."""

SYMBOL = "IA"
"""Symbol of rotor inertia."""

POSES = 200
"""Largest number of recorded poses over which the inertia of a joint is averaged."""


def with_signed_inertia(
    problem: EstimationProblem, weight: float, drifting: tuple[str, ...]
) -> tuple[DynamicsModel, EstimationProblem]:
    """Model and problem in which rotor inertia may be negative on the joints whose data clearly require it.

    Args:
        problem: Problem of the model without candidates.
        weight: Weight of the prior of the bodies [independent samples].
        drifting: Names of the offsets that have a separate value in each recording.
    """
    model, base, observations = problem.require_samples("friction selection")
    standard = problem.require_standard("friction selection")
    rotor = next((term for term in model.terms if isinstance(term, RotorInertia)), None)
    nominal = model.nominal_parameters()
    if rotor is None or nominal is None or not standard.described:
        return model, problem
    asked = _signed(model, rotor, model.robot.joint_names if rotor.joints is None else rotor.joints)
    separate = separate_by_recording(problem.information, np.isin(problem.information.names, drifting))
    free = replace(problem, information=separate, standard=standard_of(asked, base))
    try:
        fit = PhysicallyConsistent(weight=weight).solve(free).standard
    except (EstimationError, UnsolvedError):
        return model, problem
    assert fit is not None  # the method estimates standard parameters
    whole = WHOLE * _mean_inertia(model, nominal, observations)
    joints: list[str] = []
    for name, value, deviation in zip(fit.names, fit.values, np.sqrt(np.diag(fit.covariance)), strict=True):
        if name.symbol == SYMBOL and name.number and -whole[name.number - 1] < value < -CLEAR * deviation:
            joints.append(model.robot.joint_names[name.number - 1])
    if not joints:
        return model, problem
    signed = _signed(model, rotor, tuple(joints))
    return signed, replace(problem, model=signed, standard=standard_of(signed, base))


def _signed(model: DynamicsModel, rotor: RotorInertia, joints: tuple[str, ...]) -> DynamicsModel:
    """Model whose rotor inertia may be negative on some joints."""
    signed = replace(rotor, signed=tuple(dict.fromkeys((*rotor.signed, *joints))))
    terms = tuple(signed if term is rotor else term for term in model.terms)
    return replace(model, terms=terms)


def _mean_inertia(model: DynamicsModel, nominal: Array, observations: Observations) -> Array:
    """Inertia about each joint by the description, mean over the recorded poses, shape (n,) [kg·m² or kg].

    Args:
        model: The model.
        nominal: Standard parameters of the description, shape (p,).
        observations: Recordings with the poses.
    """
    q = np.concatenate([run.motion.q[run.rows][run.mask.any(axis=1)] for run in observations.runs])
    some = q[:: max(1, len(q) // POSES)]
    return np.diagonal(model.mass_matrix(some, nominal), axis1=1, axis2=2).mean(axis=0)

"""Estimation problem of a unit in the torque scale of its fleet."""

from __future__ import annotations

from dataclasses import replace

from armid.checked_array import Array
from armid.estimation.problem import EstimationProblem
from armid.information.information import Information, JointFactors
from armid.measurement.observations import Observations


def scaled_problem(problem: EstimationProblem, scale: Array, deviation: Array) -> EstimationProblem:
    """Problem whose measured torques are divided by torque scales.

    Args:
        problem: Problem of the unit.
        scale: Torque scale of each joint, shape (n,).
        deviation: Standard deviations of the torque scales, shape (n,).
    """
    observations = problem.observations
    return replace(
        problem,
        information=_scaled_information(problem.information, scale, deviation),
        observations=None if observations is None else scaled_observations(observations, scale),
    )


def scaled_observations(observations: Observations, scale: Array) -> Observations:
    """Observations whose torques are divided by torque scales, shape (n,)."""
    return replace(observations, runs=tuple(replace(run, torque=run.torque / scale) for run in observations.runs))


def _scaled_information(information: Information, scale: Array, deviation: Array) -> Information:
    """Information whose torques are divided by torque scales with given standard deviations, shape (n,) each."""
    joints: list[JointFactors] = []
    for joint, factor in zip(information.joints, scale, strict=True):
        factors = joint.R.copy()
        factors[:, :, -1] /= factor
        joints.append(JointFactors(joint.parameters, factors))
    return replace(information, joints=tuple(joints), scale_deviation=deviation / scale)

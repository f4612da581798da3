"""Load torque of load-dependent friction: the rigid-body torque of a first estimate without such friction.

The measured torque cannot be the load, since the prediction would then contain what it is to predict. So the rigid
bodies are estimated first, without load-dependent terms, and stay fixed while these are estimated; this keeps the
model linear in its parameters. The first estimate has a prior: least squares on weak data gives bodies whose torque
is right along the recorded motion and wrong on others.
"""

from __future__ import annotations

from dataclasses import replace

from armid.errors import ModelError
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.problem import build_problem
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.symbolic_expression import symbols


def reads_load(model: DynamicsModel) -> bool:
    """Checks whether a term of the model depends on the load torque."""
    return any("load" in symbols(law.expression) for _, law in model.laws)


def with_load(model: DynamicsModel, observations: Observations, *, threads: int = 1) -> DynamicsModel:
    """Gives a model the bodies whose torque is the load of its load-dependent terms.

    Args:
        model: Arm and torque terms.
        observations: Data of the first estimate.
        threads: Threads of the kernel.

    Returns:
        The model with `load_parameters`; unchanged where no term depends on the load or where it has them already.

    Raises:
        ModelError: There are no rigid bodies among the terms.
        EstimationError: The observations do not determine the model without load-dependent terms.
    """
    if not reads_load(model) or model.load_parameters is not None:
        return model
    if not model.has_rigid_bodies:
        raise ModelError(
            "A term depends on the load torque, but the model has no rigid bodies.", remedy="add the term rigid-body."
        )
    plain = tuple(
        term for term in model.terms if not any("load" in symbols(law.expression) for law in term.laws(model.robot))
    )
    first = DynamicsModel(model.robot, plain)
    base = find_base_parameters(first)
    problem = build_problem(first, observations, base=base, threads=threads)
    bodies = torque_parameters(base, Ridge().solve(problem))[first.inertial_columns].reshape(-1, 10)
    return replace(model, load_parameters=bodies)

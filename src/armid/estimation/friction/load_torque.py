"""Load torque of load-dependent friction: the rigid-body torque of a first estimate without such friction.

The measured torque cannot be the load, because the model would then predict the torque from the torque itself. So the
rigid bodies are estimated first, without load-dependent terms. These bodies are not changed while the load-dependent
terms are estimated, so the model stays linear in its parameters. The first estimate has a prior: if the data are
weak, least squares without a prior gives bodies whose torque is correct for the recorded motion and wrong for other
motions.
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
from armid.model.torque_law_expression import symbols


def reads_load(model: DynamicsModel) -> bool:
    """Tests whether a term of the model depends on the load torque."""
    return any("load" in symbols(law.expression) for _, law in model.laws)


def with_load(model: DynamicsModel, observations: Observations, *, threads: int = 1) -> DynamicsModel:
    """Adds to a model the inertial parameters from which the load of its load-dependent terms is computed.

    Args:
        model: Arm and torque terms.
        observations: Data of the first estimate.
        threads: Threads of the kernel.

    Returns:
        The model with `load_parameters`; unchanged if no term depends on the load or if it already has them.

    Raises:
        ModelError: A term depends on the load, but the model has no rigid bodies.
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

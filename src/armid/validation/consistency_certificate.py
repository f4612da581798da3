"""Certificate of physical consistency: distance of parameters to the nearest consistent ones.

Parameters are consistent if the pseudo-inertia of every link is positive semidefinite [Wensing2018] and friction and
rotor inertia are not negative. This set is a convex cone in the standard parameters θ, and base parameters are linear
in θ, so the smallest distance |L θ - values| is a small convex program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.errors import EstimationError
from armid.estimation.consistency.cones import EPSILON, consistency_cones
from armid.estimation.problem import bare_standard
from armid.maths.conic_solver import Cone, solve_cones
from armid.model.dynamics import DynamicsModel
from armid.threads import one_blas_thread
from armid.values import Array, array

FEASIBLE = 1e-6
"""Relative distance up to which values count as consistent: the accuracy of the solver."""


@dataclass(frozen=True, slots=True)
class Blame:
    """Difference of one value from the nearest consistent one.

    Attributes:
        name: The parameter.
        change: Nearest less given.
    """

    name: str
    change: float


@dataclass(frozen=True, eq=False, slots=True)
class Certificate:
    """Physical consistency of values.

    Attributes:
        feasible: Whether the values are consistent.
        distance: Euclidean distance to the nearest consistent values, in SI units.
        relative_distance: Distance over the norm of the values.
        inertial_distance: The same for the values that depend on inertial parameters.
        blame: Change of every value to the nearest consistent one, largest first.
        nearest: The nearest consistent values, in the order given.
        witness: Standard parameters (p,) of a consistent arm with these nearest values.
        masses: Masses of its links, shape (n,) [kg].
        gap: Bound on how much nearer other consistent values can be, over the distance or 1 if that is larger.
    """

    feasible: bool
    distance: float
    relative_distance: float
    inertial_distance: float
    blame: tuple[Blame, ...]
    nearest: Array
    witness: Array
    masses: Array
    gap: float


@one_blas_thread
def certify_values(
    model: DynamicsModel,
    names: Sequence[str],
    values: Array,
    linear: Array,
    *,
    epsilon: float = EPSILON,
    heaviest: float | None = None,
) -> Certificate:
    """Certifies values that are linear in the standard parameters.

    Args:
        model: Arm and torque terms.
        names: Names of the values.
        values: Shape (k,).
        linear: L with values = L θ, shape (k, p): the regrouping for base parameters, the identity for standard ones.
        epsilon: Smallest eigenvalue of a pseudo-inertia.
        heaviest: Largest mass of a link [kg].

    Raises:
        EstimationError: The program could not be solved to a certificate, or no body is as light as `heaviest`.
    """
    if heaviest is not None and heaviest <= epsilon:
        raise EstimationError(
            f"With links of at most {heaviest:g} kg there is no body: the smallest counts from {epsilon:g} kg on.",
            remedy="give a heaviest that a link of the arm may weigh.",
        )
    values = array(values, (len(names),), "values")
    p = len(model.parameters)
    cost = np.zeros(p + 1)
    cost[p] = 1.0
    distance = np.zeros((len(values) + 1, p + 1))
    distance[0, p] = 1.0
    distance[1:, :p] = linear
    cones = consistency_cones(bare_standard(model), p + 1, epsilon=epsilon, heaviest=heaviest)
    solution = solve_cones(cost, [*cones, Cone("norm", distance, np.concatenate([[0.0], -values]))])
    witness = solution.x[:p]
    nearest = linear @ witness
    change = nearest - values
    length, size = float(np.linalg.norm(change)), float(np.linalg.norm(values))
    order = np.argsort(-np.abs(change))
    bodies = np.any(linear[:, model.inertial_columns] != 0.0, axis=1)
    body = float(np.linalg.norm(values[bodies]))
    return Certificate(
        length <= FEASIBLE * max(size, 1.0),
        length,
        length / size if size else 0.0,
        float(np.linalg.norm(change[bodies])) / body if body else 0.0,
        tuple(Blame(str(names[k]), float(change[k])) for k in order.tolist()),
        nearest,
        witness,
        witness[model.inertial_columns[::10]],
        solution.doubt(np.abs(solution.x)) / max(1.0, length),
    )

"""Certificate of physical consistency: distance of given parameters from the nearest consistent parameters.

Parameters are consistent if the pseudo-inertia of every link is positive semidefinite [Wensing2018], and friction and
rotor inertia are not negative. The set of consistent standard parameters θ is a convex cone, and base parameters are
linear in θ. Therefore the smallest distance |L θ - values| is the solution of a small convex program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array
from armid.errors import EstimationError
from armid.estimation.consistency.cones import EPSILON, consistency_cones
from armid.estimation.problem import bare_standard
from armid.maths.conic_solver import Cone, solve_cones
from armid.model.dynamics_model import DynamicsModel
from armid.threads import one_blas_thread

FEASIBLE = 1e-6
"""Largest distance from the nearest consistent values, divided by the norm of the values, with which values count as
consistent. It is the accuracy of the solver."""


@dataclass(frozen=True, slots=True)
class Blame:
    """Difference between one given value and the nearest consistent value.

    Attributes:
        name: Name of the parameter.
        change: Nearest consistent value minus given value.
    """

    name: str
    change: float


@dataclass(frozen=True, eq=False, slots=True)
class Certificate:
    """Result of a check of values for physical consistency.

    Attributes:
        feasible: True if the values are consistent.
        distance: Euclidean distance from the values to the nearest consistent values, in SI units.
        relative_distance: `distance` divided by the norm of the values.
        inertial_distance: Relative distance computed only from the values that depend on inertial parameters.
        blame: Difference between every value and the nearest consistent value, the largest first.
        nearest: Nearest consistent values, in the order of the given values.
        witness: Standard parameters of a consistent arm that has the values `nearest`, shape (p,).
        masses: Masses of the links of this arm, shape (n,) [kg].
        gap: Bound of the difference between `distance` and the smallest possible distance, divided by `distance` or
            by 1, whichever is larger.
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
    """Checks values that are linear in the standard parameters for physical consistency.

    Args:
        model: Arm and torque terms.
        names: Names of the values.
        values: Values that are checked, shape (k,).
        linear: Matrix L with values = L θ, shape (k, p): the regrouping for base parameters, the identity for
            standard parameters.
        epsilon: Smallest allowed eigenvalue of a pseudo-inertia.
        heaviest: Largest allowed mass of a link [kg].

    Raises:
        EstimationError: The program could not be solved accurately enough, or no link can be as light as `heaviest`.
    """
    if heaviest is not None and heaviest <= epsilon:
        raise EstimationError(
            f"The largest allowed mass of a link, `heaviest`, is {heaviest:g} kg; it must be above the smallest "
            f"allowed mass, {epsilon:g} kg.",
            remedy="give `heaviest` a mass that no link of this arm exceeds [kg].",
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

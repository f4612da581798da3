"""Conic programs of consistent estimates: best fit in the cones, and points in their interior.

The accuracy of a solver is relative to the largest number: the right-hand side for data of little noise, or the
masses of heavy bodies. So each program solves for the change from a rough solution, in units of the residual and the
unknowns there. The first units are guesses; later ones follow from the previous solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import UnsolvedError
from armid.estimation.consistency.additional_constraints import Feasible
from armid.maths.conic_solver import Cone, solve_cones, symmetric, upper_triangle
from armid.maths.linalg import orthonormal
from armid.maths.median import median

GOOD = 2e-7
"""Relative gap at which the search ends: a fifth of the largest accepted gap."""

TRIES = 4
"""Largest number of programs from one start; usually one is enough."""

UNIT = 1e3
"""Limit of the median column length; where small noise makes columns longer, they are scaled down to it."""

THIN = 1e-4
"""Smallest ratio of a diagonal entry to the largest one that scales rows; smaller entries count as this ratio."""

ROOM = 0.1
"""Largest slack of a start in each cone; any positive slack is enough."""

FURTHEST = 1e3
"""Limit of the norm of a start, for unknowns that no constraint bounds."""


@dataclass(frozen=True, eq=False, slots=True)
class NearestPoint:
    """Solution of a program.

    Attributes:
        x: Unknowns, which lie in the cones, shape (unknowns,).
        objective: Half the squared residual plus the linear cost.
        gap: Upper bound of objective less minimum, over the larger of the objective and 1.
    """

    x: Array
    objective: float
    gap: float


def nearest(feasible: Feasible, A: Array, y: Array, cost: Array, precision: Array) -> NearestPoint:
    """Minimises ½ |A x - y|² + costᵀ x over the cones; of all attempts the one with the smallest gap.

    Args:
        feasible: Feasible set.
        A: Matrix of the least-squares problem, shape (rows, unknowns).
        y: Right-hand side, shape (rows,).
        cost: Linear cost, shape (unknowns,).
        precision: Prior precision of the unknowns, for the first guess, shape (unknowns,).

    Raises:
        UnsolvedError: The solver failed on every program.
    """
    best, trouble = (
        None,
        UnsolvedError(
            "The solver found no physically consistent parameters.",
            remedy="relax the options heaviest, masses, com, known, fixed or equal, or identify with another method.",
        ),
    )
    for near, units in _starts(A, y, precision):
        size: Array | None = None
        for _ in range(TRIES):
            unit = units.pop(0)
            try:
                change, bound = _change(feasible, A / unit, (y - A @ near) / unit, cost / unit**2, near, size)
            except UnsolvedError as error:
                trouble = error
                if not units:
                    break
                continue
            near = near + change
            residual = float(np.linalg.norm(A @ near - y))
            objective = 0.5 * residual**2 + float(cost @ near)
            found = NearestPoint(near, objective, bound * unit**2 / max(1.0, abs(objective)))
            if found.gap <= GOOD:
                return found
            best = found if best is None or found.gap < best.gap else best
            units = [max(residual, 1.0), 0.1 * residual if residual > 10.0 else float(np.sqrt(unit))]
            size = np.maximum(np.abs(near), 1.0)
    if best is None:
        raise trouble
    return best


def interior_point(feasible: Feasible) -> Array | None:
    """Point with the largest slack in every cone, up to `ROOM`; `None` where no interior point exists."""
    x = feasible.basis.shape[1]
    cones: list[Cone] = []
    for cone in feasible.cones:
        matrix = np.concatenate([cone.matrix, np.zeros((len(cone.matrix), 1))], axis=1)
        if cone.kind == "semidefinite":
            i, j = upper_triangle(len(symmetric(cone.offset)))
            matrix[:, x] = np.where(i == j, -1.0, 0.0)
        else:
            matrix[:, x] = -1.0
        cones.append(Cone(cone.kind, matrix, cone.offset))
    most = np.zeros((1, x + 1))
    most[0, x] = -1.0
    cost = np.zeros(x + 1)
    cost[x] = -1.0
    size = np.concatenate([np.zeros((1, x + 1)), np.eye(x, x + 1)])
    limit = Cone("norm", size, np.append(FURTHEST, np.zeros(x)))
    found = solve_cones(cost, [*cones, Cone("nonnegative", most, np.array([ROOM])), limit])
    return found.x[:x] if found.x[x] > 0.0 else None


def _starts(A: Array, y: Array, precision: Array) -> list[tuple[Array, list[float]]]:
    """Starts of the search, each with the units that are tried first.

    The first start is the minimum without cones, close to the solution for most data. But it may be very large along
    directions that the data hardly determine, so that rounding errors dominate; hence the second start is zero.
    """
    length = np.sqrt(np.sum(A**2, axis=0) + precision)
    whole = np.concatenate([A / length, np.diag(np.sqrt(precision) / length)])
    side = np.concatenate([y, np.zeros(len(length))])
    clear = orthonormal(whole)
    free = np.linalg.lstsq(whole, side, rcond=None)[0] if clear is None else clear[2] @ (clear[0].T @ side)
    free = free / length
    usual = max(float(median(length)) / UNIT, 1.0)
    return [
        (free, [usual, float(length.max())]),
        (np.zeros(len(length)), [max(0.1 * float(np.linalg.norm(y)), 1.0), usual]),
    ]


def _change(
    feasible: Feasible, A: Array, y: Array, cost: Array, near: Array, size: Array | None
) -> tuple[Array, float]:
    """Minimises ½ |A d - y|² + costᵀ d; returns the change d (x,) and a bound of objective less minimum."""
    x = A.shape[1]
    cones = tuple(replace(c, offset=c.offset + c.matrix @ near) for c in feasible.cones)
    cones = cones if size is None else tuple(_scaled(cone, size) for cone in cones)
    size = np.ones(x) if size is None else size
    norm = np.zeros((len(A) + 1, x + 1))
    norm[0, x], norm[1:, :x] = 1.0, A * size
    found = solve_cones(
        np.append(cost * size, 0.0),
        [*_widened(cones, 1), Cone("norm", norm, np.concatenate([[0.0], -y]))],
        np.append(np.zeros(x), 1.0),
    )
    change = found.x[:x] * size
    # The dual residual counts times the size of the unknowns: an unidentified mass may be tons.
    return change, found.doubt(np.append(np.abs(near + change) / size, 0.0))


def _scaled(cone: Cone, size: Array) -> Cone:
    """Equivalent cone with unknowns in units of `size` and rows scaled to about one: S X S is positive where X is."""
    if cone.kind == "semidefinite":
        diagonal = np.diag(symmetric(cone.offset))
        half = 1.0 / np.sqrt(np.maximum(diagonal, max(THIN * float(diagonal.max()), np.finfo(np.float64).tiny)))
        i, j = upper_triangle(len(diagonal))
        rows = half[i] * half[j]
    else:
        rows = 1.0 / np.maximum(np.abs(cone.offset), 1.0)
    return Cone(cone.kind, rows[:, None] * cone.matrix * size, rows * cone.offset)


def _widened(cones: tuple[Cone, ...], more: int) -> list[Cone]:
    """The same cones with `more` further variables that do not enter them."""
    return [replace(c, matrix=np.concatenate([c.matrix, np.zeros((len(c.matrix), more))], axis=1)) for c in cones]

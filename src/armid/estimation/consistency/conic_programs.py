"""Conic programs for consistent estimates: the best fit inside the cones, and points in the interior of the cones.

The accuracy of a solver is relative to the largest number in the program. This number is the right-hand side if the
data have little noise, or the mass of a heavy body. Therefore each program solves for the change from a rough
solution, in units of the residual and the unknowns of that solution. The first units are guesses; later units follow
from the previous solution.
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
"""Relative gap between objective and minimum at which the search ends: a fifth of the largest accepted gap."""

TRIES = 4
"""Largest number of programs that are solved one after the other from one start point; usually one is enough."""

UNIT = 1e3
"""Upper limit of the median length of the columns of the whitened rows. If small noise makes the columns longer, the
unit of the residual is enlarged so that the median has this length."""

THIN = 1e-4
"""Lower limit of a diagonal entry of a matrix that must be semidefinite, divided by the largest diagonal entry; it
limits the factors by which the rows of the cone are scaled."""

ROOM = 0.1
"""Largest distance from the boundaries of the cones that the search for a start point aims at; any positive distance
is enough."""

FURTHEST = 1e3
"""Upper limit of the norm of a start point; needed because constraints do not bound all unknowns."""


@dataclass(frozen=True, eq=False, slots=True)
class NearestPoint:
    """Solution of a conic program.

    Attributes:
        x: Unknowns, which lie in the cones, shape (unknowns,).
        objective: Value ½ |A x - y|² + costᵀ x that the program minimises.
        gap: Upper bound of the difference between `objective` and the minimum, divided by |`objective`| or by 1,
            whichever is larger.
    """

    x: Array
    objective: float
    gap: float


def nearest(feasible: Feasible, A: Array, y: Array, cost: Array, precision: Array) -> NearestPoint:
    """Minimises ½ |A x - y|² + costᵀ x with x in the cones.

    Of several attempts, the one with the smallest gap is returned.

    Args:
        feasible: Feasible set, which contains the cones.
        A: Matrix of the least-squares problem, shape (rows, unknowns).
        y: Right-hand side, shape (rows,).
        cost: Linear cost, shape (unknowns,).
        precision: Prior precision of the unknowns, for the first guess, shape (unknowns,).

    Raises:
        UnsolvedError: The solver failed in every attempt.
    """
    best, trouble = (
        None,
        UnsolvedError(
            "The solver found no physically consistent parameters.",
            remedy="relax the options `heaviest`, `masses`, `com`, `known`, `fixed` or `equal`, or identify with "
            "another method.",
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
    """Point with the largest distance, at most `ROOM`, from the boundary of all cones.

    The result is `None` if no point is inside.
    """
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
    """Start points of the search, each with the units of residual and unknowns for the first program.

    The first start point is the minimum without cones, which is close to the solution for most data. It may be very
    large in directions that the data hardly determine, so that rounding errors dominate. Therefore the second start
    point is zero.
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
    """Minimises ½ |A d - y|² + costᵀ d over the change d (x,) from a point, so that point + d lies in the cones.

    Args:
        feasible: Feasible set, which contains the cones.
        A: Matrix of the least-squares problem, shape (rows, x).
        y: Right-hand side, shape (rows,).
        cost: Linear cost, shape (x,).
        near: The point, shape (x,).
        size: Units of the unknowns for the solver, shape (x,); one if `None`.

    Returns:
        The change d, and an upper bound of the difference between the objective at d and its minimum.
    """
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
    """Equivalent cone with the unknowns in units of `size`.

    Rows are scaled to about one: the condition X ⪰ 0 becomes S X S ⪰ 0 with a diagonal matrix S.
    """
    if cone.kind == "semidefinite":
        diagonal = np.diag(symmetric(cone.offset))
        half = 1.0 / np.sqrt(np.maximum(diagonal, max(THIN * float(diagonal.max()), np.finfo(np.float64).tiny)))
        i, j = upper_triangle(len(diagonal))
        rows = half[i] * half[j]
    else:
        rows = 1.0 / np.maximum(np.abs(cone.offset), 1.0)
    return Cone(cone.kind, rows[:, None] * cone.matrix * size, rows * cone.offset)


def _widened(cones: tuple[Cone, ...], more: int) -> list[Cone]:
    """The same cones in a program with `more` additional variables, on which the cones do not depend."""
    return [replace(c, matrix=np.concatenate([c.matrix, np.zeros((len(c.matrix), more))], axis=1)) for c in cones]

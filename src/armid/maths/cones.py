"""Small conic programs, solved by Clarabel and checked here.

    minimise cᵀx + ½ Σ_k s_k x_k²    so that for every cone K    A x + b ∈ K

Nothing that a solver says of its answer is taken on trust, neither status nor objective nor gap [Goulart2024]. From
the variables and multipliers it is computed by how much these really leave each cone, by eigenvalues for semidefinite
ones, and how far the objective stands above what the multipliers z prove, -½ Σ_k s_k x_k² - Σ bᵀz.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from armid.errors import UnsolvedError
from armid.values import Array

__all__ = ["Cone", "ConeSolution", "solve_cones", "symmetric", "upper_triangle"]

SOLVER_TOLERANCE = 1e-9
"""Gap and infeasibility asked of the solver: a tenth of what a certificate states."""

ACCEPTED = 1e-6
"""Largest gap and violation of an accepted answer, over the size of objective and cone: what the solver reaches on
badly scaled problems. Anything worse is refused whatever the status says."""


LARGEST = 1e100
"""Size of a variable that is no answer: its square must still be a number."""


@dataclass(frozen=True, eq=False, slots=True)
class Cone:
    """Rows A x + b that must lie in a cone.

    Attributes:
        kind: `nonnegative`; `norm`, the first row being at least the length of the others; or `semidefinite`, the
            rows being the upper triangle of a symmetric matrix, column by column.
        matrix: A, shape (rows, variables).
        offset: b, shape (rows,).
    """

    kind: Literal["nonnegative", "norm", "semidefinite"]
    matrix: Array
    offset: Array

    def leaves(self, x: Array) -> float:
        """By how much x lies outside, over the size of the rows; zero or negative inside."""
        return self.outside(self.matrix @ x + self.offset)

    def outside(self, rows: Array) -> float:
        """By how much rows, or multipliers of rows, lie outside, over their size; each cone is its own dual."""
        size = max(1.0, float(np.abs(rows).max()))
        if self.kind == "nonnegative":
            return float(-rows.min()) / size
        if self.kind == "norm":
            return float(np.linalg.norm(rows[1:]) - rows[0]) / size
        return float(-np.linalg.eigvalsh(symmetric(rows))[0]) / size


@dataclass(frozen=True, eq=False, slots=True)
class ConeSolution:
    """Answer of a conic program, checked.

    Attributes:
        x: The variables.
        objective: What was minimised.
        gap: Objective less what the multipliers prove, over its size.
        slope: Slope of the objective that no multiplier holds, shape (variables,). Where variables may still move
            by d, the minimum may lie lower by slope · d.
        violation: By how much variables or multipliers leave the worst cone, over the size of its rows.
    """

    x: Array
    objective: float
    gap: float
    slope: Array
    violation: float

    def doubt(self, size: Array) -> float:
        """By how much the minimum may lie below the objective, over variables (variables,) up to some size."""
        return self.gap * max(1.0, abs(self.objective)) + float(np.abs(self.slope) @ size)


@cache
def upper_triangle(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of an upper triangle, column by column."""
    j, i = np.tril_indices(size)
    return i, j


def symmetric(entries: Array) -> Array:
    """Symmetric matrices (..., m, m) from upper triangles (..., entries), column by column."""
    order = _order(entries.shape[-1])
    i, j = upper_triangle(order)
    result = np.zeros((*entries.shape[:-1], order, order))
    result[..., i, j] = result[..., j, i] = entries
    return result


def solve_cones(cost: Array, cones: Sequence[Cone], squares: Array | None = None) -> ConeSolution:
    """Solve, and check the answer.

    Args:
        cost: c, shape (variables,).
        cones: At least one.
        squares: s, not negative, shape (variables,); none where not given. They are meant for the length of a
            residual that a `norm` cone bounds, not for single parameters.

    Raises:
        UnsolvedError: The answer is not one: the solver's word, the gap and the violation are in the message.
    """
    clarabel: Any = import_module("clarabel")
    sparse: Any = import_module("scipy.sparse")
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = SOLVER_TOLERANCE
    rows, offsets, kinds = zip(*(_for_solver(cone, clarabel) for cone in cones), strict=True)
    A = sparse.csc_matrix(np.concatenate(rows))
    squares = np.zeros(len(cost)) if squares is None else squares
    curved = sparse.csc_matrix(sparse.diags(squares))
    answer = clarabel.DefaultSolver(curved, cost, A, np.concatenate(offsets), list(kinds), settings).solve()
    x, z = np.array(answer.x, dtype=np.float64), np.array(answer.z, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # a solver that failed may leave anything
        half = 0.5 * float(squares @ x**2)
        objective = float(cost @ x) + half
        slope = cost + squares * x + A.T @ z
        gap = abs(objective + half + float(np.concatenate(offsets) @ z)) / max(1.0, abs(objective))
        finite = bool(np.abs(np.concatenate([x, z])).max() < LARGEST)  # false for what is no number
        violation = _worst(cones, x, z) if finite else float("inf")
    if not (gap <= ACCEPTED and violation <= ACCEPTED):
        raise UnsolvedError(
            f"The conic solver gave no answer ({answer.status}; gap {gap:.1e}, violation {violation:.1e}).",
            remedy="check the size of the values: parameters of one arm should not differ by more than 1e8.",
        )
    return ConeSolution(x, objective, gap, slope, violation)


def _worst(cones: Sequence[Cone], x: Array, z: Array) -> float:
    """By how much variables, or multipliers in the solver's scale, leave the cone that they leave most."""
    worst, done = -math.inf, 0
    for cone in cones:
        own = z[done : done + len(cone.offset)]
        done += len(own)
        own = own / _scale(cone) if cone.kind == "semidefinite" else own
        worst = max(worst, cone.leaves(x), cone.outside(own))
    return worst


def _for_solver(cone: Cone, clarabel: Any) -> tuple[Array, Array, Any]:
    """A and b with A x + s = b, and the solver's cone; it scales off-diagonal entries by √2."""
    if cone.kind == "nonnegative":
        return -cone.matrix, cone.offset, clarabel.NonnegativeConeT(len(cone.offset))
    if cone.kind == "norm":
        return -cone.matrix, cone.offset, clarabel.SecondOrderConeT(len(cone.offset))
    scale = _scale(cone)
    order = _order(len(cone.offset))
    return -scale[:, None] * cone.matrix, scale * cone.offset, clarabel.PSDTriangleConeT(order)


def _scale(cone: Cone) -> Array:
    """Return the solver's factors of the entries of an upper triangle, so that its inner product is the matrices'."""
    i, j = upper_triangle(_order(len(cone.offset)))
    return np.where(i == j, 1.0, math.sqrt(2.0))


def _order(entries: int) -> int:
    """Order of a symmetric matrix with so many entries in its upper triangle."""
    return round((math.sqrt(8 * entries + 1) - 1) / 2)

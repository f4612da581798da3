"""Small conic programs, which are solved by Clarabel; the solutions are then checked.

    minimise cᵀx + ½ Σ_k s_k x_k²    so that for every cone K    A x + b ∈ K

Status, objective and gap of the solver [Goulart2024] are not used. Two quantities are computed here from the
variables x and the multipliers z: the violation of each cone (for semidefinite cones from eigenvalues), and the gap
between the objective and the dual bound -½ Σ_k s_k x_k² - Σ bᵀz.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module, util
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import UnsolvedError

SOLVER_TOLERANCE = 1e-9
"""Relative gap and infeasibility that are requested from the solver: a tenth of the values that a certificate
states."""

ACCEPTED = 1e-6
"""Largest gap and violation of an accepted solution, relative to the size of the objective and of the rows of the
cone. The solver reaches this accuracy on badly scaled problems. A less accurate solution is rejected, whatever the
status of the solver."""


SETTINGS: tuple[dict[str, Any], ...] = (
    {},
    {"equilibrate_enable": False},
    {"direct_solve_method": "faer"},
    {"max_step_fraction": 0.9},
)
"""Settings of the solver, tried in this order until a solution passes the check. If the minimum is only approached as
unknowns grow without bound (for instance a mass without an upper bound), it depends on rounding errors with which
settings the solver reaches its accuracy."""

LARGEST = 1e100
"""Absolute value above which a variable counts as invalid, because its square must be finite."""


@dataclass(frozen=True, eq=False, slots=True)
class Cone:
    """Condition that the vector A x + b lies in a cone.

    Attributes:
        kind: `nonnegative`: no row is negative. `norm`: the first row is at least the Euclidean norm of the others.
            `semidefinite`: the rows are the upper triangle, column by column, of a symmetric matrix that is positive
            semidefinite.
        matrix: Matrix A, shape (rows, variables).
        offset: Offset b, shape (rows,).
    """

    kind: Literal["nonnegative", "norm", "semidefinite"]
    matrix: Array
    offset: Array

    def leaves(self, x: Array) -> float:
        """Relative violation of the condition at x; zero or negative if the condition holds.

        The violation is divided by the largest absolute value of A x + b or by 1, whichever is larger.
        """
        return self.outside(self.matrix @ x + self.offset)

    def outside(self, rows: Array) -> float:
        """Violation of the cone by given rows (rows,), zero or negative if they are in the cone.

        It is divided by the largest absolute value of the rows or by 1, whichever is larger. The rows may also be
        multipliers, because each cone is its own dual.
        """
        size = max(1.0, float(np.abs(rows).max()))
        if self.kind == "nonnegative":
            return float(-rows.min()) / size
        if self.kind == "norm":
            return float(np.linalg.norm(rows[1:]) - rows[0]) / size
        return float(-np.linalg.eigvalsh(symmetric(rows))[0]) / size


@dataclass(frozen=True, eq=False, slots=True)
class SparseColumns:
    """Matrix in compressed sparse column format, with the attributes of a SciPy matrix that the solver reads.

    The sparse matrices of SciPy are not used, because their import takes longer than the solution of most programs.

    Attributes:
        shape: Numbers of rows and columns.
        data: Nonzero entries, column by column, shape (entries,).
        indices: Row of each entry, increasing within each column, shape (entries,).
        indptr: Index of the first entry of each column, and the number of entries, shape (columns + 1,).
        has_sorted_indices: True if the row indices increase within each column.
        has_canonical_format: True if there is at most one entry for each row and column.
    """

    shape: tuple[int, int]
    data: Array
    indices: NDArray[np.int32]
    indptr: NDArray[np.int32]
    has_sorted_indices: bool = True
    has_canonical_format: bool = True

    @property
    def nnz(self) -> int:
        """Number of stored (nonzero) entries."""
        return len(self.data)

    @classmethod
    def of(cls, matrix: Array) -> SparseColumns:
        """Converts a dense matrix (rows, columns)."""
        column, row = np.nonzero(matrix.T)
        ends = np.concatenate([[0], np.bincount(column, minlength=matrix.shape[1]).cumsum()])
        data = np.ascontiguousarray(matrix[row, column])
        return cls((len(matrix), matrix.shape[1]), data, row.astype(np.int32), ends.astype(np.int32))


@dataclass(frozen=True, eq=False, slots=True)
class ConeSolution:
    """Checked solution of a conic program.

    Attributes:
        x: The variables, shape (variables,).
        objective: Objective at x.
        gap: Difference between the objective and the dual bound, divided by the objective or by 1, whichever is
            larger.
        slope: Dual residual, shape (variables,). A change d of the variables may lower the minimum by slope · d.
        violation: Largest violation of a cone by variables or multipliers, as returned by `Cone.outside`.
    """

    x: Array
    objective: float
    gap: float
    slope: Array
    violation: float

    def doubt(self, size: Array) -> float:
        """Upper bound of objective minus minimum, if no variable exceeds `size` (variables,) at the minimum."""
        return self.gap * max(1.0, abs(self.objective)) + float(np.abs(self.slope) @ size)


@cache
def upper_triangle(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column indices of the upper triangle of a matrix (size, size), column by column."""
    j, i = np.tril_indices(size)
    return i, j


def symmetric(entries: Array) -> Array:
    """Symmetric matrices (..., m, m) from the entries of their upper triangles (..., entries), column by column."""
    order = _order(entries.shape[-1])
    i, j = upper_triangle(order)
    result = np.zeros((*entries.shape[:-1], order, order))
    result[..., i, j] = result[..., j, i] = entries
    return result


def solve_cones(cost: Array, cones: Sequence[Cone], squares: Array | None = None) -> ConeSolution:
    """Solves a conic program and checks the solution.

    Args:
        cost: Linear cost c, shape (variables,).
        cones: Cones, at least one.
        squares: Quadratic cost s, not negative, shape (variables,); zero if not given. It is meant for the square of
            a variable that bounds a norm (cone `norm`), not for single parameters.

    Raises:
        UnsolvedError: The solution fails its check. The message gives the status of the solver, gap and violation.
    """
    squares = np.zeros(len(cost)) if squares is None else squares
    status, found = "", None
    for settings in SETTINGS:
        status, found = _solved(cost, cones, squares, settings)
        if found.gap <= ACCEPTED and found.violation <= ACCEPTED:
            return found
    assert found is not None
    raise UnsolvedError(
        f"The conic solver found no solution ({status}; gap {found.gap:.1e}, violation {found.violation:.1e}).",
        remedy="check the size of the values: the parameters of an arm should not differ by more than a factor "
        "of 1e8.",
    )


def _solved(cost: Array, cones: Sequence[Cone], squares: Array, changed: dict[str, Any]) -> tuple[Any, ConeSolution]:
    """Runs the solver with some changed settings; returns its status and the solution, which is not yet checked."""
    clarabel: Any = import_module("clarabel")
    _load_lapack()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = SOLVER_TOLERANCE
    for name, value in changed.items():
        setattr(settings, name, value)
    rows, offsets, kinds = zip(*(_for_solver(cone, clarabel) for cone in cones), strict=True)
    A, b = np.concatenate(rows), np.concatenate(offsets)
    curved = SparseColumns.of(np.diag(squares))
    answer = clarabel.DefaultSolver(curved, cost, SparseColumns.of(A), b, list(kinds), settings).solve()
    x, z = np.array(answer.x, dtype=np.float64), np.array(answer.z, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # a failed solver may return any numbers
        half = 0.5 * float(squares @ x**2)
        objective = float(cost @ x) + half
        slope = cost + squares * x + A.T @ z
        gap = abs(objective + half + float(b @ z)) / max(1.0, abs(objective))
        finite = bool(np.abs(np.concatenate([x, z])).max() < LARGEST)  # false for NaN
        violation = _worst(cones, x, z) if finite else float("inf")
    return answer.status, ConeSolution(x, objective, gap, slope, violation)


def _worst(cones: Sequence[Cone], x: Array, z: Array) -> float:
    """Largest relative violation of the cones by the variables x or the multipliers z that the solver returns."""
    worst, done = -math.inf, 0
    for cone in cones:
        own = z[done : done + len(cone.offset)]
        done += len(own)
        own = own / _scale(cone) if cone.kind == "semidefinite" else own
        worst = max(worst, cone.leaves(x), cone.outside(own))
    return worst


@cache
def _load_lapack() -> None:
    """Loads the functions of LAPACK that Clarabel takes from SciPy, without the rest of `scipy.linalg`.

    Clarabel imports two modules of functions from this package, and the package imports much else, which takes longer
    than most programs here. Where one of the two cannot be loaded alone, Clarabel imports them itself.
    """
    if "scipy.linalg" in sys.modules:
        return
    places = [str(Path(place) / "linalg") for place in import_module("scipy").__path__]
    for name in ("scipy.linalg.cython_blas", "scipy.linalg.cython_lapack"):
        spec = PathFinder.find_spec(name, places)
        if spec is None or spec.loader is None:
            return
        with suppress(ImportError):
            module = util.module_from_spec(spec)
            spec.loader.exec_module(module)
            sys.modules[name] = module


def _for_solver(cone: Cone, clarabel: Any) -> tuple[Array, Array, Any]:
    """Converts a cone for the solver: A and b of A x + s = b, and the solver's object for the cone of s.

    The solver expects the off-diagonal entries of a semidefinite cone multiplied by √2.
    """
    if cone.kind == "nonnegative":
        return -cone.matrix, cone.offset, clarabel.NonnegativeConeT(len(cone.offset))
    if cone.kind == "norm":
        return -cone.matrix, cone.offset, clarabel.SecondOrderConeT(len(cone.offset))
    scale = _scale(cone)
    order = _order(len(cone.offset))
    return -scale[:, None] * cone.matrix, scale * cone.offset, clarabel.PSDTriangleConeT(order)


def _scale(cone: Cone) -> Array:
    """Factors by which the solver multiplies the entries of an upper triangle: 1 on the diagonal, √2 elsewhere.

    With these factors, the inner product of two triangles is that of the symmetric matrices.
    """
    i, j = upper_triangle(_order(len(cone.offset)))
    return np.where(i == j, 1.0, math.sqrt(2.0))


def _order(entries: int) -> int:
    """Order m of a symmetric matrix (m, m) whose upper triangle has `entries` entries."""
    return round((math.sqrt(8 * entries + 1) - 1) / 2)

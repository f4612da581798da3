"""Consistent parameters that fit whitened rows best, with a prior or without: the convex programs.

    minimise |A (L θ) - y|    so that θ lies in the cone of real bodies

The prior is added to half the square; `none` is a mass prior too weak to be felt. The residual enters as a
second-order cone or by its rows, never as AᵀA, which would lose half of the digits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.errors import EstimationError, UnsolvedError
from armid.estimation.conflicts import conflicting
from armid.estimation.consistency import smallest_eigenvalues
from armid.estimation.constraints import ContradictionError, Feasible, Requirements, feasible_set
from armid.estimation.prior import MASS, Belief, size_of_bodies
from armid.estimation.problem import Standard
from armid.maths.barrier import GAP, Smooth, SmoothSolution, minimise
from armid.maths.cones import ACCEPTED, Cone, solve_cones
from armid.values import Array

__all__ = ["Bodies", "Program"]

UNFELT = 1e-6
"""Weight of a mass prior that stands for none: without any there need be no smallest residual, since bodies of
infinite mass can come ever nearer to it."""

MARGINS = (1e-8, 1e-7, 1e-6, 1e-5)
"""Added to the eigenvalues asked for, until what the solver's last digits leave is no less than asked."""

GOOD = 2e-7
"""Gap at which an answer is taken, over the size of the objective: a fifth of the largest that is accepted."""

TRIES = 5
"""Most programs for one answer; one is usual."""

UNIT = 1e3
"""Size that columns are scaled down to where noise is so small that they are larger."""

ROOM = 0.1
"""Most slack that a start of the search is given in each cone; any positive one does."""


@dataclass(frozen=True, eq=False, slots=True)
class Bodies:
    """A solution that was checked.

    Attributes:
        values: Standard parameters (p,).
        basis: Parameters (p,) that each unknown moves, shape (p, x).
        objective: Half the squared residual beyond the best, and the prior.
        gap: By how much the minimum may lie below, relative.
    """

    values: Array
    basis: Array
    objective: float
    gap: float


@dataclass(frozen=True, eq=False, slots=True)
class Program:
    """What is asked of the parameters, whatever the data.

    Attributes:
        standard: The standard parameters.
        asked: Constraints.
        kind: `mass`, `log-det`, `euclidean` or `none`.
        belief: The prior.
        correlation: Rows that count as one independent sample.
    """

    standard: Standard
    asked: Requirements
    kind: str
    belief: Belief
    correlation: float = 1.0

    def solve(self, rows: Array, side: Array, weight: float, *, aim: float = GAP) -> Bodies:
        """The best parameters.

        Args:
            rows: Whitened rows, shape (k, b).
            side: Shape (k,).
            weight: Of the prior of the links, in independent samples.
            aim: Gap aimed at, where the method can choose.

        Raises:
            EstimationError: The constraints contradict each other.
        UnsolvedError: No checked solution was found.
        """
        for margin in MARGINS:
            try:
                feasible = feasible_set(self.standard, self.asked, margin)
            except ContradictionError as error:
                raise self._contradiction() from error
            if not feasible.basis.shape[1]:
                raise EstimationError("Every parameter is given; there is nothing to estimate.")
            found = self._solve(feasible, rows, side, weight, aim)
            found = replace(found, values=self._cleared(found.values))
            if self._holds(found.values, feasible):
                return found
        raise UnsolvedError(
            "The solver's answer is not physical within its last digits.",
            remedy="ask for a smaller epsilon, or look at constraints that contradict each other.",
        )

    def _solve(self, feasible: Feasible, rows: Array, side: Array, weight: float, aim: float) -> Bodies:
        A = rows @ self.standard.regrouping
        y = side - A @ feasible.origin
        A = A @ feasible.basis
        if self.kind == "log-det":
            return self._log_det(feasible, A, y, weight, aim)
        weak = np.diag(self.belief.precision) @ feasible.basis**2
        believed = np.diag(self.belief.precision)
        cost = np.zeros(A.shape[1])
        is_link = np.isin(np.arange(len(believed)), self.standard.inertial)
        linear = self.kind in ("mass", "none")
        scale = UNFELT if self.kind == "none" else 1.0
        if linear:
            size = size_of_bodies(self.standard) @ feasible.basis
            cost = self.correlation * (UNFELT if self.kind == "none" else weight) / MASS * size
        root = np.sqrt(self.correlation * np.where(is_link, 0.0 if linear else weight, scale) * believed)
        A = np.concatenate([A, (root[:, None] * feasible.basis)[root > 0.0]])
        y = np.concatenate([y, (root * (self.belief.mean - feasible.origin))[root > 0.0]])
        try:
            return _nearest(feasible, A, y, cost, weak)
        except UnsolvedError:  # another method for what the first has no digits for
            found = minimise(Smooth(A, y, (), feasible.cones, cost), self._start(feasible), aim=aim)
            return Bodies(feasible.of(found.x), feasible.basis, found.objective, found.gap)

    def _log_det(self, feasible: Feasible, A: Array, y: Array, weight: float, aim: float) -> Bodies:
        """By Newton's method, first without the smallest eigenvalue, which the prior nearly always gives."""
        others = np.setdiff1d(np.arange(len(self.standard.names)), self.standard.inertial)
        root = np.sqrt(self.correlation * np.diag(self.belief.precision)[others])[:, None]
        A = np.concatenate([A, root * feasible.basis[others]])
        y = np.concatenate([y, root[:, 0] * (self.belief.mean - feasible.origin)[others]])
        terms = self.belief.log_det(self.standard, feasible.origin, feasible.basis, self.correlation * weight)
        loose = tuple(cone for cone in feasible.cones if cone.kind != "semidefinite")
        nothing = np.zeros(A.shape[1])
        found = self._smooth(feasible, Smooth(A, y, terms, loose, nothing), aim)
        values = feasible.of(found.x)
        if not self._holds(self._cleared(values), feasible):
            found = self._smooth(feasible, Smooth(A, y, terms, feasible.cones, nothing), aim)
            values = feasible.of(found.x)
        return Bodies(values, feasible.basis, found.objective, found.gap)

    def _smooth(self, feasible: Feasible, problem: Smooth, aim: float) -> SmoothSolution:
        """The minimum with log-det terms: from where it is without the logarithms, or else from the prior's mean.

        Without them the program is conic, and solved where a path of Newton's steps would be long.
        """
        cost = np.array([term.weight * term.cost for term in problem.terms]).sum(axis=0)
        weight = min((term.weight for term in problem.terms), default=0.0)
        weak = np.diag(self.belief.precision) @ feasible.basis**2
        try:
            x = feasible.unknowns(_nearest(feasible, problem.A, problem.y, cost, weak).values)
            slope = problem.A.T @ (problem.A @ x - problem.y) + cost
            pull = feasible.basis @ (slope / np.sum(feasible.basis**2, axis=0))
            lifted = self.belief.lifted(self.standard, feasible.of(x), pull, weight)
            return minimise(problem, feasible.unknowns(lifted), aim=aim, near=True)
        except EstimationError:
            return minimise(problem, self._start(feasible), aim=aim)

    def _start(self, feasible: Feasible) -> Array:
        """Unknowns strictly inside: bodies and some friction, or else what a conic program finds."""
        start = feasible.unknowns(self.belief.inside(self.standard))
        if all(cone.leaves(start) < 0.0 for cone in feasible.cones):
            return start
        found = _inside(feasible)
        if found is None:
            raise self._contradiction()
        return found

    def _contradiction(self) -> ContradictionError:
        """What is said of requirements that leave no body."""

        def empty(asked: Requirements) -> bool:
            try:
                feasible = feasible_set(self.standard, asked)
                return bool(feasible.cones) and _inside(feasible) is None
            except EstimationError:
                return True

        together = "; ".join(conflicting(self.asked, empty))
        return ContradictionError(
            f"No body can have what is required: {together or 'an epsilon'} contradict each other or physics.",
            remedy="take one of these back.",
        )

    def _cleared(self, values: Array) -> Array:
        """Values that the solver left a rounding below zero are zero."""
        bounded = self.standard.nonnegative & (values < 0.0) & (values > -ACCEPTED)
        return np.where(bounded, 0.0, values)

    def _holds(self, values: Array, feasible: Feasible) -> bool:
        """Whether the bodies are physical and every other constraint holds, computed from the values."""
        least = smallest_eigenvalues(self.standard, values)
        estimated = (feasible.basis[self.standard.inertial] != 0.0).any(axis=(1, 2))
        x = feasible.unknowns(values)
        others = [cone for cone in feasible.cones if cone.kind != "semidefinite"]
        return (
            bool(np.isfinite(values).all())
            and bool((least[estimated] >= self.asked.epsilon).all())
            and bool((values[self.standard.nonnegative] >= 0.0).all())
            and all(cone.leaves(x) <= ACCEPTED for cone in others)
        )


def _nearest(feasible: Feasible, A: Array, y: Array, cost: Array, precision: Array) -> Bodies:
    """The unknowns x that minimise ½ |A x - y|² + costᵀ x.

    Solvers count digits from the largest number, which with data of little noise is the right-hand side. So the
    program is about the change from a place near the answer, and in units of the size that the residual may have
    there: the first are guesses, the next come from a rougher answer.
    """
    x = A.shape[1]
    length = np.sqrt(np.sum(A**2, axis=0) + precision)
    whole = np.concatenate([A / length, np.diag(np.sqrt(precision) / length)])
    near = np.linalg.lstsq(whole, np.concatenate([y, np.zeros(x)]), rcond=None)[0] / length
    units = [max(float(np.median(length)) / UNIT, 1.0), float(length.max())]
    trouble = UnsolvedError("No consistent parameters were found.")
    for _ in range(TRIES):
        unit = units.pop(0)
        try:
            change, gap = _change(feasible, A / unit, (y - A @ near) / unit, cost / unit**2, near)
        except UnsolvedError as error:
            trouble = error
            if not units:
                break
            continue
        near = near + change
        residual = float(np.linalg.norm(A @ near - y))
        objective = 0.5 * residual**2 + float(cost @ near)
        relative = gap * unit**2 / max(1.0, abs(objective))
        if relative <= GOOD:
            return Bodies(feasible.of(near), feasible.basis, objective, relative)
        trouble = UnsolvedError(f"The conic solver left a gap of {relative:.1e} of the objective.")
        units = [max(residual, 1.0), max(0.1 * residual, 1.0)]
    raise trouble


def _change(feasible: Feasible, A: Array, y: Array, cost: Array, near: Array) -> tuple[Array, float]:
    """The change d (x,) of the unknowns that minimises ½ |A d - y|² + costᵀ d, and the gap."""
    x = A.shape[1]
    norm = np.zeros((len(A) + 1, x + 1))
    norm[0, x], norm[1:, :x] = 1.0, A
    cones = tuple(replace(c, offset=c.offset + c.matrix @ near) for c in feasible.cones)
    found = solve_cones(
        np.append(cost, 0.0),
        [*_widened(cones, 1), Cone("norm", norm, np.concatenate([[0.0], -y]))],
        np.append(np.zeros(x), 1.0),
    )
    change = found.x[:x]
    # The slope that is left matters where nothing else holds unknowns: tons that no torque tells of.
    further = float(np.abs(found.slope[:x]) @ np.abs(near + change))
    return change, found.gap * max(1.0, abs(found.objective)) + further


def _inside(feasible: Feasible) -> Array | None:
    """Unknowns with as much slack in every cone as there is, up to some; `None` where there is none."""
    x = feasible.basis.shape[1]
    cones: list[Cone] = []
    for cone in feasible.cones:
        matrix = np.concatenate([cone.matrix, np.zeros((len(cone.matrix), 1))], axis=1)
        if cone.kind == "semidefinite":
            j, i = np.tril_indices(round((np.sqrt(8 * len(matrix) + 1) - 1) / 2))
            matrix[:, x] = np.where(i == j, -1.0, 0.0)
        else:
            matrix[:, x] = -1.0
        cones.append(Cone(cone.kind, matrix, cone.offset))
    most = np.zeros((1, x + 1))
    most[0, x] = -1.0
    cost = np.zeros(x + 1)
    cost[x] = -1.0
    # Without a limit of their size, unknowns that nothing bounds would go anywhere.
    size = np.concatenate([np.zeros((1, x + 1)), np.eye(x, x + 1)])
    found = solve_cones(
        cost, [*cones, Cone("nonnegative", most, np.array([ROOM])), Cone("norm", size, np.append(1e3, np.zeros(x)))]
    )
    return found.x[:x] if found.x[x] > 0.0 else None


def _widened(cones: tuple[Cone, ...], more: int) -> list[Cone]:
    """The same cones with further variables that do not touch them."""
    return [replace(c, matrix=np.concatenate([c.matrix, np.zeros((len(c.matrix), more))], axis=1)) for c in cones]

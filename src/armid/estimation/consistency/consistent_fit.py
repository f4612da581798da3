"""Physically consistent parameters that fit whitened rows best, with or without a prior, by convex programs.

    minimise ½ |A L θ - y|² + prior(θ)        with the standard parameters θ in the cone of real bodies

Here A and y are the whitened rows and their right-hand side, and the matrix L computes the base parameters from θ. If
no prior is asked for (`prior = "none"`), a mass prior with a negligible weight is used. The program contains the rows
of A and not the product AᵀA, which would lose half of the digits.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, UnsolvedError
from armid.estimation.consistency.additional_constraints import (
    ContradictionError,
    Feasible,
    Requirements,
    feasible_set,
)
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.consistency.conic_programs import GOOD, NearestPoint, interior_point, nearest
from armid.estimation.consistency.infeasible_subset import conflicting
from armid.estimation.prior import MASS, Prior, size_of_bodies
from armid.estimation.problem import StandardParameters
from armid.maths.barrier_function import Smooth
from armid.maths.barrier_method import GAP, SmoothSolution, minimise
from armid.maths.conic_solver import ACCEPTED

UNFELT = (1e-6, 1e-4, 1e-2)
"""Negligible weights of a mass prior, used for the option `prior = "none"`; the first weight that the solver can
resolve is used. Without any prior the residual may have no minimum, because it may decrease without end as masses
grow. The largest weight changes a parameter of standard deviation s kg by s/1000 standard deviations."""

SHORT = 60
"""Largest number of Newton steps from the mean of the prior before another start point is tried; 20 to 40 are
usual."""

MARGINS = (1e-8, 1e-7, 1e-6, 1e-5)
"""Margins that are added to the required eigenvalues, one after the other, until the rounded solution meets the
requirement."""


@dataclass(frozen=True, eq=False, slots=True)
class BodyConstraints:
    """Physically consistent parameters that fit the data best; the checks of this module have accepted them.

    Attributes:
        values: Standard parameters (p,).
        basis: Derivative of the parameters by the x unknowns, shape (p, x).
        objective: Half the squared residual, minus that of unconstrained least squares, plus the cost of the prior.
        gap: Upper bound of the difference between `objective` and its minimum, relative to the objective.
    """

    values: Array
    basis: Array
    objective: float
    gap: float


@dataclass(frozen=True, eq=False, slots=True)
class ConsistentProgram:
    """Constraints and prior of the standard parameters, from which a program for any data can be made.

    Attributes:
        standard: The standard parameters.
        asked: Constraints that the options of the estimator ask for, for instance known masses.
        kind: Kind of prior: `mass`, `log-det`, `euclidean` or `none`.
        belief: The prior for weight 1.
        correlation: Number of rows that count as one independent sample.
    """

    standard: StandardParameters
    asked: Requirements
    kind: str
    belief: Prior
    correlation: float = 1.0

    def solve(self, rows: Array, side: Array, weight: float, *, aim: float = GAP) -> BodyConstraints:
        """Computes the parameters with the smallest cost.

        Args:
            rows: Whitened rows, shape (k, b).
            side: Right-hand side of the whitened rows, shape (k,).
            weight: Weight of the links' prior, in independent samples.
            aim: Difference between the cost and its minimum at which Newton's method ends.

        Raises:
            EstimationError: The constraints contradict each other.
            UnsolvedError: The solver found no solution that passes the checks.
        """
        for margin in MARGINS:
            try:
                feasible = feasible_set(self.standard, self.asked, margin)
            except ContradictionError as error:
                raise self._contradiction() from error
            if not feasible.basis.shape[1]:
                raise EstimationError(
                    "All parameters are given by options, so no parameter is left to estimate.",
                    remedy="remove links from `known`, or names from `fixed`.",
                )
            found = self._solve(feasible, rows, side, weight, aim)
            found = replace(found, values=self._cleared(found.values))
            if self._holds(found.values, feasible):
                return found
        raise UnsolvedError(
            "The solution is not physically consistent within rounding errors.",
            remedy="choose a smaller `epsilon`, or remove constraints that contradict each other.",
        )

    def _solve(self, feasible: Feasible, rows: Array, side: Array, weight: float, aim: float) -> BodyConstraints:
        A = rows @ self.standard.regrouping
        y = side - A @ feasible.origin
        A = A @ feasible.basis
        if self.kind == "log-det":
            return self._log_det(feasible, A, y, weight, aim)
        if self.kind != "none":
            return self._conic(feasible, A, y, weight, aim)
        for unfelt in UNFELT:
            with contextlib.suppress(UnsolvedError):
                return self._conic(feasible, A, y, unfelt, None)
        # A weight that is negligible for the noise may vanish by rounding where the residual is far larger than the
        # noise.
        least = self._conic(feasible, A, y, 1.0, aim).objective
        return self._conic(feasible, A, y, max(UNFELT[-1], UNFELT[0] * least / len(y)), aim)

    def _conic(self, feasible: Feasible, A: Array, y: Array, weight: float, aim: float | None) -> BodyConstraints:
        """Solution with a linear or quadratic prior by the conic solver.

        If this solution is inaccurate, the result of `_otherwise` is returned.

        Args:
            feasible: Set of the parameters that meet all constraints.
            A: Whitened rows in the x unknowns, shape (k, x).
            y: Right-hand side of the rows, shape (k,).
            weight: Weight of the links' prior, in independent samples.
            aim: Difference between the cost and its minimum at which Newton's method ends; `None` for no use of it.
        """
        believed = np.diag(self.belief.precision)
        is_link = np.isin(np.arange(len(believed)), self.standard.inertial)
        cost = np.zeros(A.shape[1])
        share = np.where(is_link, weight, weight if self.kind == "none" else 1.0)
        if self.kind in ("mass", "none"):
            share[is_link] = 0.0
            cost = self.correlation * weight / MASS * (size_of_bodies(self.standard) @ feasible.basis)
        root = np.sqrt(self.correlation * share * believed)
        A = np.concatenate([A, (root[:, None] * feasible.basis)[root > 0.0]])
        y = np.concatenate([y, (root * (self.belief.mean - feasible.origin))[root > 0.0]])
        found: NearestPoint | SmoothSolution | None = None
        with contextlib.suppress(UnsolvedError):
            found = self._nearest(feasible, A, y, cost)
        if found is None or found.gap > GOOD:
            found = self._otherwise(feasible, Smooth(A, y, (), feasible.cones, cost), found, aim)
        return BodyConstraints(feasible.of(found.x), feasible.basis, found.objective, found.gap)

    def _otherwise(
        self, feasible: Feasible, problem: Smooth, rough: NearestPoint | None, aim: float | None
    ) -> NearestPoint | SmoothSolution:
        """Solution by Newton's method, used if the solution of the conic solver is inaccurate.

        If `aim` is `None` or Newton's method fails, the solution of the conic solver is returned.

        Args:
            feasible: Set of the parameters that meet all constraints.
            problem: The problem in the unknowns.
            rough: Solution of the conic solver; `None` if it failed.
            aim: Difference between the cost and its minimum at which Newton's method ends.

        Raises:
            UnsolvedError: Neither solution is accurate enough.
        """
        trouble = UnsolvedError(
            "The duality gap of the conic solver is too large, so its solution is not accurate.",
            remedy="choose a prior with the option `prior`, or identify with --method log-cholesky.",
        )
        if aim is not None:
            try:
                return minimise(problem, self._start(feasible), aim=aim)
            except UnsolvedError as error:
                trouble = error
        if rough is None or rough.gap > ACCEPTED:
            raise trouble
        return rough

    def _nearest(self, feasible: Feasible, A: Array, y: Array, cost: Array) -> NearestPoint:
        return nearest(feasible, A, y, cost, np.diag(self.belief.precision) @ feasible.basis**2)

    def _log_det(self, feasible: Feasible, A: Array, y: Array, weight: float, aim: float) -> BodyConstraints:
        """Solution with a log-det prior by Newton's method; the bound of eigenvalues is used only if it is active.

        Args:
            feasible: Set of the parameters that meet all constraints.
            A: Whitened rows in the x unknowns, shape (k, x).
            y: Right-hand side of the rows, shape (k,).
            weight: Weight of the links' prior, in independent samples.
            aim: Difference between the cost and its minimum at which Newton's method ends.
        """
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
        return BodyConstraints(values, feasible.basis, found.objective, found.gap)

    def _smooth(self, feasible: Feasible, problem: Smooth, aim: float) -> SmoothSolution:
        """Minimum of a problem with log-det terms by Newton's method, started at the mean of the prior.

        If this search needs more than `SHORT` steps, mostly because no real body fits the data, a second search is
        started at the minimum of the program without the log-det terms. To compute this minimum takes as long as
        fifty Newton steps.
        """
        mean = feasible.unknowns(self.belief.inside(self.standard))
        with contextlib.suppress(EstimationError):
            return minimise(problem, mean, aim=aim, longest=SHORT)
        cost = np.array([term.weight * term.cost for term in problem.terms]).sum(axis=0)
        weight = min((term.weight for term in problem.terms), default=0.0)
        try:
            x = self._nearest(feasible, problem.A, problem.y, cost).x
            slope = problem.A.T @ (problem.A @ x - problem.y) + cost
            pull = feasible.basis @ (slope / np.sum(feasible.basis**2, axis=0))
            lifted = self.belief.lifted(self.standard, feasible.of(x), pull, weight)
            return minimise(problem, feasible.unknowns(lifted), aim=aim, near=True)
        except EstimationError:
            return minimise(problem, self._start(feasible), aim=aim)

    def _start(self, feasible: Feasible) -> Array:
        """Start point inside all cones: bodies of the prior with some friction, or the result of a conic program."""
        start = feasible.unknowns(self.belief.inside(self.standard))
        if all(cone.leaves(start) < 0.0 for cone in feasible.cones):
            return start
        found = interior_point(feasible)
        if found is None:
            raise self._contradiction()
        return found

    def _contradiction(self) -> ContradictionError:
        """Makes the error that names the contradicting requirements."""

        def empty(asked: Requirements) -> bool:
            try:
                feasible = feasible_set(self.standard, asked)
                return bool(feasible.cones) and interior_point(feasible) is None
            except EstimationError:
                return True

        together = "; ".join(conflicting(self.asked, empty))
        return ContradictionError(
            f"No body meets all requirements: {together or 'epsilon'} contradict each other or physical consistency.",
            remedy="remove or relax one of these requirements.",
        )

    def _cleared(self, values: Array) -> Array:
        """Sets nonnegative parameters to zero if rounding has made them slightly negative."""
        bounded = self.standard.nonnegative & (values < 0.0) & (values > -ACCEPTED)
        return np.where(bounded, 0.0, values)

    def _holds(self, values: Array, feasible: Feasible) -> bool:
        """True if, computed from the values, all bodies are physically consistent and all other constraints hold."""
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

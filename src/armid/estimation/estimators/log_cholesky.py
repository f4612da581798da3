"""Least squares with unknowns that always give consistent bodies: an independent check of the method `physical`.

The pseudo-inertia of each link is J = T Tᵀ with T upper triangular. The unknowns are the off-diagonal entries of T
and the logarithms of its diagonal [Rucker2022]; friction and rotor inertia are squares of unknowns. The problem then
has no constraints, but it is not convex, so the search has several starts. The objective is that of the convex
estimate `physical`, so the two minima can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, Finding
from armid.estimation.constrained_fit_statistics import PhysicalEstimate, fit_of
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import standard_per_recording
from armid.estimation.prior import LENGTH, MASS, Prior, make_prior
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.standard_parameter_resolution import PriorUse
from armid.estimation.whitened_system import WhitenedSystem, whiten
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.threads import one_blas_thread

RESOLUTION = 1e-5
"""Lower limit of the noise, divided by the torque, as in `physical`."""

TOLERANCE = 1e-7
"""Relative decrease of the objective over the last steps below which the search ends."""

PATIENCE = 10
"""Number of steps over which the decrease for `TOLERANCE` is summed, because a single step may be small although
the search has not ended."""

SMALLEST = 1e-7
"""Lower limit of the diagonal entries of a triangular factor T. Without this limit, the search would not end if a
body has no thickness."""

FARTHEST = 4.0
"""Upper limit of the norm of a step, whose entries are changes of logarithms and of the other unknowns."""

DAMPING = 1e-3
"""Initial damping of the Gauss-Newton steps, divided by the objective."""

SPREAD = 0.5
"""Standard deviation of the random changes of the logarithms with which the second and further searches start."""

UPPER = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))
"""Row and column of each entry of an upper triangular factor T, the diagonal first."""


PLAIN = np.diag([0.01, 0.01, 0.01, 1.0])
"""Pseudo-inertia of a body of a kilogram with radii of ten centimetres."""

SYMMETRIC = np.array(
    [[vector_from_pseudo_inertia(0.5 * (np.outer(a, b) + np.outer(b, a))) for b in np.eye(4)] for a in np.eye(4)]
).transpose(2, 0, 1)
"""Ten inertial parameters for a unit of each symmetrised entry (i, j) of a pseudo-inertia, shape (10, 4, 4)."""


@dataclass(frozen=True, slots=True)
class LogCholesky:
    """Least squares with triangular factors of the pseudo-inertias as unknowns.

    Attributes:
        prior: Kind of prior: `mass`, as in the estimator `physical`, or `none`.
        starts: Number of searches. The first search starts with the bodies of the description, or with a usual body
            if these are inconsistent; every other search starts with random changes of these bodies.
        seed: Seed of the random changes.
        evaluations: Largest number of evaluations of a search.
    """

    prior: Literal["mass", "none"] = "mass"
    starts: int = 2
    seed: int = 0
    evaluations: int = 1000
    name: ClassVar[str] = "log-cholesky"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.prior not in ("mass", "none"):
            raise EstimationError(
                f"The option `prior` must be mass or none; found {self.prior!r}.",
                possible="mass, none",
                remedy='use "mass", unless the data determine all parameters.',
            )
        for option in ("starts", "evaluations"):
            if not isinstance(getattr(self, option), int) or getattr(self, option) < 1:
                raise EstimationError(
                    f"The option `{option}` must be a positive number; found {getattr(self, option)!r}.",
                    remedy="leave the option out, so that the default is used.",
                )

    def with_one_start(self) -> LogCholesky:
        """Copy of this estimator with a single start, which saves time when estimators are compared."""
        return replace(self, starts=1)

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates standard and base parameters.

        Raises:
            EstimationError: No row is in use.
        """
        standard = standard_per_recording(problem.require_standard(self.name), problem.base, problem.information)
        weighted = whiten(problem.information, resolution=RESOLUTION)
        belief = make_prior(self.prior, standard, weighted)
        search = _Search(standard, weighted, belief, self.prior == "mass")
        rng = np.random.default_rng(self.seed)
        first = search.start()
        found: list[_End] = []
        for k in range(self.starts):
            start = search.moved(first, SPREAD * rng.standard_normal(search.unknowns)) if k else first
            found.append(_descend(search, start, self.evaluations))
        best = min(found, key=lambda each: each.cost)
        weight = 1.0 if self.prior == "mass" else 0.0
        prior = PriorUse(self.prior, weight, "that of one sample", weighted.correlation)
        values = search.values(best.point)
        costs = ", ".join(f"{each.cost:.8g}" for each in found)
        message = (
            f"{self.starts} searches ended with the objective values {costs}; the convex estimate minimises "
            "the same objective."
        )
        findings = [Finding("local-search", "info", "", message)]
        if not best.settled:
            message = (
                f"The search with the smallest objective did not converge within {self.evaluations} evaluations."
            )
            findings.append(
                Finding(
                    "not-converged", "warning", "", message, "allow more evaluations with the option `evaluations`."
                )
            )
        return fit_of(PhysicalEstimate(standard, weighted, belief, prior, values), findings)


@dataclass(frozen=True, eq=False, slots=True)
class _Point:
    """Values of the unknowns at a point of the search.

    Attributes:
        T: Triangular factors of the pseudo-inertias of the links, shape (links, 4, 4).
        others: The o parameters that are not inertial, shape (o,).
    """

    T: Array
    others: Array


@dataclass(frozen=True, eq=False, slots=True)
class _End:
    """End of a search.

    Attributes:
        point: Last point of the search.
        cost: Objective at this point.
        settled: True if the search has converged.
    """

    point: _Point
    cost: float
    settled: bool


def _descend(search: _Search, point: _Point, evaluations: int) -> _End:
    """Minimises the objective by damped Gauss-Newton steps [Marquardt1963] of at most the length `FARTHEST`.

    Args:
        search: Residuals as functions of the unknowns.
        point: Start point.
        evaluations: Largest number of evaluations.
    """
    residual = search.residual(point)
    cost, history = 0.5 * float(residual @ residual), [np.inf]
    damping = DAMPING * cost
    while evaluations > 0:
        J = search.jacobian(point)
        normal, gradient = J.T @ J, J.T @ residual
        while evaluations > 0:
            solved = np.linalg.solve(normal + damping * np.eye(len(gradient)), gradient)
            step = -np.asarray(solved, dtype=np.float64)
            if np.linalg.norm(step) <= FARTHEST:
                evaluations -= 1
                moved = search.moved(point, step)
                tried = search.residual(moved)
                lower = 0.5 * float(tried @ tried)
                if lower < cost:
                    point, residual, cost, damping = moved, tried, lower, 0.3 * damping
                    break
            damping *= 4.0
            if damping > 1e12 * cost:
                return _End(point, cost, True)
        history.append(cost)
        if len(history) > PATIENCE and history[-PATIENCE] - cost <= TOLERANCE * cost:
            return _End(point, cost, True)
    return _End(point, cost, False)


class _Search:
    """Residuals of data and prior as functions of the unknowns, and their derivatives.

    A step multiplies a factor T by an upper triangular matrix U. The unknowns of a step are the off-diagonal entries
    of U and the logarithms of the diagonal of U. These unknowns are zero at the start of each step, so the length of
    a step does not depend on bodies, frames and units.
    """

    def __init__(self, standard: StandardParameters, weighted: WhitenedSystem, belief: Prior, light: bool) -> None:
        self.standard = standard
        self.rows = weighted.rows @ standard.regrouping
        self.side = weighted.rows @ weighted.values
        self.where = np.setdiff1d(np.arange(len(standard.names)), standard.inertial)
        self.positive = standard.nonnegative[self.where]
        self.scale = 1.0 / np.sqrt(np.diag(belief.precision)[self.where])
        self.unknowns = 10 * len(standard.inertial) + len(self.where)
        self.root = np.sqrt(weighted.correlation) / self.scale if light else np.zeros(len(self.where))
        # ½ |row · T|² summed is the mass prior, which is linear in J = T Tᵀ.
        size = np.array([1.0 / LENGTH, 1.0 / LENGTH, 1.0 / LENGTH, 1.0])
        self.size = size * np.sqrt(2.0 * weighted.correlation / MASS) * (1.0 if light else 0.0)

    def start(self) -> _Point:
        """Point at which the first search starts: bodies of the description, or `PLAIN` if these are inconsistent."""
        factors: list[Array] = []
        for own in self.standard.inertial:
            J = PLAIN if self.standard.nominal is None else pseudo_inertia(self.standard.nominal[own])
            if np.linalg.eigvalsh(J)[0] <= SMALLEST:
                J = PLAIN
            factors.append(np.asarray(np.linalg.cholesky(J[::-1, ::-1])[::-1, ::-1], dtype=np.float64))
        return _Point(np.array(factors).reshape(-1, 4, 4), np.where(self.positive, 0.1 * self.scale, 0.0))

    def moved(self, point: _Point, step: Array) -> _Point:
        """Point of the search after a step from another point.

        Args:
            point: The point before the step.
            step: Changes of the unknowns: ten for each link, then one for each other parameter.
        """
        links = len(point.T)
        entries = step[: 10 * links].reshape(links, 10)
        U = np.zeros((links, 4, 4))
        for e, (i, j) in enumerate(UPPER):
            U[:, i, j] = np.exp(entries[:, e]) if i == j else entries[:, e]
        T = point.T @ U
        diagonal = np.arange(4)
        T[:, diagonal, diagonal] = np.maximum(T[:, diagonal, diagonal], SMALLEST)
        change = step[10 * links :]
        others = np.where(
            self.positive,
            np.maximum(point.others * np.exp(change), 1e-12 * self.scale),
            point.others + self.scale * change,
        )
        return _Point(T, others)

    def values(self, point: _Point) -> Array:
        """Standard parameters (p,) at a point."""
        result = np.zeros(len(self.standard.names))
        result[self.standard.inertial] = vector_from_pseudo_inertia(point.T @ np.swapaxes(point.T, 1, 2))
        result[self.where] = point.others
        return result

    def residual(self, point: _Point) -> Array:
        """Residuals of data and prior at a point; the objective is half of the sum of their squares."""
        small = self.size[:, None] * point.T
        return np.concatenate([self.rows @ self.values(point) - self.side, small.ravel(), self.root * point.others])

    def jacobian(self, point: _Point) -> Array:
        """Derivative of the residuals by the unknowns of a step that begins at a point."""
        T = point.T
        links = len(T)
        unknowns = 10 * links + len(self.where)
        i, j = np.array(UPPER).T
        change = np.zeros((len(self.standard.names), unknowns))
        small = np.zeros((links, 4, 4, unknowns))
        blocks = 2.0 * np.einsum("vab,gae,gbe->gve", SYMMETRIC, T[:, :, i], T[:, :, j])
        for k, own in enumerate(self.standard.inertial):
            change[own, 10 * k : 10 * k + 10] = blocks[k]
            small[k, :, j, 10 * k + np.arange(10)] = (self.size[:, None] * T[k, :, i].T).T
        slope = np.where(self.positive, point.others, self.scale)
        change[self.where, 10 * links + np.arange(len(slope))] = slope
        last = self.root[:, None] * change[self.where]
        return np.concatenate([self.rows @ change, small.reshape(16 * links, unknowns), last])

"""Estimate of physical parameters as in the thesis, equations (3.52) and (3.53) [Halper2024].

    minimise |ρ - W π(μ)|²  over μ = (m, r, I about the centre of mass, friction)  with bounds and inequalities

W and ρ are the stacked regressor and torque, and π(μ) the standard parameters that follow from the mass m, the centre
of mass r and the inertia I of each link. The inequalities (3.53) of the thesis are heuristic: they neither imply nor
follow from physical consistency. The result is therefore usually not physical; a finding reports this. The problem is
not convex, so IPOPT solves it from several starts, with exact first and second derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, MissingExtraError, did_you_mean
from armid.estimation.constrained_fit_statistics import PhysicalEstimate, fit_of
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import standard_per_recording
from armid.estimation.prior import make_prior
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.standard_parameter_resolution import PriorUse
from armid.estimation.whitened_system import WhitenedSystem, whiten
from armid.threads import one_blas_thread

CONSTRAINTS = ("3.52d", "3.53a", "3.53b", "3.53c", "3.53d", "3.53e", "3.53f")
"""Numbers of the equations of the thesis that are used as inequalities. Equation (3.52c) of the thesis, positive
masses, is not in the list, because it is the lower bound of the masses."""

RESOLUTION = 1e-5
"""Lower limit of the noise, divided by the torque, as in `physical`."""

LEAST_MOMENT = 1e-4
"""Smallest moment of inertia in equation (3.53d) of the thesis [kg·m²]."""

POSITIVE = 1e-12
"""Lower limit of the leading minors of an inertia tensor, so that it is positive definite as equation (3.52d) of the
thesis requires [kg·m², (kg·m²)² and (kg·m²)³]."""

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Feasible_Point_Found")


@dataclass(frozen=True, slots=True)
class ThesisNLP:
    """Estimator with the nonlinear program of the thesis.

    Attributes:
        constraints: Inequalities in use, by the numbers `3.52d` and `3.53a` to `3.53f` of the equations in the
            thesis.
        mass: Bounds of a mass [kg].
        com: Bound of the absolute value of a coordinate of a centre of mass [m].
        moment: Bounds of a moment of inertia about the centre of mass [kg·m²].
        product: Bound of the absolute value of a product of inertia [kg·m²].
        friction: Bound of the absolute value of a friction parameter.
        long: Two lists of numbers of links: links that are long along z, for equation (3.53e) of the thesis, and
            links that are long along y, for equation (3.53f).
        starts: Number of searches. The first search begins in the middle of the bounds, every other search at a
            random point.
        seed: Seed of the random points.
        iterations: Largest number of iterations of a search.
    """

    constraints: tuple[str, ...] = CONSTRAINTS
    mass: tuple[float, ...] = (0.05, 15.0)
    com: float = 0.5
    moment: tuple[float, ...] = (1e-4, 2.0)
    product: float = 1.0
    friction: float = 100.0
    long: tuple[Sequence[int], ...] = ((1, 3, 5), (2, 4))
    starts: int = 2
    seed: int = 0
    iterations: int = 1000
    name: ClassVar[str] = "thesis-nlp"
    quick: ClassVar[bool] = False
    excludes_bodies: ClassVar[bool] = True  # its inequalities refuse bodies that exist

    def __post_init__(self) -> None:
        unknown = [c for c in self.constraints if c not in CONSTRAINTS]
        if unknown:
            raise EstimationError(
                f"The option `constraints` contains the unknown constraint {unknown[0]!r}.",
                possible=", ".join(CONSTRAINTS),
                remedy=did_you_mean(unknown[0], CONSTRAINTS),
            )
        for option in ("mass", "moment"):
            bounds = getattr(self, option)
            if len(bounds) != 2 or not 0.0 < bounds[0] < bounds[1]:
                raise EstimationError(
                    f"The option `{option}` must be a lower and a larger upper bound; found {bounds!r}.",
                    remedy=f"give two numbers, for instance {option} = [0.05, 2.0].",
                )
        for option in ("com", "product", "friction", "starts", "iterations"):
            if not getattr(self, option) > 0:
                raise EstimationError(
                    f"The option `{option}` must be positive; found {getattr(self, option)!r}.",
                    remedy="give a number above 0, or leave the option out.",
                )
        if len(self.long) != 2:
            raise EstimationError(
                f"The option `long` must be two lists of link numbers; found {self.long!r}.",
                remedy="give two lists, for instance long = [[1, 3, 5], [2, 4]].",
            )
        object.__setattr__(self, "long", tuple(tuple(links) for links in self.long))

    def with_one_start(self) -> ThesisNLP:
        """Copy of this estimator with a single start, which saves time when estimators are compared."""
        return replace(self, starts=1)

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates physical, standard and base parameters; the rows of all joints have equal weight.

        Raises:
            MissingExtraError: casadi is not installed.
            EstimationError: No search ended at a point that meets the constraints.
        """
        standard = standard_per_recording(problem.require_standard(self.name), problem.base, problem.information)
        weighted = whiten(problem.information, plain=True, resolution=RESOLUTION)
        program = _Program(self, standard, weighted)
        rng = np.random.default_rng(self.seed)
        low, high = program.low, program.high
        ends = [program.solve(0.5 * (low + high) if k == 0 else rng.uniform(low, high)) for k in range(self.starts)]
        good = [each for each in ends if each[2] in SOLVED]
        if not good:
            raise EstimationError(
                f"IPOPT found no solution from {self.starts} starts ({', '.join(sorted({e[2] for e in ends}))}).",
                remedy="choose wider bounds (options `mass`, `com`, `moment`, `product`, `friction`), fewer "
                "`constraints` or more `starts`.",
            )
        values = min(good, key=lambda each: each[0])[1]
        costs = ", ".join(f"{each[0]:.8g}" if each[2] in SOLVED else each[2] for each in ends)
        findings = [
            Finding(
                "local-search",
                "info",
                "",
                f"{self.starts} searches from different start values ended with the objective values {costs}; the "
                "result with the smallest value is used. If the values differ, some searches ended in a local "
                "minimum.",
                "if the values differ, increase the option `starts`, and see whether a smaller value is found.",
            )
        ]
        belief = make_prior("none", standard, weighted)
        prior = PriorUse("none", 0.0, "bounds and inequalities only", weighted.correlation)
        return fit_of(PhysicalEstimate(standard, weighted, belief, prior, values), findings)


class _Program:
    """Nonlinear program of the thesis, which casadi builds once for all starts."""

    def __init__(self, options: ThesisNLP, standard: StandardParameters, weighted: WhitenedSystem) -> None:
        try:
            casadi: Any = import_module("casadi")
        except ModuleNotFoundError as error:
            raise MissingExtraError("casadi", "The method thesis-nlp", "nlp") from error
        self.standard, self.casadi = standard, casadi
        self.others = np.setdiff1d(np.arange(len(standard.names)), standard.inertial)
        self.low, self.high = _bounds(options, standard, self.others)
        unknowns = casadi.MX.sym("mu", len(self.low))
        values = self._standard(unknowns)
        # The scale by the torque makes the solver's tolerances relative.
        self.scale = 1.0 / max(float(np.sum((weighted.rows @ weighted.values) ** 2)), 1e-300)
        residual = casadi.mtimes(casadi.DM(weighted.rows @ standard.regrouping), values)
        residual = residual - casadi.DM(weighted.rows @ weighted.values)
        limits = self._inequalities(options, unknowns)
        cost = 0.5 * self.scale * casadi.dot(residual, residual)
        self.to_standard: Any = casadi.Function("standard", [unknowns], [values])
        settings = {
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": options.iterations, "tol": 1e-9},
            "print_time": False,
        }
        program = {"x": unknowns, "f": cost, "g": casadi.vertcat(*limits)}
        self.solver: Any = casadi.nlpsol("thesis", "ipopt", program, settings)
        self.limits = len(limits)

    def solve(self, start: Array) -> tuple[float, Array, str]:
        """Solves the program from one start; returns objective, standard parameters and the status of IPOPT."""
        found = self.solver(
            x0=start, lbx=self.low, ubx=self.high, lbg=np.zeros(self.limits), ubg=np.full(self.limits, np.inf)
        )
        values = np.array(self.to_standard(found["x"]), dtype=np.float64).ravel()
        return float(found["f"]) / self.scale, values, str(self.solver.stats()["return_status"])

    def _standard(self, unknowns: Any) -> Any:
        """Standard parameters as casadi expressions of the unknowns.

        The unknowns are mass, centre of mass and inertia about the centre of mass of each link, then all other
        parameters.
        """
        casadi = self.casadi
        result: list[Any] = [0.0] * len(self.standard.names)
        for k, own in enumerate(self.standard.inertial):
            m, x, y, z, xx, xy, yy, xz, yz, zz = (unknowns[10 * k + e] for e in range(10))
            values = (m, m * x, m * y, m * z)
            values += (xx + m * (y * y + z * z), xy - m * x * y, yy + m * (x * x + z * z))
            values += (xz - m * x * z, yz - m * y * z, zz + m * (x * x + y * y))
            for at, value in zip(own, values, strict=True):
                result[at] = value
        for e, at in enumerate(self.others):
            result[at] = unknowns[10 * len(self.standard.inertial) + e]
        return casadi.vertcat(*result)

    def _inequalities(self, options: ThesisNLP, unknowns: Any) -> list[Any]:
        """Expressions in the unknowns that must not be negative, for the constraints in use."""
        limits: list[Any] = []
        for k, own in enumerate(self.standard.inertial):
            link = self.standard.names[own[0]].number
            xx, xy, yy, xz, yz, zz = (unknowns[10 * k + e] for e in range(4, 10))
            axes, products = (xx, yy, zz), (xy, xz, yz)
            if "3.52d" in options.constraints:
                minor = xx * yy - xy * xy
                det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
                limits += [minor - POSITIVE, det - POSITIVE]
            if "3.53a" in options.constraints:
                limits += [xx + yy - zz, yy + zz - xx, zz + xx - yy]
            if "3.53b" in options.constraints:
                limits += [100.0 * a - b for a in axes for b in axes if a is not b]
            if "3.53c" in options.constraints:
                limits += [0.1 * a - sign * p for a in axes for p in products for sign in (1.0, -1.0)]
            if "3.53d" in options.constraints:
                limits += [a - LEAST_MOMENT for a in axes]
            if "3.53e" in options.constraints and link in options.long[0]:
                limits += [xx - 3.0 * zz, yy - 3.0 * zz]
            if "3.53f" in options.constraints and link in options.long[1]:
                limits += [xx - 3.0 * yy, zz - 3.0 * yy]
        return limits


def _bounds(options: ThesisNLP, standard: StandardParameters, others: NDArray[np.intp]) -> tuple[Array, Array]:
    """Lower and upper bounds of the unknowns, one array each."""
    (least, most), (small, large), far, cross = options.mass, options.moment, options.com, options.product
    low = [least, -far, -far, -far, small, -cross, small, -cross, -cross, small]
    high = [most, far, far, far, large, cross, large, cross, cross, large]
    links = len(standard.inertial)
    sign = np.where(standard.nonnegative[others], 0.0, -options.friction)
    return np.concatenate([np.tile(low, links), sign]), np.concatenate(
        [np.tile(high, links), np.full(len(others), options.friction)]
    )

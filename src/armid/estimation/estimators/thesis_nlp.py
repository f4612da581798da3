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
from armid.maths.inertia import vector_to_com_inertia
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

DESCRIPTION = "description"
"""Value of an option that stands for bounds around the bodies of the description."""

FACTOR, REACH = 3.0, 0.25
"""Largest ratio of a mass or moment to that of the description, and distance of a centre of mass from that of the
description [m]. The thesis calculates its bounds from earlier estimates but gives no sizes; these are wide enough for
the true bodies of simulated arms whose description is wrong by half."""

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Feasible_Point_Found")


@dataclass(frozen=True, slots=True)
class ThesisNLP:
    """Estimator with the nonlinear program of the thesis.

    Attributes:
        constraints: Inequalities in use, by the numbers `3.52d` and `3.53a` to `3.53f` of the equations in the
            thesis.
        mass: Bounds of a mass [kg]: two numbers, or two numbers for each link, or `description`, which stands for a
            third to three times the mass of the description.
        com: Bound of the absolute value of a coordinate of a centre of mass [m], or one bound for each link, or
            `description`, which stands for at most 0.25 m from the centre of mass of the description.
        moment: Bounds of a moment of inertia about the centre of mass [kg·m²], in the same forms as `mass`.
        product: Bound of the absolute value of a product of inertia [kg·m²], or one bound for each link, or
            `description`, which stands for three times the largest moment of the description.
        friction: Bound of the absolute value of a friction parameter, or one bound for each joint.
        long: Two lists of numbers of links: links that are long along z, for equation (3.53e) of the thesis, and
            links that are long along y, for equation (3.53f).
        starts: Number of searches. The first search begins in the middle of the bounds, every other search at a
            random point.
        seed: Seed of the random points.
        iterations: Largest number of iterations of a search.
    """

    constraints: tuple[str, ...] = CONSTRAINTS
    mass: Sequence[Any] | str = (0.05, 15.0)
    com: float | Sequence[float] | str = 0.5
    moment: Sequence[Any] | str = (1e-4, 2.0)
    product: float | Sequence[float] | str = 1.0
    friction: float | Sequence[float] = 100.0
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
            if bounds != DESCRIPTION and not _are_ranges(bounds):
                raise EstimationError(
                    f"The option `{option}` must be a lower and a larger upper bound; found {bounds!r}.",
                    remedy=f"give two numbers, for instance {option} = [0.05, 2.0], or two numbers for each link, or "
                    f'{option} = "{DESCRIPTION}".',
                )
        for option in ("com", "product", "friction", "starts", "iterations"):
            value = getattr(self, option)
            if value == DESCRIPTION and option in {"com", "product"}:
                continue
            if isinstance(value, str) or not np.size(value) or not bool(np.all(np.asarray(value) > 0)):
                raise EstimationError(
                    f"The option `{option}` must be positive; found {value!r}.",
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


def _are_ranges(bounds: object) -> bool:
    """Tests whether an option is a range of two positive numbers, or a list of such ranges."""
    try:
        ranges = np.atleast_2d(np.asarray(bounds, dtype=np.float64))
    except (TypeError, ValueError):
        return False
    return (
        ranges.ndim == 2
        and ranges.shape[1] == 2
        and bool(((ranges[:, 0] > 0.0) & (np.diff(ranges)[:, 0] > 0.0)).all())
    )


def _bounds(options: ThesisNLP, standard: StandardParameters, others: NDArray[np.intp]) -> tuple[Array, Array]:
    """Lower and upper bounds of the unknowns, one array each."""
    links = len(standard.inertial)
    low, high = np.zeros((links, 10)), np.zeros((links, 10))
    kinds = {"mass": MASS, "com": CENTRE, "moment": MOMENTS, "product": PRODUCTS}
    for option, columns in kinds.items():
        given = getattr(options, option)
        if given == DESCRIPTION:
            least, most = _around(_described(standard), option)
        elif option in {"mass", "moment"}:
            least, most = _each(option, np.atleast_2d(np.asarray(given)), links).T[..., None]
        else:
            most = _each(option, np.atleast_1d(np.asarray(given))[:, None], links)
            least = -most
        low[:, columns], high[:, columns] = least, most
    numbers = np.array([standard.names[k].number for k in others], dtype=np.intp)
    bound = np.asarray(options.friction, dtype=np.float64)
    if bound.ndim:
        bound = _each("friction", bound[:, None], int(numbers.max(initial=0)))[numbers - 1, 0]
    bound = np.broadcast_to(bound, len(others))
    floor = np.where(standard.nonnegative[others], 0.0, -bound)
    return np.concatenate([low.ravel(), floor]), np.concatenate([high.ravel(), bound])


MASS, CENTRE, MOMENTS, PRODUCTS = [0], [1, 2, 3], [4, 6, 9], [5, 7, 8]
"""Positions of a link's ten unknowns: mass, centre of mass, and moments and products of inertia about the centre of
mass."""


def _each(option: str, values: Array, count: int) -> Array:
    """Values of an option (count, k) for each link or joint, from one row or from `count` rows.

    Raises:
        EstimationError: The number of rows is neither one nor `count`.
    """
    if len(values) not in {1, count}:
        raise EstimationError(
            f"The option `{option}` has {len(values)} entries, but the arm has {count} links or joints.",
            remedy="give one entry for all, or one for each.",
        )
    return np.broadcast_to(values, (count, values.shape[1]))


def _described(standard: StandardParameters) -> Array:
    """Bodies of the description, shape (links, 10): mass, centre of mass, and inertia about the centre of mass.

    Raises:
        EstimationError: The description does not give every link a mass.
    """
    if standard.nominal is None or not standard.described:
        raise EstimationError(
            f'Bounds "{DESCRIPTION}" need a description that gives every link a mass.',
            remedy="give bounds as numbers, or add the masses to the description.",
        )
    rows: list[list[float]] = []
    for own in standard.inertial:
        mass, com, tensor = vector_to_com_inertia(standard.nominal[own])
        upper = [tensor[0, 0], tensor[0, 1], tensor[1, 1], tensor[0, 2], tensor[1, 2], tensor[2, 2]]
        rows.append([mass, *com, *upper])
    return np.array(rows)


def _around(bodies: Array, option: str) -> tuple[Array, Array]:
    """Lower and upper bounds for an option with the value `description`, around the bodies of the description.

    Args:
        bodies: Mass, centre of mass, and inertia about the centre of mass of each link, shape (links, 10).
        option: Name of the option: `mass`, `com`, `moment` or `product`.
    """
    if option == "com":
        return bodies[:, CENTRE] - REACH, bodies[:, CENTRE] + REACH
    moments = np.maximum(bodies[:, MOMENTS], LEAST_MOMENT)
    if option == "product":
        most = FACTOR * moments.max(axis=1, keepdims=True)
        return -most, most
    middle = bodies[:, MASS] if option == "mass" else moments
    return middle / FACTOR, middle * FACTOR

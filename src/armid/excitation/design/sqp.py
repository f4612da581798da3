"""Local optimisation of a series by sequential quadratic programming (SQP), in stages of decreasing smoothness.

Criterion and limits are not smooth, so each stage smooths them: signs in friction laws become tanh, extreme
eigenvalues and maxima along a constraint channel become soft maxima. From stage to stage the tanh becomes narrower
and the maxima become sharper. SLSQP, a sequential quadratic method with exact gradients, solves each stage. The
result is then scaled about its start pose until every limit holds on a grid. Therefore the result keeps the limits
even if the solver stops early.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from armid.checked_array import Array
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.limits.constraint_channels import ConstraintChannel, States, soft_maximum
from armid.excitation.rest_to_rest_basis import SeriesBasis

CHECKED = 80.0
"""Number of points, per period of the highest harmonic, of the grid on which plans are compared. The maximum of a
quantity on this grid is smaller than its true maximum by less than a thousandth."""

FEASIBLE = 1.0 + 1e-9
"""Largest utilisation at which a limit counts as kept; the excess over 1 allows for rounding errors."""

DIVERGED = 2.0
"""Utilisation of a limit at and above which a stage of the descent counts as diverged. If bodies overlap deeply,
further steps increase the overlap."""

HALVINGS, FURTHER = 14, 11
"""Number of bisections that determine the factor by which amplitudes are reduced, with an error of 6e-5; and number
of additional bisections with all points of the grid, if the first ones used only a part of the points."""

SPARSE = 8
"""Stride of the grid points that are tested first if distances of bodies are limited."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Stage of a descent: its smoothing and its number of iterations.

    Attributes:
        density: Number of grid points per period of the highest harmonic.
        width: Width of the tanh that replaces signs, divided by `scale` of the problem.
        sharpness: Exponent p of the p-norms that replace extreme eigenvalues.
        limit_sharpness: Exponent p of the soft maxima of the constraint channels.
        iterations: Largest number of iterations.
    """

    density: float
    width: float
    sharpness: float
    limit_sharpness: float
    iterations: int


STAGES = (
    Stage(12.8, 0.2, 4.0, 40.0, 100),
    Stage(12.8, 0.1, 16.0, 100.0, 300),
    Stage(20.0, 0.05, 60.0, 300.0, 300),
    Stage(20.0, 0.02, 200.0, 1000.0, 300),
    Stage(20.0, 0.02, 200.0, 3000.0, 60),
    Stage(20.0, 0.02, 200.0, 3000.0, 40),
)
"""Stages of a descent, in order of decreasing smoothness. If two stages with other widths of the tanh are added or
left out, the final criterion changes only by a few percent of its spread over random starting points."""


@dataclass(frozen=True, eq=False)
class DescentProblem:
    """Optimisation problem of an excitation: criterion, unknowns and limits.

    Attributes:
        goal: Criterion of the motion.
        basis: Basis of the series; its coordinates are the unknowns.
        channels: Constraint channels of the limits.
        scale: Velocity [rad/s or m/s] by which the widths of the smoothed signs are multiplied.
    """

    goal: CriterionGoal
    basis: SeriesBasis
    channels: tuple[ConstraintChannel, ...]
    scale: float = 1.0

    def objective(self, stage: Stage) -> Objective:
        """Criterion of the problem with the smoothing of a stage of the descent."""
        samples = max(64, round(stage.density * self.basis.harmonics))
        return Objective(self.goal, self.basis, samples, width=stage.width * self.scale, sharpness=stage.sharpness)

    def near(self, states: States) -> list[ConstraintChannel]:
        """Constraint channels for motions near a given one; of many pairs of bodies, only those that come close."""
        return [channel.near(states) if isinstance(channel, Clearance) else channel for channel in self.channels]

    @cached_property
    def fine(self) -> Objective:
        """Grid on which plans are compared and scaled to keep the limits."""
        return self.grid(max(200, round(CHECKED * self.basis.harmonics)))

    def grid(self, samples: int) -> Objective:
        """Uniform grid of one period with a number of points, with laws that are not smoothed."""
        return Objective(self.goal, self.basis, samples)


class _DeadlineError(Exception):
    """Exception that ends a descent at its deadline."""


@dataclass(frozen=True, eq=False, slots=True)
class _Point:
    """Criterion, limits and their gradients at one point in the space of the unknowns.

    Attributes:
        x: Unknowns, shape (n k,).
        criterion: Criterion and its gradient (n k,).
        utilisations: For each channel, soft maxima of the utilisations of its limits, shape (m,).
        slopes: For each channel, gradients of these maxima, shape (m, n k).
    """

    x: Array
    criterion: tuple[float, Array]
    utilisations: list[Array]
    slopes: list[Array]


class _Evaluation:
    """Criterion, limits and gradients in a stage of a descent, computed once for each point that SLSQP tries."""

    def __init__(self, problem: DescentProblem, stage: Stage, x: Array, deadline: float) -> None:
        self._objective = problem.objective(stage)
        self._sharpness = stage.limit_sharpness
        self._deadline = deadline
        self.last: _Point | None = None
        states, between = States(self._objective, x), States(problem.fine, x)
        self._channels = problem.near(between)
        # Excess of the soft maximum on the stage's grid over the maximum on the fine grid.
        self._excess = [
            soft_maximum(channel.values(states), self._sharpness)[0] - channel.values(between).max(axis=0)
            for channel in self._channels
        ]

    def objective(self, x: Array) -> tuple[float, Array]:
        """Criterion and its gradient at the unknowns x, shape (n k,)."""
        if time.time() > self._deadline:
            raise _DeadlineError
        return self._at(x).criterion

    def limits(self, x: Array) -> Array:
        """Margins to all limits at the unknowns x, shape (n k,): one minus the utilisation of each limit."""
        return 1.0 - np.concatenate(self._at(x).utilisations)

    def limit_slopes(self, x: Array) -> Array:
        """Gradients by the unknowns x of the margins to all limits, one in each row."""
        return -np.concatenate(self._at(x).slopes)

    def _at(self, x: Array) -> _Point:
        """Criterion, limits and gradients at x, shape (n k,); the results for the last point are stored."""
        if self.last is None or x.tobytes() != self.last.x.tobytes():
            x = x.copy()
            criterion = self._objective(x)
            states = States(self._objective, x, filled=True)
            utilisations, slopes = [], []
            for channel, excess in zip(self._channels, self._excess, strict=True):
                soft, weights = soft_maximum(channel.values(states), self._sharpness)
                utilisations.append(soft - excess)
                slopes.append(channel.pullback(states, weights))
            self.last = _Point(x, criterion, utilisations, slopes)
        return self.last


def descend(problem: DescentProblem, x: Array, stages: tuple[Stage, ...], deadline: float = np.inf) -> Array:
    """Runs the stages of a descent in order; each stage begins with the result of the stage before.

    Args:
        problem: Criterion, unknowns and limits.
        x: Starting point, shape (n k,).
        stages: Stages from smooth to sharp.
        deadline: Time on the clock of `time.time` [s], which is the same in every process. At this time the descent
            ends, and the point reached by then is returned.

    Returns:
        Unknowns, shape (n k,).
    """
    for stage in stages:
        if time.time() > deadline:
            break
        evaluation = _Evaluation(problem, stage, x, deadline)
        constraints = (
            [{"type": "ineq", "fun": evaluation.limits, "jac": evaluation.limit_slopes}] if problem.channels else []
        )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # SLSQP warns of each clipped step
                result = minimize(
                    evaluation.objective,
                    x,
                    jac=True,
                    method="SLSQP",
                    constraints=constraints,
                    options={"maxiter": stage.iterations, "ftol": 1e-7},
                )
        except _DeadlineError:
            reached = x if evaluation.last is None else evaluation.last.x
            x = _safeguarded(problem, reached, x)
            break
        x = _safeguarded(problem, result.x, x)
    return x


def _safeguarded(problem: DescentProblem, reached: Array, before: Array) -> Array:
    """Result of a stage of the descent if the stage has not diverged.

    Otherwise the result is scaled so that it keeps the limits; if that fails or is worse, the starting point is
    returned.
    """
    if not np.isfinite(reached).all():
        return before
    if max_utilisation(problem, problem.fine, reached) < DIVERGED:
        return reached
    inside = shrink_to_feasible(problem, problem.fine, reached)
    if inside is None or problem.fine.value(inside) > problem.fine.value(before):
        return before
    return inside


def utilisation(problem: DescentProblem, grid: Objective, x: Array) -> list[Array]:
    """Utilisations of all limits at the N points of a grid: values divided by their limits.

    There is one array (N, m) for each channel (kind of limit), where m is its number of limited quantities.
    """
    states = States(grid, np.asarray(x), rough=True)
    return [channel.values(states) for channel in problem.channels]


def max_utilisation(problem: DescentProblem, grid: Objective, x: Array) -> float:
    """Largest utilisation of any limit at any point of a grid, for the series with unknowns x, shape (n k,)."""
    return max((float(u.max()) for u in utilisation(problem, grid, x)), default=0.0)


def _inside(problem: DescentProblem, grid: Objective, x: Array, limit: float) -> bool:
    """Checks whether every limit is kept on a grid; collisions are checked last, because this takes longest."""
    states = States(grid, np.asarray(x), rough=True)
    return all(float(channel.values(states).max()) <= limit for channel in problem.channels)


def shrink_to_feasible(problem: DescentProblem, grid: Objective, x: Array, limit: float = FEASIBLE) -> Array | None:
    """Scales a series about its start pose by the largest factor, at most 1, that keeps every limit on a grid.

    Distances of bodies take long to compute. If they are limited, the points of the grid with the stride `SPARSE` are
    tested first.

    Args:
        problem: Optimisation problem with the limits.
        grid: Points at which the limits are evaluated.
        x: Unknowns of the series, shape (n k,).
        limit: Largest utilisation that counts as kept.

    Returns:
        Unknowns (n k,), or `None` if the start pose itself violates a limit.
    """
    slow = any(isinstance(channel, Clearance) for channel in problem.channels)
    times = grid.times[::SPARSE]
    sparse = Objective(problem.goal, problem.basis, len(times), times=times) if slow else grid

    def keeps(points: Objective, factor: float) -> bool:
        scaled = x if factor == 1.0 else about_start(problem.basis, x, factor)
        return _inside(problem, points, scaled, limit)

    def largest(points: Objective, high: float, halvings: int) -> float:
        low = 0.0
        for _ in range(halvings):
            # Limits are usually exceeded by little, so the first factor is close to the highest.
            middle = 0.5 * (low + high) if low or high < highest else 0.99 * high
            low, high = (middle, high) if keeps(points, middle) else (low, middle)
        return low

    highest = 1.0
    if not keeps(sparse, 1.0):
        if not keeps(sparse, 0.0):
            return None
        highest = largest(sparse, 1.0, HALVINGS)
    if slow and not keeps(grid, highest):
        highest = largest(grid, highest, FURTHER)
    return x if highest == 1.0 else about_start(problem.basis, x, highest)


def about_start(basis: SeriesBasis, x: Array, factor: float | Array) -> Array:
    """Unknowns (n k,) of a series whose amplitudes are scaled and whose start pose is kept.

    Args:
        basis: Basis of the series.
        x: Unknowns, shape (n k,).
        factor: Factor of all amplitudes, or one for each joint, shape (n,).
    """
    c, L = basis.coefficients(x), basis.harmonics
    begin = c[:, -1] - c[:, L : 2 * L] @ (1.0 / (basis.base_frequency * np.arange(1, L + 1)))
    factors = np.broadcast_to(factor, basis.n)
    scaled = factors[:, None] * c
    scaled[:, -1] = begin + factors * (c[:, -1] - begin)
    return basis.project(scaled)


def from_pose(basis: SeriesBasis, x: Array) -> Array:
    """Unknowns (n k,) of the motion with unknowns x, shifted so that it begins in the start pose of the basis."""
    c, L = basis.coefficients(x), basis.harmonics
    c[:, -1] = basis.start + c[:, L : 2 * L] @ (1.0 / (basis.base_frequency * np.arange(1, L + 1)))
    return basis.project(c)

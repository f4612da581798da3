"""One descent: from a point of the unknowns to a better one inside the limits, stage by stage.

Non-smooth things are handled on purpose. Signs in friction laws are tanh whose width shrinks, extremes of eigenvalues
and highest values along a channel are soft maxima whose sharpness grows, from stage to stage; SLSQP, a sequential
quadratic method with exact gradients, runs in each. What comes out is drawn together about its start pose as far as
it takes to be inside every limit on a grid, so that feasibility never rests on where a solver happened to stop.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.limits.constraints import ConstraintChannel, States, soft_maximum
from armid.excitation.series_basis import SeriesBasis
from armid.values import Array

__all__ = [
    "STAGES",
    "DescentProblem",
    "Stage",
    "about_start",
    "descend",
    "from_pose",
    "max_utilisation",
    "shrink_to_feasible",
    "utilisation",
]

CHECKED = 80.0
"""Points of the grid on which candidates are compared, per period of the highest harmonic: a peak between two of them
is missed by less than a thousandth."""

FEASIBLE = 1.0 + 1e-9
"""Share of a limit that still counts as inside: rounding."""

RUN_AWAY = 2.0
"""Share of a limit beyond which a stage counts as lost: steps far outside lead further out, where bodies overlap."""

HALVINGS = 14
"""Of the interval in which the largest feasible amplitude is looked for: 6e-5 of it."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Smoothness of everything, and its duration.

    Attributes:
        density: Points of the grid per period of the highest harmonic.
        width: Of the tanh in the place of signs, over the width of the last stage's.
        sharpness: p of norms of eigenvalues.
        limit_sharpness: p of soft maxima of channels.
        iterations: At most.
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
"""From smooth to sharp. Two widths less or more change the result by a few percent of a random start's spread."""


@dataclass(frozen=True, eq=False)
class DescentProblem:
    """Message to a search.

    Attributes:
        goal: What the motion is for.
        basis: The unknowns.
        channels: What must not be exceeded.
        scale: Speed [rad/s or m/s] that widths of signs are shares of.
    """

    goal: CriterionGoal
    basis: SeriesBasis
    channels: tuple[ConstraintChannel, ...]
    scale: float = 1.0

    def objective(self, stage: Stage) -> Objective:
        """The criterion as a stage sees it."""
        samples = max(64, round(stage.density * self.basis.harmonics))
        return Objective(self.goal, self.basis, samples, width=stage.width * self.scale, sharpness=stage.sharpness)

    def near(self, states: States) -> list[ConstraintChannel]:
        """Return what motions like the one at hand must not exceed; of many pairs of bodies, those that come near."""
        return [channel.near(states) if isinstance(channel, Clearance) else channel for channel in self.channels]

    @cached_property
    def fine(self) -> Objective:
        """The grid on which plans are compared and drawn together."""
        return self.grid(max(200, round(CHECKED * self.basis.harmonics)))

    def grid(self, samples: int) -> Objective:
        """A grid on which limits are looked at."""
        return Objective(self.goal, self.basis, samples)


class _Late(Exception):  # noqa: N818  (no error: the time is up)
    """The time is up."""


class _Evaluation:
    """Value, limits and their gradients of a stage; SLSQP asks for them one after the other at the same point."""

    def __init__(self, problem: DescentProblem, stage: Stage, x: Array, deadline: float) -> None:
        self._objective = problem.objective(stage)
        self._sharpness = stage.limit_sharpness
        self._deadline = deadline
        self._point = b""
        self._values: list[Array] = []
        self._slopes: list[Array] = []
        self.x = x.copy()
        states, between = States(self._objective, x), States(problem.fine, x)
        self._channels = problem.near(between)
        # What the soft maximum lies above the highest, which is sought between the points of the grid, too.
        self._excess = [
            soft_maximum(channel.values(states), self._sharpness)[0] - channel.values(between).max(axis=0)
            for channel in self._channels
        ]

    def objective(self, x: Array) -> tuple[float, Array]:
        """The criterion and its gradient."""
        if time.time() > self._deadline:
            raise _Late
        self._look(x)
        return self._value, self._gradient

    def limits(self, x: Array) -> Array:
        """Room that each limit leaves."""
        self._look(x)
        return 1.0 - np.concatenate(self._values)

    def limit_slopes(self, x: Array) -> Array:
        """Gradients of the room."""
        self._look(x)
        return -np.concatenate(self._slopes)

    def _look(self, x: Array) -> None:
        """Compute everything at x, unless that is where it was computed last."""
        point = x.tobytes()
        if point == self._point:
            return
        self.x = x.copy()
        self._value, self._gradient = self._objective(x)
        states = States(self._objective, self.x, filled=True)
        self._values, self._slopes = [], []
        for channel, excess in zip(self._channels, self._excess, strict=True):
            soft, weights = soft_maximum(channel.values(states), self._sharpness)
            self._values.append(soft - excess)
            self._slopes.append(channel.pull(states, weights))
        self._point = point


def descend(problem: DescentProblem, x: Array, stages: tuple[Stage, ...], deadline: float = np.inf) -> Array:
    """Run stages one after the other, each from where the one before has stopped.

    Args:
        problem: What is asked.
        x: Where to begin, shape (n k,).
        stages: From smooth to sharp.
        deadline: Of `time.time` [s], which means the same in every process; what is reached by then is returned.
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
                warnings.simplefilter("ignore", RuntimeWarning)  # steps that are clipped
                result = minimize(
                    evaluation.objective,
                    x,
                    jac=True,
                    method="SLSQP",
                    constraints=constraints,
                    options={"maxiter": stage.iterations, "ftol": 1e-7},
                )
        except _Late:
            x = _sane(problem, evaluation.x, x)
            break
        x = _sane(problem, result.x, x)
    return x


def _sane(problem: DescentProblem, reached: Array, before: Array) -> Array:
    """Return what a stage has reached, unless it has run away: then that drawn together, or where the stage began."""
    if not np.isfinite(reached).all():
        return before
    if max_utilisation(problem, problem.fine, reached) < RUN_AWAY:
        return reached
    inside = shrink_to_feasible(problem, problem.fine, reached)
    if inside is None or problem.fine.value(inside) > problem.fine.value(before):
        return before
    return inside


def utilisation(problem: DescentProblem, grid: Objective, x: Array) -> list[Array]:
    """Shares of the limits along a grid, channel by channel, (N, m) each."""
    states = States(grid, np.asarray(x))
    return [channel.values(states) for channel in problem.channels]


def max_utilisation(problem: DescentProblem, grid: Objective, x: Array) -> float:
    """Largest share of any limit along a grid."""
    return max((float(u.max()) for u in utilisation(problem, grid, x)), default=0.0)


def _inside(problem: DescentProblem, grid: Objective, x: Array, limit: float) -> bool:
    """Tell whether every limit is kept along a grid; bodies, which take longest, are looked at last."""
    states = States(grid, np.asarray(x))
    return all(float(channel.values(states).max()) <= limit for channel in problem.channels)


def shrink_to_feasible(problem: DescentProblem, grid: Objective, x: Array, limit: float = FEASIBLE) -> Array | None:
    """The largest multiple, at most one, of a series about its start pose that keeps every limit on a grid.

    Returns:
        The unknowns, or `None` where not even standing still at the start pose keeps the limits.
    """
    if _inside(problem, grid, x, limit):
        return x
    low, high = 0.0, 1.0
    if not _inside(problem, grid, about_start(problem.basis, x, 0.0), limit):
        return None
    for _ in range(HALVINGS):
        # Limits are usually missed by little; then the first guess is near.
        middle = 0.5 * (low + high) if low or high < 1.0 else 0.99
        inside = _inside(problem, grid, about_start(problem.basis, x, middle), limit)
        low, high = (middle, high) if inside else (low, middle)
    return about_start(problem.basis, x, low)


def about_start(basis: SeriesBasis, x: Array, factor: float) -> Array:
    """The series with its amplitudes multiplied, its start pose kept."""
    c, L = basis.coefficients(x), basis.harmonics
    begin = c[:, -1] - c[:, L : 2 * L] @ (1.0 / (basis.base_frequency * np.arange(1, L + 1)))
    scaled = factor * c
    scaled[:, -1] = begin + factor * (c[:, -1] - begin)
    return basis.project(scaled)


def from_pose(basis: SeriesBasis, x: Array) -> Array:
    """The same motion moved to where it begins in the pose of its basis."""
    c, L = basis.coefficients(x), basis.harmonics
    c[:, -1] = basis.start + c[:, L : 2 * L] @ (1.0 / (basis.base_frequency * np.arange(1, L + 1)))
    return basis.project(c)

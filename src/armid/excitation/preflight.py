"""Knowledge of a plan before the arm moves: margins, closest approaches, deviations that it will give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.excitation.certification import Margin, fine_grid, margins
from armid.excitation.collision.closest_approach import RATE, ClosestApproach, closest_approaches
from armid.excitation.collision.collision_model import CollisionOptions, IgnoredPair
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.design.sensitivity import Columns
from armid.excitation.design.sqp import DescentProblem
from armid.robot.kinematics import forward_kinematics
from armid.values import Array

__all__ = ["Expectation", "Preflight", "expectation", "preflight", "worst"]

Verdict = Literal["pass", "fail", "not checked"]

SAID = 3
"""Limits and pairs that are named in a sentence."""


@dataclass(frozen=True, eq=False, slots=True)
class Expectation:
    """Expected knowledge of the parameters, if the model holds and the noise is white.

    Attributes:
        names: Base parameters.
        units: Their units.
        deviation: Standard deviations, shape (b,).
        torque: Deviation of each joint's predicted torque, root mean square over the plan, shape (n,) [N·m or N].
        condition: Condition number of the stacked regressor of one repetition, as in (3.55a).
        log_det: Logarithm of the determinant of the information.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    deviation: Array
    torque: Array
    condition: float
    log_det: float


@dataclass(frozen=True, eq=False, slots=True)
class Preflight:
    """The report before the flight.

    Attributes:
        margins: Every limit, joint by joint.
        approaches: Every pair of bodies, nearest first.
        skipped: Pairs that touch by construction and are not looked at.
        expected: Deviations.
        unchecked: Why collisions are not checked; empty where they are.
    """

    margins: tuple[Margin, ...]
    approaches: tuple[ClosestApproach, ...]
    skipped: tuple[IgnoredPair, ...]
    expected: Expectation
    unchecked: str = ""

    @property
    def verdict(self) -> Verdict:
        """`fail` where a limit is missed or bodies come too close, `not checked` where nobody looked at bodies."""
        if self._missed or self._close:
            return "fail"
        return "not checked" if self.unchecked else "pass"

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        said = [f"{each.limit} of {each.label} is missed: {each.value:.4g} {each.unit}" for each in self._missed]
        said += [
            f"{each.pair} come within {1000.0 * each.distance:.0f} mm at {each.time:.2f} s, less than the "
            f"{1000.0 * each.asked:.0f} mm that they should keep"
            for each in self._close
        ]
        if said:
            more = f"; {len(said) - SAID} more" if len(said) > SAID else ""
            return "; ".join(said[:SAID]) + more
        if self.unchecked:
            return f"every limit holds; collisions not checked: {self.unchecked}"
        return "every limit holds, and bodies keep apart"

    @property
    def _missed(self) -> list[Margin]:
        return [margin for margin in self.margins if margin.certified > 1.0]

    @property
    def _close(self) -> list[ClosestApproach]:
        return [each for each in self.approaches if not each.kept]


def expectation(goal: CriterionGoal, objective: Objective, x: Array) -> Expectation:
    """Deviations that a plan will give with the noise and repetitions of a goal.

    Args:
        goal: Noise, repetitions, what is known already.
        objective: A grid with the laws as they are.
        x: The plan.
    """
    G = objective.information(x)
    covariance = np.linalg.inv(G)
    columns: Columns = objective.columns
    torque: list[float] = []
    plain = np.zeros_like(G)
    samples = len(objective.times)
    for j in range(goal.model.n):
        own = columns.information(np.eye(goal.model.n)[j]) / samples
        plain += own
        torque.append(math.sqrt(max(float((own * covariance).sum()), 0.0)))
    values = np.linalg.eigvalsh(plain)
    return Expectation(
        goal.base.names,
        goal.base.units,
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        np.array(torque),
        float(np.sqrt(values[-1] / max(values[0], np.finfo(float).tiny))),
        float(np.linalg.slogdet(G)[1]),
    )


def preflight(
    problem: DescentProblem,
    x: Array,
    collision: CollisionOptions | None,
    limits: tuple[Margin, ...] | None = None,
    unchecked: str = "",
) -> Preflight:
    """Everything that can be said of a plan; limits on the fine grid, bodies by Coal.

    Args:
        problem: What was asked.
        x: The plan.
        collision: Bodies that are kept apart.
        limits: How near it comes to every limit, where that is known already.
        unchecked: Why collisions are not checked, where they are not.
    """
    goal, basis = problem.goal, problem.basis
    samples = max(round(goal.rate * basis.period), 40 * basis.harmonics)
    approaches: tuple[ClosestApproach, ...] = ()
    if collision is not None:
        times = basis.times(max(100, round(RATE * basis.period)))
        q = basis.excitation(x).at(times).q
        approaches = closest_approaches(collision, times, forward_kinematics(goal.model.robot, q))
    return Preflight(
        margins(problem, fine_grid(problem), x) if limits is None else limits,
        approaches,
        () if collision is None else collision.skipped,
        expectation(goal, Objective(goal, basis, samples), x),
        unchecked,
    )


def worst(found: Sequence[Margin]) -> tuple[Margin, ...]:
    """The nearest to each limit."""
    names = dict.fromkeys(margin.limit for margin in found)
    return tuple(max((m for m in found if m.limit == name), key=lambda m: m.share) for name in names)

"""What is known of a plan before the arm moves: margins, closest approaches, deviations that it will give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.excitation import coal
from armid.excitation.collision import Collision, LeftOut
from armid.excitation.finish import Margin, fine_grid, margins
from armid.excitation.objective import Goal, Objective
from armid.excitation.sensitivity import Columns
from armid.excitation.solver import Problem
from armid.robot.kinematics import forward_kinematics
from armid.values import Array

__all__ = ["Approach", "Expectation", "Preflight", "expectation", "preflight", "worst"]

MEASURED = 50.0
"""Poses a second in which bodies are measured as they are [Hz]; the certificate does not rest on these."""


EVERY = 5
"""Of these poses one in so many is looked at first."""


@dataclass(frozen=True, slots=True)
class Approach:
    """Closest approach of two bodies.

    Attributes:
        pair: Their names.
        distance: Between the bodies as they are [m].
        time: When [s].
    """

    pair: str
    distance: float
    time: float


@dataclass(frozen=True, eq=False, slots=True)
class Expectation:
    """How well the parameters will be known, if the model holds and the noise is white.

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
    """

    margins: tuple[Margin, ...]
    approaches: tuple[Approach, ...]
    skipped: tuple[LeftOut, ...]
    expected: Expectation


def expectation(goal: Goal, objective: Objective, x: Array) -> Expectation:
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
    problem: Problem, x: Array, collision: Collision | None, limits: tuple[Margin, ...] | None = None
) -> Preflight:
    """Everything that can be said of a plan; limits on the fine grid, bodies as they are by Coal.

    Args:
        problem: What was asked.
        x: The plan.
        collision: Bodies that are kept apart.
        limits: How near it comes to every limit, where that is known already.
    """
    goal, basis = problem.goal, problem.basis
    samples = max(round(goal.rate * basis.period), 40 * basis.harmonics)
    approaches: list[Approach] = []
    if collision is not None and len(collision.pairs):
        times = basis.times(max(100, round(MEASURED * basis.period)))
        q = basis.excitation(x).at(times).q
        approaches = _closest(collision, times, forward_kinematics(goal.model.robot, q))
    return Preflight(
        margins(problem, fine_grid(problem), x) if limits is None else limits,
        tuple(sorted(approaches, key=lambda each: each.distance)),
        () if collision is None else collision.skipped,
        expectation(goal, Objective(goal, basis, samples), x),
    )


def _closest(collision: Collision, times: Array, poses: tuple[Array, Array]) -> list[Approach]:
    """Closest approach of each pair of bodies as they are, at times (N,) [s] with poses of the links.

    A body is in its capsules, so where these are further apart than the bodies are at their closest so far nobody
    needs to look. Every fifth pose is looked at first, then those beside the closest: two meshes take a millisecond.
    """
    bound = collision.every.bodies.distances(poses)
    measure = coal.between(collision.shapes)
    found: list[Approach] = []
    for k, (label, (a, b)) in enumerate(zip(collision.every.labels, collision.pairs, strict=True)):
        distance, at = math.inf, 0
        coarse = np.arange(0, len(times), EVERY)
        for beside in (False, True):
            near = np.clip(np.arange(at - EVERY + 1, at + EVERY), 0, len(times) - 1) if beside else coarse
            for i in near[bound[near, k].argsort(kind="stable")]:
                if bound[i, k] >= distance:
                    break
                here = measure(int(a), int(b), (poses[0][i], poses[1][i]))[0]
                distance, at = min((distance, at), (here, int(i)))
        found.append(Approach(label, distance, float(times[at])))
    return found


def worst(found: Sequence[Margin]) -> tuple[Margin, ...]:
    """The nearest to each limit."""
    names = dict.fromkeys(margin.limit for margin in found)
    return tuple(max((m for m in found if m.limit == name), key=lambda m: m.share) for name in names)

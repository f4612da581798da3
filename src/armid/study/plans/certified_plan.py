"""Last step of a design: check of the distances between bodies, certification of all limits, and preflight report."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armid.checked_array import Array
from armid.excitation.certification import certified, fine_grid
from armid.excitation.collision.closest_approach import RATE
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.design.sqp import DescentProblem, about_start
from armid.excitation.preflight import Preflight, preflight

Stage = Callable[[str], None]
"""Callback that is called with the name of each stage of a design."""

DRAWN, DRAWN_BY = 0.1, (0.97, 0.94, 0.88, 0.85)
"""If bodies are too close, the amplitudes of the joints between them are reduced step by step. The first number is
the smallest total factor. The other numbers are the factors of the first steps; the last factor is used for all
further steps. The reduction is necessary because the search keeps some distances only approximately: those between
bodies that are not replaced by capsules or hulls."""

TRIED = 50.0
"""Rate of the first test of the distances between bodies [Hz]; the second test has the rate `RATE`."""


def certified_plan(
    problem: DescentProblem, x: Array, collision: CollisionOptions | None, unchecked: str, stage: Stage
) -> tuple[Array, Preflight]:
    """Plan that provably keeps all limits, and its preflight check.

    As long as bodies are too close, the amplitudes of the joints between them are reduced. If this is not sufficient,
    the preflight report names the bodies.

    Args:
        problem: Criterion and all limits of the design.
        x: Unknowns of the plan that the search has found, shape (n k,), with k unknowns of each joint.
        collision: Pairs of bodies that must keep a distance; `None` for no collision check.
        unchecked: Reason why collisions are not checked; empty if they are checked.
        stage: Function that is called with the name of each stage of the design.

    Returns:
        Unknowns (n k,) of the certified plan, and the preflight check of this plan.
    """
    grid, basis = fine_grid(problem), problem.basis
    few, every = (max(100, round(rate * basis.period)) for rate in (TRIED, RATE))
    robot = problem.goal.model.robot
    factors, trial, steps = np.ones(basis.n), x, 0
    for times in () if collision is None else (basis.times(few), basis.times(every)):
        while factors.min() > DRAWN and collision is not None:
            close = collision.too_close_as_they_are(robot, basis.excitation(trial).at(times).q)
            if not close:
                break
            factors[close] *= DRAWN_BY[min(steps, len(DRAWN_BY) - 1)]
            trial, steps = about_start(basis, x, factors), steps + 1
    while True:
        stage("certificate of the limits")
        done, margins = certified(problem, grid, trial)
        stage("closest approaches")
        report = preflight(problem, done, collision, margins, unchecked)
        if factors.min() <= DRAWN or all(each.is_sufficient for each in report.approaches):
            return done, report
        factors *= DRAWN_BY[-1]
        trial = about_start(basis, x, factors)

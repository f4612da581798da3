"""Trade of criterion, duration and harmonics, on the geometry of eight real arms.

    python benchmarks/trade_off.py [--descents 2] [--arms 8] [--out docs/pictures/trade-off.svg] [--json]

For each arm of `../shared/data` and each combination, a few descents from uniform random coefficients inside position
and velocity of the description (1.5 rad/s where it says none) and an acceleration of 10 rad/s², free to swing about
another pose than the start, no collisions: geometry alone. The better plan is judged by three numbers, whatever it
was made for: the condition number, the root mean square of the deviations of the base parameters, and that of the
torque predicted along twelve random motions, noise of one N·m in every joint at 100 Hz. Both deviations are for the
same time of recording, a plan of 5 s being repeated four times where one of 20 s is played once.

The table has the median over the arms of each number over that of the same arm's D-optimal plan of 20 s and ten
harmonics.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import math
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from armid.checked_array import Array
from armid.excitation.design.multistart import random_start
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.design.sqp import STAGES, DescentProblem, descend, shrink_to_feasible
from armid.excitation.limits.joint_limits import limits_of, motion_channels
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.start_pose import usual_pose
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from armid.robot.robot import Robot

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

CRITERIA = ("d-optimal", "a-optimal", "condition")
SHAPES = ((5.0, 5), (10.0, 5), (20.0, 5), (20.0, 10))
"""Durations [s] and numbers of harmonics."""

REFERENCE = ("d-optimal", 20.0, 10)
RECORDED = 20.0
"""Time of recording that plans are compared for [s]."""

SPEED, ACCELERATION = 1.5, 10.0
ITERATIONS = (60, 60, 60)
"""Of the three stages of a descent: the study is about shapes, not about the last percent."""


@dataclass(frozen=True)
class Outcome:
    """Gain of one combination on one arm."""

    arm: str
    criterion: str
    seconds: float
    harmonics: int
    condition: float
    deviation: float
    prediction: float


def arms() -> list[Robot]:
    """The arms whose descriptions are there, fingers held."""
    found: list[Robot] = []
    for path in sorted(DATA.glob("*/*.urdf")):
        joints = ElementTree.parse(path).getroot().findall("joint")
        names = [joint.get("name", "") for joint in joints if joint.get("type") != "fixed"]
        found.append(load_robot(str(path), locked={name: 0.0 for name in names if "finger" in name}))
    return found


def problem_of(goal: CriterionGoal, seconds: float, harmonics: int) -> DescentProblem:
    """Limits of the motion itself."""
    robot = goal.model.robot
    given: dict[tuple[str, str], float | tuple[float, float]] = {}
    for joint in robot.joints:
        if not math.isfinite(joint.velocity_limit):
            given[joint.name, "velocity"] = SPEED
        if not np.isfinite(joint.position_limits).all() and joint.kind != "continuous":
            given[joint.name, "position"] = (-math.pi, math.pi)
    limits = limits_of(robot, given, acceleration=ACCELERATION)
    basis = SeriesBasis(2.0 * math.pi / seconds, harmonics, usual_pose(limits), literal=False)
    return DescentProblem(goal, basis, motion_channels(limits), float(np.median(limits.velocity)) / 1.75)


def designed(problem: DescentProblem, descents: int) -> Array:
    """The best of a few short descents."""
    stages = tuple(replace(stage, iterations=count) for stage, count in zip(STAGES, ITERATIONS, strict=False))
    best: tuple[float, Array] | None = None
    for seed in range(descents):
        x = random_start(problem, problem.fine, np.random.default_rng(seed))
        inside = shrink_to_feasible(problem, problem.fine, descend(problem, x, stages))
        if inside is not None and (best is None or problem.fine.value(inside) < best[0]):
            best = (problem.fine.value(inside), inside)
    assert best is not None
    return best[1]


def judged(problem: DescentProblem, x: Array, prediction: Array) -> tuple[float, float, float]:
    """Condition number, deviations of parameters and of predicted torque, root mean squares."""
    grid = Objective(problem.goal, problem.basis, round(100.0 * problem.basis.period))
    G = grid.information(x)
    covariance = np.linalg.inv(G * (RECORDED / problem.basis.period))
    values = np.linalg.eigvalsh(G)
    return (
        float(np.sqrt(values[-1] / values[0])),
        float(np.sqrt(np.trace(covariance) / len(G))),
        float(np.sqrt((prediction * covariance).sum())),
    )


def unseen(goal: CriterionGoal) -> Array:
    """Information of twelve random motions, one row's worth, shape (b, b)."""
    problem = problem_of(goal, 10.0, 5)
    grid = Objective(goal, problem.basis, 200)
    rng = np.random.default_rng(99)
    total = sum(grid.information(random_start(problem, problem.fine, rng)) for _ in range(12))
    return np.asarray(total) / (12.0 * 1000.0 * goal.model.n)


def study(robots: list[Robot], descents: int) -> list[Outcome]:
    """Every arm, every combination."""
    result: list[Outcome] = []
    for robot in robots:
        began = time.process_time()
        model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
        plain = CriterionGoal(model, find_base_parameters(model))
        prediction = unseen(plain)
        for criterion in CRITERIA:
            for seconds, harmonics in SHAPES:
                problem = problem_of(replace(plain, criterion=criterion), seconds, harmonics)
                numbers = judged(problem, designed(problem, descents), prediction)
                result.append(Outcome(robot.name, criterion, seconds, harmonics, *numbers))
        sys.stderr.write(f"{robot.name}: {time.process_time() - began:.0f} s of CPU\n")
    return result


NUMBERS = ("condition", "deviation", "prediction")


def medians(outcomes: list[Outcome]) -> dict[tuple[str, float, int], tuple[tuple[float, float, float], ...]]:
    """By combination and number: lowest, median and highest over the arms, over each arm's reference."""
    reference = {o.arm: o for o in outcomes if (o.criterion, o.seconds, o.harmonics) == REFERENCE}
    table = {}
    for criterion in CRITERIA:
        for seconds, harmonics in SHAPES:
            own = [o for o in outcomes if (o.criterion, o.seconds, o.harmonics) == (criterion, seconds, harmonics)]
            columns = []
            for number in NUMBERS:
                ratios = [getattr(o, number) / getattr(reference[o.arm], number) for o in own]
                columns.append((min(ratios), float(np.median(ratios)), max(ratios)))
            table[criterion, seconds, harmonics] = tuple(columns)
    return table


COLOURS = {"d-optimal": "#0072b2", "a-optimal": "#009e73", "condition": "#d55e00"}
WIDE, HIGH, LEFT, TOP, GAP = 230, 190, 52, 34, 62


def picture(outcomes: list[Outcome]) -> str:
    """Three panels, one a number: medians over the arms as points, from the lowest to the highest as lines."""
    table = medians(outcomes)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{LEFT + 3 * (WIDE + GAP)}" height="{HIGH + TOP + 66}" '
        'font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>'
    ]
    for panel, number in enumerate(NUMBERS):
        left = LEFT + panel * (WIDE + GAP)
        values = [value for columns in table.values() for value in columns[panel]]
        low, high = math.log10(min(values)) - 0.05, math.log10(max(values)) + 0.05
        parts.append(f'<text x="{left}" y="{TOP - 14}" font-weight="bold">{number}, over the reference</text>')
        parts.append(f'<rect x="{left}" y="{TOP}" width="{WIDE}" height="{HIGH}" fill="none" stroke="#888"/>')

        def at(value: float, low: float = low, high: float = high) -> float:
            return TOP + HIGH * (high - math.log10(value)) / (high - low)

        for tick in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0):
            if low < math.log10(tick) < high:
                parts.append(
                    f'<line x1="{left}" x2="{left + WIDE}" y1="{at(tick):.1f}" y2="{at(tick):.1f}" stroke="#ddd"/>'
                    f'<text x="{left - 6}" y="{at(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>'
                )
        for column, (seconds, harmonics) in enumerate(SHAPES):
            centre = left + WIDE * (column + 0.5) / len(SHAPES)
            parts.append(
                f'<text x="{centre:.1f}" y="{TOP + HIGH + 16}" text-anchor="middle">{seconds:g} s, {harmonics}</text>'
            )
            for k, criterion in enumerate(CRITERIA):
                least, middle, most = table[criterion, seconds, harmonics][panel]
                x, colour = centre + 12 * (k - 1), COLOURS[criterion]
                parts.append(
                    f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{at(most):.1f}" y2="{at(least):.1f}" stroke="{colour}"/>'
                    f'<circle cx="{x:.1f}" cy="{at(middle):.1f}" r="4" fill="{colour}"/>'
                )
    for k, criterion in enumerate(CRITERIA):
        x, y = LEFT + 110 * k, TOP + HIGH + 46
        parts.append(f'<circle cx="{x}" cy="{y - 4}" r="4" fill="{COLOURS[criterion]}"/><text x="{x + 9}" y="{y}">')
        parts.append(f"{criterion}</text>")
    parts.append(f'<text x="{LEFT + 350}" y="{TOP + HIGH + 46}">duration and number of harmonics below each</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--descents", type=int, default=2, help="of each combination; the best counts")
    parser.add_argument("--arms", type=int, default=8, help="how many of the arms")
    parser.add_argument("--out", type=Path, default=None, help="where to draw the picture")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if not DATA.is_dir():
        sys.exit(f"{DATA} is not there: the descriptions of the eight arms come with their recordings.")
    outcomes = study(arms()[: asked.arms], asked.descents)
    if asked.out is not None:
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        asked.out.write_text(picture(outcomes), encoding="utf-8")
    if asked.json:
        print(json.dumps([vars(outcome) for outcome in outcomes]))
        return
    print("| criterion | duration | harmonics | condition | deviation | prediction |\n|---|---|---|---|---|---|")
    for (criterion, seconds, harmonics), columns in medians(outcomes).items():
        cells = [f"{middle:.2f} ({least:.2f}-{most:.2f})" for least, middle, most in columns]
        print(f"| {criterion} | {seconds:g} s | {harmonics} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()

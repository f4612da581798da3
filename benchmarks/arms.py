"""A dozen arms and more: what a plan costs, whether it keeps every limit, and how much better it is than chance.

    python benchmarks/arms.py [ARM ...] [--cpu 40 | --rounds 1] [--seconds 20] [--harmonics 10] [--json]

Each arm stands on a floor, keeps its links 20 mm apart from each other and from the floor, and has limits of
position, velocity, acceleration, jerk and, where its description gives masses and torques, torque. Length and
harmonics are those that `armid excite` takes by itself. A search has so much CPU time in one process, which is half
the time on two cores that are idle; start-up, certificate and report come on top. Plans are checked by another
program (`flown.py`) at 1 kHz.

Chance is the median of twenty plans of the same length, harmonics and limits whose coefficients are uniform, drawn
together by one factor until they keep every limit: at rest at the plan's start pose, and once more at start poses
that are random, too, uniform among those in which the limits are kept.

Arms that are not built in are those of `tests/tables` and of the package `example-robot-data`
(`pip install --no-deps example-robot-data`), which is 400 MB of robots; without it they are left out, and that is
said.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from importlib import metadata
from itertools import islice
from pathlib import Path
from unittest.mock import patch

import numpy as np

from armid.excitation.clearance import floor
from armid.excitation.fourier import save_plan
from armid.excitation.objective import Goal, Objective
from armid.excitation.solver import Problem, drawn_together, highest
from armid.model.base import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from armid.study.excite import Designed, Effort, Rules, Wish, design_plan
from armid.values import Array
from flown import ROUNDING, Flight, fly, load_table, load_urdf

ROOT = Path(__file__).resolve().parents[1]
BUILT_IN = ROOT / "src" / "armid" / "robot" / "arms"
PACKAGE = "example-robot-data"

CLEARANCE, ACCELERATION, JERK, MARGIN = 0.02, 10.0, 200.0, 0.1
"""Distance of bodies [m], limits of every joint [rad/s² or m/s², rad/s³ or m/s³], share of torque kept free."""

NARROW = 0.005
"""Distance that Baxter's bodies keep [m]: its elbow and forearm are nowhere further apart than 23 mm."""

CHANCES = 20
"""Random plans."""

DRAWS = 20000
"""Random start poses that are tried for them."""


@dataclass(frozen=True)
class Entry:
    """Where an arm is described, which joints are held, how high the floor is, how far bodies keep apart [m]."""

    name: str
    path: Path
    floor: float = 0.0
    locked: tuple[str, ...] = ()
    clearance: float = CLEARANCE


@dataclass(frozen=True)
class Row:
    """What was measured; `cpu` is all of it, `beside` what is not search."""

    arm: str
    joints: int
    parameters: int
    pairs: int
    left_out: int
    cpu: float
    beside: float
    violations: int
    closest: str
    gain: float
    gain_over_best: float
    gain_over_any: float
    usual_start: bool


def entries() -> list[Entry]:
    """Every arm that is here."""
    result = [
        Entry(name, BUILT_IN / f"{name}.toml") for name in ("iiwa14-r820", "iiwa7-r800", "panda", "ur5e", "ur10e")
    ]
    result += [Entry(name, ROOT / "tests" / "tables" / f"{name}.toml") for name in ("scara", "gantry")]
    try:
        files = metadata.distribution(PACKAGE)
    except metadata.PackageNotFoundError:
        sys.stderr.write(f"{PACKAGE} is not installed; its arms are left out\n")
        return result
    robots = Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots")))
    fingers = tuple(f"{arm}_gripper_{finger}_finger_joint" for arm in "lr" for finger in "lr")
    return [
        *result,
        Entry("kinova j2s6s200", robots / "kinova_description/robots/kinova.urdf"),
        Entry("xarm7", robots / "xarm_description/urdf/xarm7.urdf"),
        Entry("z1", robots / "z1_description/urdf/z1.urdf", 0.0, ("jointGripper",)),
        Entry("so101", robots / "so_arm_description/urdf/so101.urdf"),
        Entry("ur3", robots / "ur_description/urdf/ur3_robot.urdf"),
        Entry("ur10", robots / "ur_description/urdf/ur10_robot.urdf", -0.05),
        Entry(
            "baxter, both arms", robots / "baxter_description/urdf/baxter.urdf", -0.95, ("head_pan", *fingers), NARROW
        ),
    ]


def design(entry: Entry, effort: Effort, seconds: float, harmonics: int, criterion: str) -> Designed:
    """A plan with every limit; the search's clock counts CPU time."""
    robot = load_robot(str(entry.path), locked=dict.fromkeys(entry.locked, 0.0))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    goal = Goal(model, find_base_parameters(model), criterion)
    rules = Rules(
        acceleration=ACCELERATION, jerk=JERK, torque_margin=MARGIN, clearance=entry.clearance,
        surroundings=(floor(entry.floor),),
    )  # fmt: skip
    with patch("time.time", time.process_time):
        return design_plan(Wish(goal, seconds, harmonics), rules, effort)


def flight(entry: Entry, designed: Designed) -> Flight:
    """The plan, checked by the other program."""
    toml = entry.path.suffix == ".toml"
    arm = load_table(entry.path) if toml else load_urdf(entry.path, dict.fromkeys(entry.locked, 0.0))
    with tempfile.TemporaryDirectory() as folder:
        path = save_plan(designed.plan.excitation, Path(folder) / "plan.json")
        return fly(
            arm, path, floor=entry.floor, clearance=entry.clearance, acceleration=ACCELERATION, jerk=JERK,
            torque=1.0 - MARGIN,
        )  # fmt: skip


def by_chance(problem: Problem, rng: np.random.Generator) -> float:
    """Sum of variances of uniform coefficients at rest at the start pose, drawn together into every limit."""
    basis, grid = problem.basis, problem.fine
    c = rng.uniform(-1.5, 1.5, (basis.n, 2 * basis.harmonics + 1))
    c[:, -1] = basis.start
    inside = drawn_together(problem, grid, basis.project(c))
    assert inside is not None
    return variances(grid, inside)


def variances(grid: Objective, x: Array) -> float:
    """Sum over the base parameters."""
    return float(np.trace(np.linalg.inv(grid.information(x))))


def anywhere(designed: Designed, rng: np.random.Generator) -> Iterator[Problem]:
    """The same problem from random start poses in which its limits are kept."""
    problem, limits = designed.problem, designed.limits
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    still = np.zeros(problem.basis.unknowns)
    for _ in range(DRAWS):
        moved = replace(problem, basis=replace(problem.basis, start=rng.uniform(low, high)))
        if highest(moved, moved.grid(1), still) < 1.0:
            yield moved


def measure(entry: Entry, effort: Effort, seconds: float, harmonics: int, criterion: str) -> Row:
    """One arm."""
    began = time.process_time()
    designed = design(entry, effort, seconds, harmonics, criterion)
    cpu = time.process_time() - began
    seen = flight(entry, designed)
    rng = np.random.default_rng(0)
    chances = [by_chance(designed.problem, rng) for _ in range(CHANCES)]
    elsewhere = [by_chance(moved, rng) for moved in islice(anywhere(designed, rng), CHANCES)]
    own = variances(designed.problem.fine, designed.x)
    for name, count in seen.close.items():
        sys.stderr.write(f"{entry.name}: {name} too close in {count} of {seen.samples} samples\n")
    for name, share in seen.shares.items():
        if share > 1.0 + ROUNDING:
            sys.stderr.write(f"{entry.name}: {100 * share:.7f} % of {name}\n")
    nearest = designed.preflight.approaches[0] if designed.preflight.approaches else None
    robot = designed.problem.goal.model.robot
    return Row(
        entry.name,
        robot.n,
        designed.problem.goal.base.count,
        seen.pairs,
        len(seen.skipped),
        round(cpu, 1),
        round(cpu - designed.search.seconds, 1),
        seen.violations,
        "" if nearest is None else f"{nearest.pair} {1000 * nearest.distance:.0f} mm",
        round(float(np.median(chances)) / own, 1),
        round(min(chances) / own, 1),
        round(float(np.median(elsewhere)) / own, 1),
        all(finding.code != "start-chosen" for finding in designed.findings),
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arm", nargs="*", help="names; all where left out")
    parser.add_argument("--cpu", type=float, default=40.0, help="CPU time of each search [s]")
    parser.add_argument("--rounds", type=int, help="rounds of each search in the place of a time")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the motion")
    parser.add_argument("--harmonics", type=int, default=10)
    parser.add_argument("--criterion", default="a-optimal")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    effort = Effort(None if asked.rounds else asked.cpu, 1, 0, asked.rounds)
    rows: list[Row] = []
    if not asked.json:
        print("| " + " | ".join(field.name.replace("_", " ") for field in fields(Row)) + " |")
        print("|---" * len(fields(Row)) + "|")
    for entry in entries():
        if asked.arm and entry.name not in asked.arm:
            continue
        row = measure(entry, effort, asked.seconds, asked.harmonics, asked.criterion)
        rows.append(row)
        if not asked.json:
            cells = [*asdict(row).values()]
            cells[-1] = "usual" if row.usual_start else "found"
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)
    if asked.json:
        print(json.dumps([asdict(row) for row in rows]))


if __name__ == "__main__":
    main()

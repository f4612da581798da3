"""A dozen arms and more: what a plan costs, whether it keeps every limit, and how much better it is than chance.

    python benchmarks/arms.py [ARM ...] [--free | --fixed] [--budget 20] [--seconds 20] [--harmonics 10] [--json]

Each arm stands on a floor, keeps its links 20 mm apart from each other and from the floor (Baxter's are narrower),
and has limits of position, velocity, acceleration, jerk and, where its description gives masses and torques, torque.
`armid excite` is run as it is from a shell, with two processes; measured are the wall time of the whole command and
the CPU time of all its processes. Plans are checked by another program (`flown.py`) at 1 kHz.

A plan is put beside chance in the space it was looked for in: from the start pose that the command chooses, or, with
the start pose and the centre among the unknowns (`--free-start --free-centre`), from any. Chance is the median of
twenty plans of the same length, harmonics and limits whose coefficients are uniform, drawn together by one factor
until they keep every limit: at rest at the same start pose, or at start poses that are uniform among those in which
the limits are kept.

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
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.distances import floor
from armid.excitation.design.objective import CriterionGoal, information_along
from armid.excitation.design.sqp import DescentProblem, max_utilisation, shrink_to_feasible
from armid.excitation.fourier import Excitation, load_plan
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import Robot, load_robot
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.design_result import Designed
from armid.study.plans.design_writing import save_design
from flown import ROUNDING, Flight, fly, load_table, load_urdf

ROOT = Path(__file__).resolve().parents[1]
BUILT_IN = ROOT / "src" / "armid" / "robot" / "arms"
PACKAGE = "example-robot-data"

CLEARANCE, ACCELERATION, JERK, MARGIN = 0.02, 10.0, 200.0, 0.1
"""Distance of bodies [m], limits of every joint [rad/s² or m/s², rad/s³ or m/s³], share of torque kept free."""

NARROW = 0.01
"""Distance that Baxter's bodies keep [m]: its elbow and forearm are nowhere further apart than 23 mm."""

CHANCES = 20
"""Random plans."""

DRAWS, AT_ONCE = 50000, 500
"""Random start poses that are tried for them, and how many of them at a time."""


@dataclass(frozen=True)
class Entry:
    """Description of an arm: which joints are held, how high the floor is, how far bodies keep apart [m]."""

    name: str
    path: Path
    floor: float = 0.0
    locked: tuple[str, ...] = ()
    clearance: float = CLEARANCE


@dataclass(frozen=True)
class Asked:
    """Effort for a plan: lengths in s, the budget of wall time, or whole rounds in its place."""

    seconds: float = 20.0
    harmonics: int = 10
    criterion: str = "a-optimal"
    budget: float = 20.0
    free: bool = False
    rounds: int | None = None


@dataclass(frozen=True)
class Row:
    """Measurements; `wall` and `cpu` are of the whole command [s]."""

    arm: str
    start: str
    joints: int
    parameters: int
    pairs: int
    left_out: int
    wall: float
    cpu: float
    descents: int
    violations: int
    closest: str
    gain: float
    gain_over_best: float


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
        Entry("ur3", robots / "ur_description/urdf/ur3_robot.urdf"),
        Entry("ur10", robots / "ur_description/urdf/ur10_robot.urdf"),
        Entry(
            "baxter, both arms", robots / "baxter_description/urdf/baxter.urdf", -0.95, ("head_pan", *fingers), NARROW
        ),
    ]


def command(entry: Entry, asked: Asked, folder: Path) -> tuple[float, float]:
    """Run `armid excite` into a folder; wall time and CPU time of all its processes [s].

    Raises:
        RuntimeError: It failed; the message is its own.
    """
    flags = {
        "--duration": asked.seconds, "--harmonics": asked.harmonics, "--criterion": asked.criterion,
        "--budget": asked.budget, "--acceleration": ACCELERATION, "--jerk": JERK, "--floor": entry.floor,
        "--clearance": entry.clearance, "--out": folder,
    }  # fmt: skip
    line = [str(Path(sys.executable).with_name("armid")), "excite", str(entry.path)]
    line += [word for flag, value in flags.items() for word in (flag, str(value))]
    line += [word for joint in entry.locked for word in ("--lock", joint)]
    line += ["--free-start", "--free-centre"] if asked.free else []
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    wall, after = time.time() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def designed(entry: Entry, asked: Asked) -> Designed:
    """The same in this process, for a search by rounds.

    Without rounds its search is over at once: what counts is the problem, limits, bodies and start pose, for chance.
    """
    robot = load_robot(str(entry.path), locked=dict.fromkeys(entry.locked, 0.0))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    goal = CriterionGoal(model, find_base_parameters(model), asked.criterion)
    rules = DesignConstraints(
        acceleration=ACCELERATION, jerk=JERK, torque_margin=MARGIN, clearance=entry.clearance,
        surroundings=(floor(entry.floor),),
    )  # fmt: skip
    wish = DesignGoal(goal, asked.seconds, asked.harmonics, free_start=asked.free, free_centre=asked.free)
    return design_plan(wish, rules, SearchBudget(None if asked.rounds else 1e-3, 1, 0, asked.rounds))


def flight(entry: Entry, plan: Path) -> Flight:
    """The plan, checked by the other program."""
    toml = entry.path.suffix == ".toml"
    arm = load_table(entry.path) if toml else load_urdf(entry.path, dict.fromkeys(entry.locked, 0.0))
    return fly(
        arm, plan, floor=entry.floor, clearance=entry.clearance, acceleration=ACCELERATION, jerk=JERK,
        torque=1.0 - MARGIN,
    )  # fmt: skip


def by_chance(problem: DescentProblem, rng: np.random.Generator) -> float:
    """Sum of variances of uniform coefficients at rest at the start pose, drawn together into every limit."""
    basis, grid = problem.basis, problem.fine
    c = rng.uniform(-1.5, 1.5, (basis.n, 2 * basis.harmonics + 1))
    c[:, -1] = basis.start
    inside = shrink_to_feasible(problem, grid, basis.project(c))
    assert inside is not None
    return variances(problem, basis.excitation(inside))


def variances(problem: DescentProblem, series: Excitation) -> float:
    """Sum over the base parameters; infinite where the motion does not tell all of them."""
    values = np.linalg.eigvalsh(information_along(problem.goal, series.sample(problem.goal.rate)))
    told = values[0] > np.finfo(float).eps * values[-1]
    return float((1.0 / values).sum()) if told else np.inf


def anywhere(found: Designed, rng: np.random.Generator) -> Iterator[DescentProblem]:
    """The same problem from random start poses in which its limits are kept."""
    problem, limits, collision = found.problem, found.limits, found.collision
    robot = problem.goal.model.robot
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    poses = (rng.uniform(low, high, (AT_ONCE, robot.n)) for _ in range(DRAWS // AT_ONCE))
    for start in (pose for some in poses for pose in some[apart(collision, robot, some)]):
        moved = replace(problem, basis=replace(problem.basis, start=start, free=False))
        if max_utilisation(moved, moved.grid(1), np.zeros(moved.basis.unknowns)) < 1.0:
            yield moved


def apart(collision: CollisionOptions | None, robot: Robot, poses: Array) -> NDArray[np.bool_]:
    """In which poses (N, n) bodies keep apart."""
    assert collision is not None
    return collision.clear(robot, poses)


def measure(entry: Entry, asked: Asked) -> Row:
    """One arm and one space."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        if asked.rounds:
            began, ticks = time.time(), time.process_time()
            save_design(designed(entry, asked), out, formats=())
            wall, cpu = time.time() - began, time.process_time() - ticks
        else:
            wall, cpu = command(entry, asked, out)
        seen = flight(entry, out / "plan.json")
        series = load_plan(out / "plan.json")
        plan, report = (json.loads((out / f"{name}.json").read_text()) for name in ("plan", "preflight"))
    found, rng = designed(entry, replace(asked, rounds=None)), np.random.default_rng(0)
    problem = found.problem
    spaces = islice(anywhere(found, rng), CHANCES) if asked.free else [problem] * CHANCES
    chances = [by_chance(each, rng) for each in spaces]
    own = variances(problem, series)
    complain(entry, seen)
    return Row(
        entry.name,
        "free" if asked.free else "usual" if usual(plan) else "found",
        series.n,
        problem.goal.base.count,
        seen.pairs,
        len(seen.skipped),
        round(wall, 1),
        round(cpu, 1),
        plan["descents"],
        seen.violations,
        "".join(f"{near['pair']} {1000 * near['distance']:.0f} mm" for near in report["approaches"][:1]),
        round(float(np.median(chances)) / own, 1),
        round(min(chances) / own, 1),
    )


def usual(plan: dict[str, Any]) -> bool:
    """Tell whether a plan starts where its arm usually does."""
    return all(finding["code"] != "start-chosen" for finding in plan["findings"])


def complain(entry: Entry, seen: Flight) -> None:
    """Say what is wrong with a plan."""
    for name, count in seen.close.items():
        sys.stderr.write(f"{entry.name}: {name} too close in {count} of {seen.samples} samples\n")
    for name, share in seen.shares.items():
        if share > 1.0 + ROUNDING:
            sys.stderr.write(f"{entry.name}: {100 * share:.7f} % of {name}\n")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arm", nargs="*", help="names; all where left out")
    spaces = parser.add_mutually_exclusive_group()
    spaces.add_argument("--free", action="store_true", help="only with the start pose among the unknowns")
    spaces.add_argument("--fixed", action="store_true", help="only from the start pose that the command chooses")
    parser.add_argument("--budget", type=float, default=20.0, help="wall time of each search [s]")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the motion")
    parser.add_argument("--harmonics", type=int, default=10)
    parser.add_argument("--rounds", type=int, help="whole rounds in one process in the place of a budget")
    parser.add_argument("--criterion", default="a-optimal")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    asked = Asked(options.seconds, options.harmonics, options.criterion, options.budget, rounds=options.rounds)
    rows: list[Row] = []
    if not options.json:
        print("| " + " | ".join(field.name.replace("_", " ") for field in fields(Row)) + " |")
        print("|---" * len(fields(Row)) + "|")
    for entry in entries():
        if options.arm and entry.name not in options.arm:
            continue
        for free in [False] * (not options.free) + [True] * (not options.fixed):
            rows.append(measure(entry, replace(asked, free=free)))
            if not options.json:
                print("| " + " | ".join(map(str, asdict(rows[-1]).values())) + " |", flush=True)
    if options.json:
        print(json.dumps([asdict(row) for row in rows]))


if __name__ == "__main__":
    main()

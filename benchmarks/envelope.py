"""Plans inside the envelope of the thesis's executed 27-s run, beside that run: deviations, and bias by friction.

    uv run python benchmarks/envelope.py --seconds 10 20 --harmonics 15 --rounds 2

Every plan may use the highest share of a velocity limit and the highest acceleration that any joint reaches in the
run (Table A.1 over 27 s). Deviations are of one period of white noise at 100 Hz; of them and of the bias the root
mean square over the inertial base parameters counts. The bias is what weighted least squares with viscous and Coulomb
friction makes of a noise-free recording whose friction has, besides, a Stribeck peak of 30 % of the Coulomb friction
that fades with a speed of 0.05 rad/s, and an offset of 5 % of it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.excitation.certification import certified, fine_grid
from armid.excitation.design.multistart import search
from armid.excitation.design.objective import CriterionGoal, information_along
from armid.excitation.design.sqp import DescentProblem
from armid.excitation.limits.joint_limits import limits_of, motion_channels
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot

NOISE = (1.0, 1.0, 0.6, 0.6, 0.4, 0.25, 0.25)
RATE = 100.0
RUN = 27.0
PEAK, FADING, OFFSET = 0.3, 0.05, 0.05


def bias(goal: CriterionGoal, motion: Motion) -> Array:
    """Error of weighted least squares by friction that the model lacks, shape (b,)."""
    source = goal.source
    coulomb = thesis_truth(goal.model)[[p.symbol == "FS" for p in goal.model.parameters]]
    size, speed = coulomb, motion.dq
    extra = size * (PEAK * np.exp(-((speed / FADING) ** 2)) * np.sign(speed) + OFFSET)
    x = kernel.columns(source.tree, source.layout, motion.q, motion.dq, motion.ddq, extra, source.term_rows(motion))
    moment = np.zeros(goal.base.count)
    for j, p in enumerate(source.layout.parameters):
        own = x[source.layout.offset[j] : source.layout.offset[j + 1]]
        moment[p] += own[:-1] @ own[-1] / goal.noise[j] ** 2
    return np.linalg.solve(information_along(goal, motion), moment)


def measured(goal: CriterionGoal, motion: Motion) -> tuple[float, float, float]:
    """RMS deviation and RMS bias of the inertial base parameters, and the condition number."""
    inertial = np.isin(goal.base.kept, goal.model.inertial_columns)
    G = information_along(goal, motion)
    variance = np.diag(np.linalg.inv(G))[inertial]
    condition = CriterionGoal(goal.model, goal.base, "condition")
    value = math.exp(condition.value(information_along(condition, motion)))
    return math.sqrt(variance.mean()), math.sqrt((bias(goal, motion)[inertial] ** 2).mean()), value


def main() -> None:
    """Design, measure, print a table and one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, nargs="+", default=[10.0, 20.0])
    parser.add_argument("--harmonics", type=int, default=15)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--criterion", default="d-optimal")
    options = parser.parse_args()
    robot = load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    goal = CriterionGoal(model, find_base_parameters(model), options.criterion, np.array(NOISE), RATE)
    run = builtin_plan("thesis-a1").stretched(RUN)
    limits = limits_of(robot).narrowed(run.sample(1000.0), by_joint=False)
    rows = [{"plan": "the run, 27 s", "cpu_seconds": 0.0} | _row(goal, run.sample(RATE))]
    for seconds in options.seconds:
        basis = SeriesBasis(2.0 * math.pi / seconds, options.harmonics, np.zeros(model.n))
        problem = DescentProblem(goal, basis, motion_channels(limits), float(np.median(limits.velocity)) / 1.75)
        began = time.process_time()
        found = search(problem, seed=options.seed, budget=None, rounds=options.rounds)
        x, _ = certified(problem, fine_grid(problem), found.best.x)
        spent = time.process_time() - began
        rows.append({"plan": f"{seconds:g} s", "cpu_seconds": spent} | _row(goal, basis.excitation(x).sample(RATE)))
    first = rows[0]
    for row in rows:
        share = row["deviation"] / first["deviation"], row["bias"] / first["bias"]
        sys.stdout.write(
            f"{row['plan']:14} deviation {row['deviation']:.5f} ({share[0]:.3f}) bias {row['bias']:.5f} "
            f"({share[1]:.3f}) condition {row['condition']:.1f} in {row['cpu_seconds']:.0f} s of CPU\n"
        )
    sys.stdout.write(json.dumps({"options": vars(options), "rows": rows}) + "\n")


def _row(goal: CriterionGoal, motion: Motion) -> dict[str, float]:
    deviation, error, condition = measured(goal, motion)
    return {"deviation": deviation, "bias": error, "condition": condition}


if __name__ == "__main__":
    main()

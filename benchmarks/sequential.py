"""A second 10-s run designed on what the first one says, beside the first one repeated.

    uv run python benchmarks/sequential.py --arm iiwa14-r820 --seeds 1 2 3 --rounds 2

The first plan is D-optimal. Its run is simulated by its own deviations: estimates are the truth with noise of their
size. What counts is the largest deviation after both runs over the estimate, among parameters that are told from
zero, three deviations away from it. With --free second the second plan chooses its start pose, which a lead-in joins
to that of the first, and its joints may swing about another one; with --free both the first one does so, too.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.excitation.design.multistart import search
from armid.excitation.design.objective import CriterionGoal, information_along, known_sizes
from armid.excitation.design.sqp import DescentProblem
from armid.excitation.limits.joint_limits import limits_of, motion_channels
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot

SECONDS = 10.0
THESIS_NOISE = (1.0, 1.0, 0.6, 0.6, 0.4, 0.25, 0.25)
NOISE_SHARE = 0.003
"""Noise of other arms' joints, over their torque limits; the thesis's arm has about that."""
FRICTION_SHARE = 0.05
"""Friction of other arms' joints at rest and at 1 rad/s, over their torque limits."""


def goal_of(name: str) -> tuple[CriterionGoal, Array]:
    """The arm with viscous and Coulomb friction, and its true base parameters."""
    own = name == "iiwa14-r820"
    robot = load_robot(name, gravity=(0.0, 0.0, 9.81)) if own else load_robot(name)
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    base = find_base_parameters(model)
    if own:
        return CriterionGoal(model, base, noise=np.array(THESIS_NOISE)), base.values_of(thesis_truth(model))
    nominal = model.nominal_parameters()
    assert nominal is not None, f"{name} gives no masses"
    effort = np.array([joint.effort_limit for joint in robot.joints])
    truth = np.array(nominal)
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in ("FV", "FS"):
            truth[k] = FRICTION_SHARE * effort[robot.joint_index(parameter.joint)]
    return CriterionGoal(model, base, noise=NOISE_SHARE * effort), base.values_of(truth)


def designed(goal: CriterionGoal, harmonics: int, free: bool, seed: int, rounds: int) -> Array:
    """Information of a plan inside the limits of position and velocity."""
    limits = limits_of(goal.model.robot)
    start = np.clip(0.0, limits.lower + 0.1, limits.upper - 0.1)
    basis = SeriesBasis(2.0 * math.pi / SECONDS, harmonics, start, free=free, literal=not free)
    problem = DescentProblem(goal, basis, motion_channels(limits), float(np.median(limits.velocity)) / 1.75)
    best = search(problem, seed=seed, budget=None, rounds=rounds).best
    return information_along(goal, basis.excitation(best.x).sample(goal.rate))


def main() -> None:
    """Design both runs for every seed, print what they give."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", default="iiwa14-r820")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--free", choices=("none", "second", "both"), default="second")
    parser.add_argument("--criteria", nargs="+", default=["worst", "d-optimal"])
    parser.add_argument("--harmonics", type=int, default=15)
    options = parser.parse_args()
    goal, truth = goal_of(options.arm)
    for seed in options.seeds:
        began = time.process_time()
        first = designed(goal, options.harmonics, options.free == "both", seed, options.rounds)
        deviations = _deviations(first)
        estimates = truth + deviations * np.random.default_rng(seed).standard_normal(len(truth))
        sizes = known_sizes(estimates, deviations)
        assert sizes is not None

        def worst(G: Array, sizes: Array = sizes) -> float:
            return float((_deviations(G) / sizes).max())

        row: dict[str, object] = {
            "arm": options.arm,
            "free": options.free,
            "seed": seed,
            "counted": int(np.isfinite(sizes).sum()),
        }
        row["repeated"] = worst(2.0 * first)
        for criterion in options.criteria:
            after = replace(goal, criterion=criterion, prior=first, scale=sizes)
            both = first + designed(after, options.harmonics, options.free != "none", seed + 100, options.rounds)
            row[criterion] = {
                "worst": worst(both),
                "lower": 1.0 - worst(both) / worst(2.0 * first),
                "volume": float(np.linalg.slogdet(2.0 * first)[1] - np.linalg.slogdet(both)[1]) / (2 * len(truth)),
            }
        row["cpu_seconds"] = time.process_time() - began
        sys.stdout.write(json.dumps(row) + "\n")
        sys.stdout.flush()


def _deviations(G: Array) -> Array:
    return np.sqrt(np.diag(np.linalg.inv(G)))


if __name__ == "__main__":
    main()

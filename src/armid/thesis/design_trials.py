"""Section 3.3 and Algorithm 2 of the thesis: trajectories from random starts, and their test in closed loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.excitation.collision.collision_model import collision_of
from armid.excitation.design.multistart import random_start
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.sqp import STAGES, DescentProblem, descend, shrink_to_feasible
from armid.excitation.fourier import Excitation
from armid.excitation.limits.joint_limits import limits_of, thesis_channels
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.lab.controller import Controller
from armid.lab.known_arms import truth_of
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing
from armid.lab.simulation import Simulated, simulate, simulation_findings
from armid.maths.linalg import condition
from armid.robot import forward_kinematics
from armid.thesis.algorithm import TEST_RATE, Errors, errors_of, estimate, mean_of, observed
from armid.thesis.algorithm_corrections import CORRECTED, PRINTED
from armid.thesis.experiments.motion_variants import Family, families
from armid.thesis.setting import DESIGNED, PERIOD, Setting

HARMONICS = 10

CHECKED = 50.0
"""Rate at which poses along a motion are checked for collisions [Hz]; the fastest joint turns by 3° from one checked
pose to the next."""

MOVING = replace(CORRECTED, slow=0.05)
"""Processing that leaves out rows in which the velocity of a joint is below 0.05 rad/s, because the joint may stick
with an unknown static friction."""

NEAR = 2
"""Largest number of joints between two links whose capsules may overlap by construction, as in a bent wrist."""

CONTROLLER = Controller(model_scale=1.05, friction=0.9)
"""Controller with inverse dynamics of a model that is 5 % too heavy, and feed-forward of 90 % of the friction. This
is the accuracy of a good model before an identification."""


@dataclass(frozen=True, eq=False, slots=True)
class DesignTrial:
    """Trajectory with the results of its test in closed loop.

    Attributes:
        name: `Table A.1` (of the thesis) with its period, or the number of the random start.
        plan: The trajectory.
        condition: Condition number of the stacked base regressor Y_b along the trajectory, sampled at 100 Hz.
        limits: Largest ratio of a value in closed loop to its limit, for position, velocity and torque, shape (3,).
        tracking: Root mean square of the position error in closed loop, over all joints [rad].
        clearance: Smallest distance between bodies of links that are more than two joints apart [m].
        doubts: Codes of the findings because of which the real arm should not run the trajectory; empty without
            findings.
        printed: Errors of Algorithm 3 as printed, on the recording in closed loop.
        corrected: Errors of Algorithm 3 with filtered columns, on the recording in closed loop.
        moving: Errors as in `corrected`, but without the rows in which a joint is slow or at rest.
    """

    name: str
    plan: Excitation
    condition: float
    limits: Array
    tracking: float
    clearance: float
    doubts: tuple[str, ...]
    printed: Errors
    corrected: Errors
    moving: Errors

    @property
    def feasible(self) -> bool:
        """Tests whether `doubts` is empty: the trajectory keeps all limits and bodies do not collide."""
        return not self.doubts


@dataclass(frozen=True, eq=False, slots=True)
class Designs:
    """Result of Algorithm 2 of the thesis.

    Attributes:
        unknowns: Number of coefficients of the series (3.55) of the thesis: 2 · 7 · L.
        free: Number of coefficients that the condition (3.55c) leaves free.
        published: Motion of Table A.1 with periods of 20 s and 27 s, tested in the same way as the designs.
        trials: Designed trajectories, in the order of their random starts.
        starts: Condition number of each random start, scaled to keep the limits, shape (starts,).
        kept: Index of the best feasible trajectory in `trials`, as defined in `designs`; -1 if none is feasible.
        families: Results of other parameterisations of the trajectory.
    """

    unknowns: int
    free: int
    published: tuple[DesignTrial, ...]
    trials: tuple[DesignTrial, ...]
    starts: Array
    kept: int
    families: tuple[Family, ...]

    @property
    def best(self) -> DesignTrial:
        """Best feasible trajectory; if none is feasible, Table A.1 of the thesis with a period of 27 s."""
        return self.trials[self.kept] if self.kept >= 0 else self.published[-1]


def designs(setting: Setting, tell: Callable[[float], None]) -> Designs:
    """Runs Algorithm 2 of the thesis: optimises trajectories from random starts, and tests them in closed loop.

    The best trajectory is the feasible one whose estimate by Algorithm 3 as printed has the smallest torque error
    along Table A.2.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    problem = _problem(setting)
    count = setting.extent.starts
    published: list[DesignTrial] = []
    for k, period in enumerate((DESIGNED, PERIOD)):
        tell(k / (count + 2))
        published.append(_trial(setting, f"Table A.1, {period:g} s", setting.train.stretched(period), seed=k + 1))
    trials: list[DesignTrial] = []
    starts = np.zeros(count)
    for k in range(count):
        tell((k + 2) / (count + 2))
        start = random_start(problem, problem.fine, np.random.default_rng((k + 1, 0)))
        starts[k] = _condition(setting, problem.basis.excitation(start))
        x = descend(problem, start, STAGES[: setting.extent.stages])
        inside = shrink_to_feasible(problem, problem.fine, x)
        plan = problem.basis.excitation(start if inside is None else inside, setting.train.robot)
        trials.append(_trial(setting, f"start {k + 1}", plan, seed=k + 3))
    feasible = [k for k, trial in enumerate(trials) if trial.feasible]
    kept = min(feasible, key=lambda k: trials[k].printed.unseen) if feasible else -1
    basis = problem.basis
    unknowns, free = 2 * basis.n * HARMONICS, basis.n * basis.size
    others = families(setting, PRINTED, CORRECTED)
    tell(1.0)
    return Designs(unknowns, free, tuple(published), tuple(trials), starts, kept, others)


def _problem(setting: Setting) -> DescentProblem:
    """Optimisation problem (3.55) of the thesis: smallest condition number under the constraints (3.55c) to (3.55f).

    The regressor is sampled at 100 Hz. The factor 1/L of (3.55f) is left out.
    """
    model = setting.hanging
    robot = model.dynamics.robot
    limits = limits_of(robot)
    basis = SeriesBasis(2.0 * math.pi / DESIGNED, HARMONICS, np.zeros(robot.n))
    goal = CriterionGoal(model.dynamics, model.base, "condition", rate=TEST_RATE)
    return DescentProblem(goal, basis, thesis_channels(limits, basis), float(np.median(limits.velocity)) / 1.75)


def _condition(setting: Setting, plan: Excitation) -> float:
    columns = setting.hanging.columns(plan.sample(TEST_RATE))
    return condition(columns.reshape(-1, columns.shape[2]))


def _trial(setting: Setting, name: str, plan: Excitation, seed: int) -> DesignTrial:
    """Simulates a trajectory in closed loop, and applies Algorithm 3 of the thesis to the recording.

    Args:
        setting: Arm, true parameters and motions.
        name: Name of the trajectory.
        plan: The trajectory.
        seed: Seed of the noise.
    """
    extent = setting.extent
    truth = truth_of(setting.hanging.dynamics.robot)
    options = LabOptions(
        repetitions=extent.repetitions,
        physics_rate=extent.physics_rate,
        controller=CONTROLLER,
        sensing=Sensing(extent.lab_rate),
    )
    done = simulate(truth, plan, options, seed=seed)
    clearance = _clearance(setting, done)
    codes = sorted(
        {finding.code for finding in simulation_findings(done)} | ({"collision"} if clearance <= 0.0 else set())
    )
    as_printed = observed(setting, mean_of(done.recording, plan.period), PRINTED, None)
    evaluated = [errors_of(setting, estimate(setting.literal, as_printed))]
    for processing in (CORRECTED, MOVING):
        observations = observed(setting, done.recording, processing, plan.period)
        evaluated.append(errors_of(setting, estimate(setting.hanging, observations)))
    trace = done.trace.from_time(0.0)
    off = trace.q - plan.at(trace.time).q
    return DesignTrial(
        name,
        plan,
        _condition(setting, plan),
        _shares(setting, done),
        float(np.sqrt(np.mean(off**2))),
        clearance,
        tuple(codes),
        *evaluated,
    )


def _shares(setting: Setting, done: Simulated) -> Array:
    """Largest ratio of a value in a simulated motion to its limit, for position, velocity and torque, shape (3,)."""
    joints = setting.hanging.dynamics.robot.joints
    limits = limits_of(setting.hanging.dynamics.robot)
    trace = done.trace.from_time(0.0)
    half = 0.5 * (limits.upper - limits.lower)
    effort = np.array([joint.effort_limit for joint in joints])
    away = trace.q - 0.5 * (limits.upper + limits.lower)
    parts = (away / half, trace.dq / limits.velocity, trace.effort / effort)
    return np.array([float(np.abs(part).max()) for part in parts])


def _clearance(setting: Setting, done: Simulated) -> float:
    """Smallest distance between bodies of the arm along the simulated motion [m]; neighbouring links are left out."""
    robot = setting.hanging.dynamics.robot
    found = collision_of(robot, limits_of(robot), np.zeros(robot.n), margin=0.0)
    links = np.array([shape.link for shape in found.shapes])[found.pairs]
    bodies = found.every.bodies.only(np.flatnonzero(np.abs(links[:, 0] - links[:, 1]) > NEAR))
    trace = done.trace.from_time(0.0)
    every = max(1, round(1.0 / (CHECKED * (trace.time[1] - trace.time[0]))))
    return float(bodies.nearest(forward_kinematics(robot, trace.q[::every]))[0].min())

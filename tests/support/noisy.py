"""A small arm recorded with noise of any colour; for tests of what is said about the uncertainty of an estimate."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.signal import lfilter

from armid.checked_array import Array
from armid.estimation.estimators import OrdinaryLeastSquares, WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, build_problem
from armid.estimation.run_estimator import estimate
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RigidBody, Viscous
from informed import Arm
from problems import lively_motion
from trees import chain, robot_of

RATE = 50.0
WLS, OLS = WeightedLeastSquares(), OrdinaryLeastSquares()


@cache
def arm() -> Arm:
    """Two joints, seven parameters: small, so that hundreds of identifications take a second."""
    robot = robot_of(chain("RR", [np.eye(3)] * 2, [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]], [0.0, -9.81, 0.0]))
    model = DynamicsModel(robot, (RigidBody(), Viscous()))
    base = find_base_parameters(model)
    return model, base, np.random.default_rng(8).normal(size=base.count)


def moved(seconds: float, count: int = 1, seed: int = 4) -> Motion:
    """A motion, run through so many times."""
    one = lively_motion(np.random.default_rng(seed), 2, RATE, seconds)
    time = np.arange(count * one.samples) / RATE
    return Motion(time, *(np.tile(x, (count, 1)) for x in (one.q, one.dq, one.ddq)))


def coloured(
    rng: np.random.Generator, samples: int, memory: float, levels: tuple[float, float] = (1.0, 1.0)
) -> Array:
    """First-order autoregressive noise that the joints share a part of; white without memory."""
    z = rng.normal(size=(samples + 500, 2))
    if memory:
        a = np.exp(-1.0 / (RATE * memory))
        z = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], z, axis=0)
        z[:, 1] = 0.6 * z[:, 0] + 0.8 * z[:, 1]
    return z[500:] * levels


def problem(motion: Motion, noise: Array, block: Array, band: Band | None = None, step: int = 1) -> EstimationProblem:
    """A problem with its samples, from one run."""
    model, base, truth = arm()
    torque = model.regressor(motion)[:, :, base.kept] @ truth + noise
    rows = len(range(0, motion.samples, step))
    mask = np.ones((rows, 2), dtype=bool)
    run = ObservedRun(motion, torque, RATE, step, 0, mask, np.asarray(block, dtype=np.int64)[:rows])
    observations = Observations((run,), band or Band())
    return build_problem(model, observations, base=base)


def seconds_of(motion: Motion) -> Array:
    return np.arange(motion.samples) // int(RATE)


def repeated(seed: int, count: int, memory: float = 0.1) -> EstimationProblem:
    motion = moved(8.0, count)
    noise = coloured(np.random.default_rng(seed), motion.samples, memory)
    return problem(motion, noise, np.repeat(np.arange(count), motion.samples // count))


def once(seed: int, seconds: float = 20.0, memory: float = 0.1, **kinds: object) -> EstimationProblem:
    motion = moved(seconds)
    noise = coloured(np.random.default_rng(seed), motion.samples, memory)
    return problem(motion, noise, seconds_of(motion), **kinds)  # pyright: ignore[reportArgumentType]


def covered(given: EstimationProblem, method: OrdinaryLeastSquares | WeightedLeastSquares = WLS) -> Fit:
    return estimate(given, method)


def inside(fit: Fit) -> Array:
    ends, truth = fit.intervals, arm()[2]
    return (ends[:, 0] <= truth) & (truth <= ends[:, 1])


def dense(given: EstimationProblem) -> tuple[Array, Array]:
    """Columns (N, n, b) and torque (N, n) of an unfiltered problem."""
    model, base, _ = arm()
    assert given.observations is not None
    (run,) = given.observations.runs
    return model.regressor(run.motion)[:, :, base.kept], run.torque

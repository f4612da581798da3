"""Many threads on one arm, and on many arms, compute what one thread computes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from armid import kernel
from armid.checked_array import Array
from armid.kernel import ServoJoints
from armid.model.terms.law_programs import law_programs
from problems import Problem, random_problem
from trees import random_inertial, random_tree

THREADS = 8
ROUNDS = 6
"""Times that each thread computes everything, so that the threads meet in every function."""


def everything(problem: Problem, inertial: Array, build: str) -> list[Array]:
    """Results of all functions of the kernel for a problem."""
    tree, layout, (q, dq, ddq) = problem.tree, problem.layout, problem.state
    n, samples = tree.n, len(q)
    servos = ServoJoints([20.0] * n, [1.0] * n, [np.inf] * n, [0.2] * n, law_programs([]), [], 2e-3)
    command = 0.1 * q[None]
    rolled = kernel.roll_out(tree, inertial, servos, command, None, command[:, 0], np.zeros((1, n)), chosen=build)
    bounds = [0, samples // 3, samples]
    x = kernel.columns(*problem.data, chosen=build)
    return [
        kernel.regressor(tree, q, dq, ddq, chosen=build),
        kernel.inverse_dynamics(tree, inertial, q, dq, ddq, chosen=build),
        kernel.mass_matrix(tree, inertial, q, chosen=build),
        x,
        *kernel.unpack_factors(layout, kernel.factor(*problem.data, bounds, threads=3, chosen=build)),
        *kernel.columns_adjoint(tree, layout, q, dq, ddq, np.ones_like(x), chosen=build),
        rolled[0],
        rolled[1],
    ]


def in_threads(work: list[Callable[[], list[Array]]]) -> list[list[Array]]:
    with ThreadPoolExecutor(THREADS) as pool:
        return [done.result() for done in [pool.submit(each) for each in work]]


@pytest.mark.parametrize("build", kernel.instruction_sets()[:-1])
@pytest.mark.parametrize("arms", [1, THREADS])
def test_threads_compute_what_one_computes(arms: int, build: str):
    """To the last bit: every number is computed by the same operations, whoever else computes."""
    problems = []
    for seed in range(arms):
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, 2 + seed % 6, branching=0.3)
        problems.append((random_problem(rng, tree, 201), random_inertial(rng, tree.n)))
    alone = [everything(*problem, build) for problem in problems]
    turns = [k % arms for k in range(THREADS * ROUNDS)]
    found = in_threads([lambda k=k: everything(*problems[k], build) for k in turns])
    for k, together in zip(turns, found, strict=True):
        assert len(together) == len(alone[k])
        for one, other in zip(alone[k], together, strict=True):
            assert np.array_equal(one, other)

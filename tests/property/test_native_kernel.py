"""Every build of the kernel that runs here means what the NumPy twin says, on trees of any kind and any number of
samples."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError
from problems import COMPILED, TWIN, random_layout, random_problem
from trees import iiwa_tree, random_inertial, random_states, random_tree, structured_tree

TOLERANCE = 1e-12
"""Relative to the largest entry: recursion against Jacobians, a few thousand operations apart."""

SAMPLES = (1, 7, 37, 8, 195)
"""Less than a register, one over or under several, a whole one, and more than the kernel's tile of 192."""


def agree(compiled, twin):
    assert compiled.shape == twin.shape
    assert np.abs(compiled - twin).max() <= TOLERANCE * np.abs(twin).max()


def compare(tree, rng, state):
    """All that both kernels make of one tree at one set of states."""
    inertial = random_inertial(rng, tree.n)
    layout = random_layout(rng, tree)
    samples = len(state[0])
    torque, terms = rng.normal(size=(samples, tree.n)), rng.normal(size=(len(layout.kept), samples))
    Y = kernel.regressor(tree, *state, chosen=TWIN)
    tau = kernel.inverse_dynamics(tree, inertial, *state, chosen=TWIN)
    M = kernel.mass_matrix(tree, inertial, state[0], chosen=TWIN)
    x = kernel.columns(tree, layout, *state, torque, terms, chosen=TWIN)
    for build in COMPILED:
        agree(kernel.regressor(tree, *state, chosen=build), Y)
        agree(kernel.inverse_dynamics(tree, inertial, *state, chosen=build), tau)
        agree(kernel.mass_matrix(tree, inertial, state[0], chosen=build), M)
        agree(kernel.columns(tree, layout, *state, torque, terms, chosen=build), x)


@pytest.mark.parametrize("seed", range(210))
def test_random_trees(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 30
    tree = (structured_tree if seed % 4 == 0 else random_tree)(rng, n)
    # Long batches only on small trees: the twin takes 6 n numbers a link and sample.
    samples = SAMPLES[seed % len(SAMPLES)] if n <= 12 else SAMPLES[seed % 3]
    compare(tree, rng, random_states(rng, samples, n))


@pytest.mark.parametrize(("prismatic", "branching"), [(0.0, 0.0), (0.3, 0.2), (1.0, 0.5)])
def test_64_joints(prismatic, branching):
    rng = np.random.default_rng(64)
    tree = random_tree(rng, 64, prismatic=prismatic, branching=branching)
    compare(tree, rng, random_states(rng, 3, 64))


@pytest.mark.parametrize("reach", [1e3, 9.9e4, 1e6, 1e12])
def test_large_angles(reach):
    """Beyond 1e5 rad the kernel's own sine hands over to the C library, for whole registers at a time."""
    rng = np.random.default_rng(5)
    tree = random_tree(rng, 6, prismatic=0.0)
    q, dq, ddq = random_states(rng, 37, 6)
    compare(tree, rng, (q * reach, dq, ddq))
    some = rng.random(q.shape) < 0.1
    compare(tree, rng, (np.where(some, reach, 1.0) * q, dq, ddq))


def test_sines_at_the_borders_of_quadrants():
    """A pendulum's gravity torque is its cosine: exact multiples of π/4 and their neighbours, both signs."""
    tree = kernel.Tree([-1], [0], [[0, 0, 1.0]], [np.eye(3)], [[0, 0, 0]], [0, -1.0, 0])
    angles = np.arange(-40, 41) * (np.pi / 4)
    q = np.concatenate([angles, np.nextafter(angles, 100), np.nextafter(angles, -100), [0.0, -0.0, 1e-300]])[:, None]
    mass = np.array([[1.0, 1.0, *[0.0] * 8]])
    for build in COMPILED:
        tau = kernel.inverse_dynamics(tree, mass, q, 0 * q, 0 * q, chosen=build)
        assert np.abs(tau - np.cos(q)).max() <= 2.0 * np.finfo(float).eps


def test_columns_are_those_of_the_regressor():
    """A layout promises that each joint's columns belong to its parameters and that its torque stands last."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, 1 + seed % 9, branching=0.4)
        n = tree.n
        standard = rng.permutation(10 * n)[: 5 * n]
        inertial = np.full(10 * n, -1, dtype=np.int32)
        inertial[standard] = np.arange(len(standard))
        layout = kernel.make_layout(tree, inertial, np.arange(n), len(standard) + np.arange(n))
        state = random_states(rng, 5, n)
        torque, terms = rng.normal(size=(5, n)), rng.normal(size=(n, 5))
        Y = kernel.regressor(tree, *state, chosen=TWIN)
        x = kernel.columns(tree, layout, *state, torque, terms, chosen=TWIN)
        for j in range(n):
            own = x[layout.offset[j] : layout.offset[j + 1]]
            bodies = layout.parameters[j][layout.parameters[j] < len(standard)]
            assert np.array_equal(own[: len(bodies)], Y[:, j, standard[bodies]].T)
            assert np.array_equal(own[-2:], [terms[j], torque[:, j]])
            others = np.setdiff1d(standard, standard[bodies])
            assert not Y[:, j, others].any()


def test_a_given_array_is_filled_and_strides_do_not_matter():
    rng = np.random.default_rng(3)
    problem = random_problem(rng, random_tree(rng, 5), 40)
    q, dq, ddq = problem.state
    for build in kernel.instruction_sets():
        out = np.full((20, 5, 50), np.nan)
        assert kernel.regressor(problem.tree, q[::2], dq[::2], ddq[::2], out=out, chosen=build) is out
        agree(out, kernel.regressor(problem.tree, q, dq, ddq, chosen=TWIN)[::2])
        x = np.full((problem.layout.columns, 40), np.nan)
        assert kernel.columns(*problem.data, out=x, chosen=build) is x
        agree(x, np.concatenate(problem.columns()))


@pytest.mark.parametrize(
    "out",
    [np.empty((20, 5, 49)), np.empty((20, 5, 50), dtype=np.float32), np.empty((20, 5, 100))[:, :, ::2]],
    ids=["shape", "type", "strides"],
)
def test_an_array_that_cannot_be_filled_is_refused(out):
    rng = np.random.default_rng(3)
    with pytest.raises(ArmidError, match="out must be"):
        kernel.regressor(random_tree(rng, 5), *random_states(rng, 20, 5), out=out)


def test_states_of_other_shapes_are_refused():
    rng = np.random.default_rng(3)
    tree = random_tree(rng, 5)
    q, dq, ddq = random_states(rng, 20, 5)
    for state in ((q[:-1], dq, ddq), (q[:, :-1], dq[:, :-1], ddq[:, :-1]), (q[0], dq[0], ddq[0])):
        with pytest.raises(ArmidError, match=r"\(N, 5\)"):
            kernel.regressor(tree, *state)
    for build in COMPILED:
        with pytest.raises(ValueError, match="inertial"):
            kernel.inverse_dynamics(tree, np.ones((4, 10)), q, dq, ddq, chosen=build)


def test_no_samples_give_no_rows():
    rng = np.random.default_rng(3)
    tree = random_tree(rng, 4)
    nothing = np.zeros((0, 4))
    for build in kernel.instruction_sets():
        assert kernel.regressor(tree, nothing, nothing, nothing, chosen=build).shape == (0, 4, 40)
        assert kernel.mass_matrix(tree, np.ones((4, 10)), nothing, chosen=build).shape == (0, 4, 4)


def test_the_environment_chooses_the_build(monkeypatch):
    try:
        for build in kernel.instruction_sets():
            kernel.in_use.cache_clear()
            monkeypatch.setenv("ARMID_KERNEL", build)
            assert kernel.in_use() == build
        kernel.in_use.cache_clear()
        monkeypatch.delenv("ARMID_KERNEL")
        assert kernel.in_use() == kernel.instruction_sets()[0]
        kernel.in_use.cache_clear()
        monkeypatch.setenv("ARMID_KERNEL", "altivec")
        with pytest.raises(ArmidError, match=r"altivec.*\n.*baseline, numpy"):
            kernel.in_use()
    finally:
        kernel.in_use.cache_clear()


def test_the_interpreter_runs_while_the_kernel_works():
    """With the interpreter locked, the counting loop would not turn before the kernel is done."""
    rng = np.random.default_rng(0)
    problem = random_problem(rng, iiwa_tree(), 60_000)
    work = threading.Thread(target=kernel.factor, args=(*problem.data, [0, 60_000]))
    work.start()
    turns = 0
    while work.is_alive():
        time.sleep(0.001)
        turns += 1
    work.join()
    assert turns > 5

"""Makers of random column layouts, motions and observations, shared by the tests of the kernel and of information."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.excitation.fourier import Excitation
from armid.kernel import ColumnLayout, Tree
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.motion import Motion
from trees import random_states

COMPILED = kernel.instruction_sets()[:-1]
"""Builds of the kernel that run here, without the NumPy twin."""

TWIN = kernel.instruction_sets()[-1]


def random_layout(rng: np.random.Generator, tree: Tree) -> ColumnLayout:
    """Some of the inertial parameters, and terms of which one stands in the rows of two joints."""
    n = tree.n
    inertial = np.full(10 * n, -1, dtype=np.int32)
    chosen = np.flatnonzero(rng.random(10 * n) < 0.6)
    inertial[chosen] = rng.permutation(len(chosen) + n)[: len(chosen)]
    free = np.setdiff1d(np.arange(len(chosen) + n), inertial)
    joints = rng.permutation(n)[: max(1, n - 1)]
    parameters = free[np.arange(len(joints))].astype(np.int32)
    parameters[rng.random(len(joints)) < 0.2] = -1
    if n > 1:
        joints, parameters = np.append(joints, [0, n - 1]), np.append(parameters, [free[-1]] * 2).astype(np.int32)
    return kernel.make_layout(tree, inertial, joints.astype(np.int32), parameters)


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that the streaming half of the kernel reads."""

    tree: Tree
    layout: ColumnLayout
    state: tuple[Array, Array, Array]
    torque: Array
    terms: Array

    @property
    def data(self) -> tuple[Tree, ColumnLayout, Array, Array, Array, Array, Array]:
        return (self.tree, self.layout, *self.state, self.torque, self.terms)

    def columns(self, build: str = TWIN) -> list[Array]:
        """Columns (width, N) of each joint."""
        x = kernel.columns(*self.data, chosen=build)
        return np.split(x, self.layout.offset[1:-1])


def random_problem(rng: np.random.Generator, tree: Tree, samples: int) -> Problem:
    layout = random_layout(rng, tree)
    torque, terms = rng.normal(size=(samples, tree.n)), rng.normal(size=(len(layout.kept), samples))
    return Problem(tree, layout, random_states(rng, samples, tree.n), torque, terms)


def lively_motion(rng: np.random.Generator, n: int, rate: float, seconds: float, harmonics: int = 6) -> Motion:
    """One period of a Fourier series that moves every joint."""
    a, b = rng.normal(0.0, 0.7, (2, n, harmonics))
    return Excitation(2 * np.pi / seconds, a, b, rng.uniform(-1.0, 1.0, n)).sample(rate)


def one_run(
    motion: Motion, torque: Array, rate: float, *, step: int = 1, offset: int = 0, block_rows: int = 50
) -> ObservedRun:
    """A run of which every row counts, in blocks of so many rows."""
    rows = len(range(offset, motion.samples, step))
    mask = np.ones((rows, motion.n), dtype=bool)
    return ObservedRun(motion, torque, rate, step, offset, mask, np.arange(rows) // block_rows)


def raw(*runs: ObservedRun) -> Observations:
    return Observations(runs, Band())

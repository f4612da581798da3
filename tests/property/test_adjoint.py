"""The adjoint of the columns: every build means what the twin says, and the twin is the derivative."""

from __future__ import annotations

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError
from problems import COMPILED, TWIN, random_layout
from trees import random_states, random_tree, structured_tree

TOLERANCE = 1e-12
"""Relative to the largest entry: two sweeps against differences of the regressor, a few thousand operations apart."""

DIFFERENCE = 1e-7
"""Central differences with a step of 1e-5 of sums of order one to a hundred."""


def problem(seed: int):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 12
    tree = (structured_tree if seed % 3 == 0 else random_tree)(rng, n)
    layout = random_layout(rng, tree)
    samples = (1, 8, 13, 7, 16)[seed % 5]  # less than a register, whole ones, and with a rest
    return tree, layout, random_states(rng, samples, n), rng.normal(size=(layout.columns, samples))


@pytest.mark.parametrize("seed", range(60))
def test_every_build_means_what_the_twin_says(seed: int):
    tree, layout, states, cotangent = problem(seed)
    expected = kernel.columns_adjoint(tree, layout, *states, cotangent, chosen=TWIN)
    for build in COMPILED:
        for found, wanted in zip(
            kernel.columns_adjoint(tree, layout, *states, cotangent, chosen=build), expected, strict=True
        ):
            assert found.shape == wanted.shape
            assert np.abs(found - wanted).max() <= TOLERANCE * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(12))
def test_it_is_the_derivative_of_the_columns(seed: int):
    tree, layout, states, cotangent = problem(seed)
    torque, terms = np.zeros_like(states[0]), np.zeros((len(layout.kept), len(states[0])))
    gradients = kernel.columns_adjoint(tree, layout, *states, cotangent)
    direction = np.random.default_rng(seed).normal(size=(3, *states[0].shape))
    step = 1e-5

    def value(scale: float) -> float:
        moved = [state + scale * way for state, way in zip(states, direction, strict=True)]
        made = kernel.columns(tree, layout, *moved, torque, terms)
        made[layout.term] = made[layout.offset[1:] - 1] = 0.0
        return float(np.sum(made * cotangent))

    expected = (value(step) - value(-step)) / (2.0 * step)
    found = sum(float(np.sum(g * d)) for g, d in zip(gradients, direction, strict=True))
    np.testing.assert_allclose(found, expected, rtol=DIFFERENCE, atol=DIFFERENCE * np.abs(cotangent).sum())


def information_problem(seed: int):
    """As above, with samples of more than one tile, weights, and the derivative of some function of G."""
    tree, layout, states, _ = problem(seed)
    rng = np.random.default_rng(100 + seed)
    samples = (1, 8, 13, 203, 450)[seed % 5]
    states = random_states(rng, samples, tree.n)
    count = 1 + max((int(p.max()) for p in layout.parameters if len(p)), default=0)
    slopes = rng.normal(size=(count, count))
    terms = rng.normal(size=(len(layout.kept), samples))
    return tree, layout, states, terms, rng.uniform(0.5, 2.0, tree.n), slopes + slopes.T


@pytest.mark.parametrize("seed", range(60))
def test_information_and_its_adjoint_mean_what_the_twins_say(seed: int):
    tree, layout, states, terms, weights, slopes = information_problem(seed)
    arguments = tree, layout, *states, terms, weights
    G = kernel.information(*arguments, len(slopes), chosen=TWIN)
    expected = kernel.information_adjoint(*arguments, slopes, chosen=TWIN)
    for build in COMPILED:
        found = kernel.information(*arguments, len(slopes), chosen=build)
        assert np.abs(found - G).max() <= TOLERANCE * max(1.0, np.abs(G).max())
        assert np.array_equal(found, found.T)
        for own, wanted in zip(kernel.information_adjoint(*arguments, slopes, chosen=build), expected, strict=True):
            assert own.shape == wanted.shape
            assert np.abs(own - wanted).max(initial=0.0) <= TOLERANCE * max(1.0, np.abs(wanted).max(initial=0.0))


def test_information_about_parameters_that_are_not_there_is_refused():
    tree, layout, states, terms, weights, slopes = information_problem(4)
    with pytest.raises(ValueError, match="a parameter that is not there"):
        kernel.information_adjoint(tree, layout, *states, terms, weights, slopes[:1, :1], chosen=COMPILED[0])


def test_a_cotangent_of_another_shape_is_refused():
    tree, layout, states, cotangent = problem(3)
    with pytest.raises(ArmidError, match="cotangent must have shape"):
        kernel.columns_adjoint(tree, layout, *states, cotangent[:-1])


def test_without_rigid_bodies_nothing_changes():
    tree, _, states, _ = problem(4)
    none = kernel.make_layout(tree, np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    found = kernel.columns_adjoint(tree, none, *states, np.ones((none.columns, len(states[0]))))
    assert all(not gradient.any() for gradient in found)

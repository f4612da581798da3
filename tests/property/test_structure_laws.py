"""Structural base parameters against the rank of random regressors, on trees of all sorts."""

from __future__ import annotations

import numpy as np
import pytest

from armid.kernel import reference
from armid.kernel.tree import Tree
from armid.model.structural_identifiability import echelon, parameter_units, structural_base
from trees import random_states, random_tree, structured_tree

RANK_GAP = (1e-7, 1e-11)
"""Singular values of unit columns over the largest: independent ones are above the first (2.7e-5 was the smallest in
1500 trees), dependent ones below the second (2.4e-13 was the largest)."""

REGROUPING = 1e-10
"""Y - Y[:, kept] · regrouping over the largest entry of Y. Rounding is 1e-16 times the largest coefficient, which
reaches 1e5 where a random axis comes close to being special."""

COEFFICIENT = 1e-12
"""Absolute, where the lengths and coefficients are of the order of one."""


def unit_columns(tree, seed):
    rng = np.random.default_rng(seed)
    Y = reference.regressor(tree, *random_states(rng, 60, tree.n)).reshape(-1, 10 * tree.n)
    Y = Y * parameter_units(tree)
    norms = np.linalg.norm(Y, axis=0)
    return Y / np.where(norms > 1e-12 * norms.max(), norms, 1.0)


def agree(tree, seed):
    """The numeric rank is the structural one and the null spaces are the same."""
    kept, regrouping = structural_base(tree)
    Y = unit_columns(tree, seed)
    sizes = np.append(np.linalg.svd(Y, compute_uv=False), 0.0) / np.linalg.norm(Y, 2)
    assert sizes[len(kept) - 1] > RANK_GAP[0]
    assert sizes[len(kept)] < RANK_GAP[1]
    # Equal rank, and what the regrouping does not see no torque sees: the null spaces agree.
    rng = np.random.default_rng(seed + 1)
    fresh = reference.regressor(tree, *random_states(rng, 5, tree.n))
    assert np.abs(fresh - fresh[:, :, kept] @ regrouping).max() <= REGROUPING * np.abs(fresh).max()
    assert np.array_equal(regrouping[:, kept], np.eye(len(kept)))


@pytest.mark.parametrize("seed", range(100))
def test_generic_trees(seed):
    rng = np.random.default_rng(seed)
    agree(random_tree(rng, 1 + seed % 10), seed)


@pytest.mark.parametrize("seed", range(160))
def test_structured_trees(seed):
    rng = np.random.default_rng(5000 + seed)
    tree = structured_tree(rng, 1 + seed % 12)
    agree(tree, seed)
    kept, _ = structural_base(tree)
    earliest, _ = echelon(unit_columns(tree, seed), 1e-8)
    assert np.array_equal(kept, earliest)


@pytest.mark.parametrize("seed", range(20))
def test_prismatic_and_revolute_chains_without_gravity(seed):
    rng = np.random.default_rng(9000 + seed)
    tree = structured_tree(rng, 2 + seed % 6, prismatic=float(seed % 2), branching=0.0)
    agree(Tree(tree.parent, tree.prismatic, tree.axis, tree.rotation, tree.translation, np.zeros(3)), seed)


@pytest.mark.parametrize("seed", range(40))
def test_rounding_in_the_geometry_changes_nothing(seed):
    rng = np.random.default_rng(7000 + seed)
    tree = structured_tree(rng, 1 + seed % 12)
    noisy = Tree(
        tree.parent,
        tree.prismatic,
        tree.axis,
        tree.rotation + 1e-15 * rng.normal(size=(tree.n, 3, 3)),
        tree.translation + 1e-15 * rng.normal(size=(tree.n, 3)),
        tree.gravity + 1e-15 * rng.normal(size=3) * np.any(tree.gravity),
    )
    kept, regrouping = structural_base(tree)
    noisy_kept, noisy_regrouping = structural_base(noisy)
    assert np.array_equal(kept, noisy_kept)
    assert noisy_regrouping == pytest.approx(regrouping, abs=COEFFICIENT)


@pytest.mark.parametrize("seed", range(30))
def test_small_but_real_features_count(seed):
    """Offsets and tilts of a thousandth are geometry, not rounding."""
    rng = np.random.default_rng(11000 + seed)
    n = 1 + seed % 8
    tree = structured_tree(rng, n)
    tilt = np.eye(3) + 1e-3 * np.cross(np.eye(3), rng.choice([-1.0, 0.0, 1.0], 3))
    exact = np.linalg.svd(tilt)
    rotation = tree.rotation @ (exact.U @ exact.Vh)
    translation = tree.translation + 1e-3 * rng.choice([-1.0, 0.0, 1.0], (n, 3))
    tilted = Tree(tree.parent, tree.prismatic, tree.axis, rotation, translation, tree.gravity)
    kept, _ = structural_base(tilted)
    Y = unit_columns(tilted, seed)
    assert np.linalg.matrix_rank(Y, tol=1e-11 * np.linalg.norm(Y, 2)) == len(kept)


@pytest.mark.parametrize("seed", range(20))
def test_the_unit_of_length_does_not_matter(seed):
    rng = np.random.default_rng(13000 + seed)
    tree = structured_tree(rng, 1 + seed % 8)
    millimetres = Tree(tree.parent, tree.prismatic, tree.axis, tree.rotation, 1000.0 * tree.translation, tree.gravity)
    kept, regrouping = structural_base(tree)
    other_kept, other = structural_base(millimetres)
    units = np.tile(np.repeat([1.0, 1e3, 1e6], [1, 3, 6]), tree.n)
    assert np.array_equal(kept, other_kept)
    assert other * units / units[kept, None] == pytest.approx(regrouping, abs=COEFFICIENT)

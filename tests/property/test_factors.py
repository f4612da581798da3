"""Triangular factors and decimation of streamed columns: exact sufficient statistics, however the rows are cut."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from armid import kernel
from armid.information.base_regressor_layout import column_source
from armid.kernel import ColumnLayout, unpack_factors
from armid.maths.linalg import condition
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from problems import COMPILED, TWIN, lively_motion, random_problem
from trees import iiwa_tree, random_tree, robot_of

ROUNDING = 1e-13
"""Error of an inner product of columns over the product of their lengths: a few hundred rows and reflections."""

SAMPLES = 450
"""More than two of the kernel's tiles of 192 samples."""

BOUNDS = (0, 0, 1, 3, 131, 131, 430, 449, 450)
"""Blocks that are empty, of one row, of fewer rows than columns, and longer than a tile."""


@pytest.fixture(params=range(6))
def problem(request):
    rng = np.random.default_rng(100 + request.param)
    return random_problem(rng, random_tree(rng, 1 + 2 * request.param, branching=0.3), SAMPLES)


def joints_of(problem, factors):
    return kernel.unpack_factors(problem.layout, factors)


def lengths(X):
    norms = np.linalg.norm(X, axis=1)
    return np.where(norms > 0.0, norms, 1.0)


def assert_factor(R, X, tolerance=ROUNDING):
    """R is a triangular factor of the rows of Xᵀ, each column by its own scale."""
    assert np.array_equal(np.tril(R, -1), np.zeros_like(R))
    scale = lengths(X)
    assert np.abs((R.T @ R - X @ X.T) / np.outer(scale, scale)).max() <= tolerance


@pytest.mark.parametrize("build", kernel.instruction_sets())
@pytest.mark.parametrize("by_gram", [False, True])
def test_factors_keep_all_products_of_columns(problem, build, by_gram):
    factors = kernel.factor(*problem.data, BOUNDS, by_gram=by_gram, chosen=build)
    for X, R in zip(problem.columns(build), joints_of(problem, factors), strict=True):
        assert len(R) == len(BOUNDS) - 1
        for k, (a, b) in enumerate(pairwise(BOUNDS)):
            assert_factor(R[k], X[:, a:b])


@pytest.mark.parametrize("build", COMPILED)
def test_samples_outside_the_bounds_do_not_count(problem, build):
    factors = kernel.factor(*problem.data, [40, 200], chosen=build)
    for X, R in zip(problem.columns(build), joints_of(problem, factors), strict=True):
        assert_factor(R[0], X[:, 40:200])


@pytest.mark.parametrize("build", kernel.instruction_sets())
@pytest.mark.parametrize("by_gram", [False, True])
def test_masked_rows_do_not_count(problem, build, by_gram):
    rng = np.random.default_rng(0)
    mask = rng.random((SAMPLES, problem.tree.n)) < 0.6
    mask[:, -1] = False
    factors = kernel.factor(*problem.data, BOUNDS, mask=mask, by_gram=by_gram, chosen=build)
    for j, (X, R) in enumerate(zip(problem.columns(build), joints_of(problem, factors), strict=True)):
        for k, (a, b) in enumerate(pairwise(BOUNDS)):
            assert_factor(R[k], X[:, a:b][:, mask[a:b, j]])
    assert not joints_of(problem, factors)[-1].any()


@pytest.mark.parametrize("build", COMPILED)
@pytest.mark.parametrize("by_gram", [False, True])
def test_threads_change_no_bit(problem, build, by_gram):
    one = kernel.factor(*problem.data, BOUNDS, by_gram=by_gram, chosen=build)
    for threads in (2, 3, 50):
        several = kernel.factor(*problem.data, BOUNDS, by_gram=by_gram, threads=threads, chosen=build)
        assert np.array_equal(one, several)


def tall_columns(rng, columns, rows):
    return rng.normal(size=(columns, rows))


@pytest.mark.parametrize("build", kernel.instruction_sets())
@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (1, 500), (5, 3), (6, 193), (7, 192), (23, 400), (64, 1000)])
def test_factor_of_columns_in_memory(build, columns, rows):
    X = tall_columns(np.random.default_rng(columns), columns, rows)
    assert_factor(kernel.factor_columns(X, chosen=build)[0], X)
    bounds = [0, rows // 3, rows // 3, rows]
    parts = kernel.factor_columns(X, bounds, chosen=build)
    for R, (a, b) in zip(parts, pairwise(bounds), strict=True):
        assert_factor(R, X[:, a:b])
    # The factor of stacked factors is a factor of all rows: what makes information mergeable.
    assert_factor(kernel.factor_columns(parts.reshape(-1, columns).T, chosen=build)[0], X)


@pytest.mark.parametrize("build", kernel.instruction_sets())
def test_columns_of_very_different_size(build):
    """Units differ by 1e8 and more; a small column must not drown in the rounding of a large one."""
    rng = np.random.default_rng(8)
    X = tall_columns(rng, 24, 500) * 10.0 ** rng.uniform(-8, 8, (24, 1))
    assert_factor(kernel.factor_columns(X, chosen=build)[0], X)
    scaled = kernel.factor_columns(X[:, :200] * 1e8, chosen=build)[0]
    plain = kernel.factor_columns(X[:, :200], chosen=build)[0]
    assert np.abs(scaled * 1e-8 - plain).max(axis=0) == pytest.approx(0.0, abs=ROUNDING * lengths(X).max())


@pytest.mark.parametrize("build", kernel.instruction_sets())
@pytest.mark.parametrize("by_gram", [False, True])
def test_terms_of_very_different_size(build, by_gram):
    rng = np.random.default_rng(9)
    problem = random_problem(rng, random_tree(rng, 5), SAMPLES)
    problem.terms[::2] *= 1e8
    problem.torque[:] *= 1e-8
    factors = kernel.factor(*problem.data, [0, SAMPLES], by_gram=by_gram, chosen=build)
    for X, R in zip(problem.columns(build), joints_of(problem, factors), strict=True):
        assert_factor(R[0], X)


@pytest.mark.parametrize("build", COMPILED)
@pytest.mark.parametrize("by_gram", [False, True])
def test_missing_rank_stays_missing(build, by_gram):
    """Two equal columns, a zero column and a torque that the columns explain wholly."""
    rng = np.random.default_rng(10)
    columns, rows = 6, 400
    tree = random_tree(rng, 1)
    joint = np.zeros(columns, dtype=np.int32)
    layout = kernel.make_layout(tree, np.empty(0, dtype=np.int32), joint, np.arange(columns, dtype=np.int32))
    terms = rng.normal(size=(columns, rows))
    terms[3] = terms[1]
    terms[4] = 0.0
    torque = (2.0 * terms[0] - terms[1] + 0.5 * terms[5])[:, None]
    nothing = np.zeros((rows, 1))
    data = (tree, layout, nothing, nothing, nothing, torque, terms)
    R = kernel.factor(*data, [0, rows], by_gram=by_gram, chosen=build)[0].reshape(columns + 1, columns + 1)
    assert_factor(R, np.vstack([terms, torque.T]))
    assert np.linalg.svd(R, compute_uv=False)[4:].max() <= (np.sqrt(ROUNDING) if by_gram else ROUNDING) * np.sqrt(
        rows
    )
    x, *_ = np.linalg.lstsq(R[:-1, :-1], R[:-1, -1], rcond=1e-9)
    assert x == pytest.approx([2.0, -0.5, 0.0, -0.5, 0.0, 0.5], abs=1e-12)


@pytest.mark.parametrize("build", COMPILED)
def test_a_block_of_zeros_gives_zeros(build):
    rng = np.random.default_rng(11)
    problem = random_problem(rng, random_tree(rng, 3), 200)
    mask = np.zeros((200, 3), dtype=bool)
    for by_gram in (False, True):
        assert not kernel.factor(*problem.data, [0, 100, 200], mask=mask, by_gram=by_gram, chosen=build).any()


@pytest.mark.parametrize("bounds", [[0], [0, 10, 5], [0, 21], [-1, 10]])
def test_bounds_that_do_not_rise_within_the_samples_are_refused(bounds):
    rng = np.random.default_rng(12)
    problem = random_problem(rng, random_tree(rng, 2), 20)
    for build in COMPILED:
        with pytest.raises(ValueError, match="bounds"):
            kernel.factor(*problem.data, bounds, chosen=build)
        with pytest.raises(ValueError, match="bounds"):
            kernel.factor_columns(np.zeros((3, 20)), bounds, chosen=build)


def test_a_layout_that_points_outside_is_refused():
    rng = np.random.default_rng(13)
    problem = random_problem(rng, random_tree(rng, 2), 20)
    good = problem.layout
    target, term = good.target.copy(), good.term.copy()
    target[np.argmax(target >= 0)] = 1000
    term[0] = good.columns
    for build in COMPILED:
        for bad in (
            ColumnLayout(good.offset, target, good.term, good.kept, good.parameters),
            ColumnLayout(good.offset, good.target, term, good.kept, good.parameters),
        ):
            with pytest.raises(ValueError, match="outside"):
                kernel.factor(problem.tree, bad, *problem.data[2:], [0, 20], chosen=build)


@pytest.mark.parametrize(("length", "step"), [(1, 1), (1, 7), (9, 3), (61, 10), (401, 10), (301, 97), (3, 50)])
def test_decimation(length, step):
    """Taps shorter and longer than a tile, gaps between rows, rows before, astride and behind the samples."""
    rng = np.random.default_rng(length)
    problem = random_problem(rng, random_tree(rng, 4), SAMPLES)
    taps = rng.normal(size=length)
    scale = np.abs(np.concatenate(problem.columns())).max() * np.abs(taps).sum()
    for first in (0, 5, -3, -length + 1, -length - 20, SAMPLES - 1, SAMPLES + 10, -(length // 2) - step):
        start = rng.normal(size=(problem.layout.columns, 40))
        expected = start.copy()
        kernel.decimate(*problem.data, taps, step, first, expected, chosen=TWIN)
        for build in COMPILED:
            out = start.copy()
            kernel.decimate(*problem.data, taps, step, first, out, chosen=build)
            assert np.abs(out - expected).max() <= ROUNDING * scale


def test_the_twin_decimates_as_it_says(problem):
    taps, step, first = np.array([0.25, 1.0, -0.5]), 4, -2
    out = np.zeros((problem.layout.columns, 80))
    kernel.decimate(*problem.data, taps, step, first, out, chosen=TWIN)
    x = np.concatenate(problem.columns())
    padded = np.concatenate([np.zeros((len(x), 2)), x, np.zeros((len(x), 400))], axis=1)
    for r in range(80):
        start = 2 + first + 4 * r
        assert out[:, r] == pytest.approx(padded[:, start : start + 3] @ taps, abs=1e-12)


@pytest.mark.parametrize("build", COMPILED)
def test_products_of_smooth_columns(build):
    """A second of smooth motion spans few directions; a factor without pivots loses half the digits there."""
    rng = np.random.default_rng(14)
    count, rows = 30, 1000
    t = np.linspace(0.0, 1.0, rows)
    terms = np.cos(np.outer(rng.uniform(0.0, 6.0, count), t) + rng.uniform(0.0, 6.0, (count, 1)))
    layout = kernel.make_layout(
        random_tree(rng, 1), np.empty(0, dtype=np.int32), np.zeros(count, dtype=np.int32), np.arange(count)
    )
    nothing, torque = np.zeros((rows, 1)), rng.normal(size=(rows, 1))
    data = (random_tree(rng, 1), layout, nothing, nothing, nothing, torque, terms)
    R = kernel.factor(*data, [0, rows], by_gram=True, chosen=build)[0].reshape(count + 1, count + 1)
    assert np.linalg.cond(terms) > 1e12
    assert_factor(R, np.vstack([terms, torque.T]))


CONDITION = 1e5
"""Condition number of poor but usable data: joints that hardly move."""

AT_CONDITION = 1e-10
"""Relative error of the estimate at that condition number: ε times it, and a factor of ten for the path there."""


@pytest.fixture(scope="module")
def poor_data():
    """Noise-free data of the iiwa 14, its joints 1, 3, 5 and 7 hardly moving, and the parameters they come from."""
    model = DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), Viscous(), Coulomb(width=0.3)))
    base = find_base_parameters(model)
    rng = np.random.default_rng(15)
    motion = lively_motion(rng, 7, 100.0, 20.0, harmonics=8)
    reach = np.where(np.arange(7) % 2 == 0, 0.025, 1.0)
    motion = Motion(motion.time, reach * motion.q, reach * motion.dq, reach * motion.ddq)
    Y = model.regressor(motion)[:, :, base.kept]
    truth = rng.normal(size=base.count)
    return column_source(model, base), motion, Y, truth


@pytest.mark.parametrize("build", COMPILED)
def test_streaming_qr_against_least_squares_at_condition_1e5(poor_data, build):
    source, motion, Y, truth = poor_data
    A = Y.reshape(-1, len(truth))
    assert CONDITION / 2 <= condition(A) <= CONDITION * 2
    data = (motion.q, motion.dq, motion.ddq, Y @ truth, source.term_rows(motion))
    bounds = np.linspace(0, motion.samples, 21).astype(np.int64)

    def estimate():
        factors = kernel.factor(source.tree, source.layout, *data, bounds, chosen=build)
        rows = []
        for parameters, R in zip(source.layout.parameters, unpack_factors(source.layout, factors), strict=True):
            wide = np.zeros((R.shape[0] * R.shape[1], len(truth) + 1))
            wide[:, [*parameters, len(truth)]] = R.reshape(-1, R.shape[2])
            rows.append(wide)
        R = np.concatenate(rows)
        return np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0]

    dense = np.linalg.lstsq(A, (Y @ truth).ravel(), rcond=None)[0]
    size = np.linalg.norm(truth)
    assert np.linalg.norm(dense - truth) <= AT_CONDITION * size
    assert np.linalg.norm(estimate() - truth) <= AT_CONDITION * size

"""Every build of the kernel solves the reweighted least squares of the NumPy twin, a fixed point of the weights."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError
from problems import COMPILED, TWIN

RULES = {"passes": 4, "settled": 1e-3, "floor": 1e-6, "ridge": 1e-9}

AGREEMENT = 1e-6
"""Cholesky's method against Gaussian elimination: ε times the largest condition number that the ridge allows, 1e9."""

SETTLED = 1e-9
"""Weighted least squares of rows against normal equations with a ridge of 1e-9, relative to parameters of about 1."""


def rows_of(rng, joints, count):
    """Columns of each joint with its torque last, parameters of the columns, and true parameters."""
    truth = rng.normal(size=count)
    own = [
        np.sort(rng.choice(count, rng.integers(1, count + 1), replace=False)).astype(np.int32) for _ in range(joints)
    ]
    noise = 10.0 ** rng.uniform(-3.0, 0.0, joints)
    samples = rng.integers(3 * count, 6 * count, joints)
    columns = [rng.normal(size=(len(p), m)) for p, m in zip(own, samples, strict=True)]
    tables = [
        np.vstack([x, truth[p] @ x + sigma * rng.normal(size=x.shape[1])])
        for p, x, sigma in zip(own, columns, noise, strict=True)
    ]
    return tables, own, samples.astype(float)


@pytest.mark.parametrize("seed", range(30))
def test_every_build_solves_the_same_equations(seed):
    rng = np.random.default_rng(seed)
    joints, count = int(rng.integers(1, 9)), int(rng.integers(1, 75))
    tables, own, samples = rows_of(rng, joints, count)
    products = [table @ table.T for table in tables]
    if seed % 3 == 0:  # a parameter without effect, and a joint without rows
        products[0][0] = products[0][:, 0] = 0.0
        products[-1] = np.zeros_like(products[-1])
    sign = rng.choice([-1.0, 1.0, 0.5], joints)
    x, sigma = kernel.reweighted_least_squares(products, own, count, samples, sign, chosen=TWIN, **RULES)
    for build in COMPILED:
        values, residuals = kernel.reweighted_least_squares(
            products, own, count, samples, sign, chosen=build, **RULES
        )
        np.testing.assert_allclose(values, x, atol=AGREEMENT * max(1.0, np.abs(x).max()))
        np.testing.assert_allclose(residuals, sigma, rtol=AGREEMENT)


@pytest.mark.parametrize("build", [*COMPILED, TWIN])
def test_settled_parameters_are_those_of_rows_weighted_by_their_residuals(build):
    tables, own, samples = rows_of(np.random.default_rng(1), 5, 12)
    products = [table @ table.T for table in tables]
    rules = RULES | {"passes": 100, "settled": 1e-12, "ridge": 1e-14}
    x, sigma = kernel.reweighted_least_squares(products, own, 12, samples, chosen=build, **rules)
    A, y = [], []
    for table, p, s, m in zip(tables, own, sigma, samples, strict=True):
        wide = np.zeros((table.shape[1], 12))
        wide[:, p] = table[:-1].T
        A.append(wide / s)
        y.append(table[-1] / s)
        np.testing.assert_allclose(np.sqrt(np.sum((table[-1] - x[p] @ table[:-1]) ** 2) / m), s, rtol=SETTLED)
    np.testing.assert_allclose(np.linalg.lstsq(np.vstack(A), np.concatenate(y))[0], x, atol=SETTLED)


@pytest.mark.parametrize("build", COMPILED)
def test_threads_get_the_results_of_calls_one_after_the_other(build):
    """The interpreter is unlocked during the solution, so nothing of a call may be shared with another."""
    calls = []
    for seed in range(4):
        tables, own, samples = rows_of(np.random.default_rng(seed), 7, 70)
        calls.append(([table @ table.T for table in tables], own, 70, samples))

    def solve(call):
        return np.concatenate(kernel.reweighted_least_squares(*call, chosen=build, **RULES))

    with ThreadPoolExecutor(len(calls)) as pool:
        together = list(pool.map(solve, calls * 25))
    for found, alone in zip(together, [solve(call) for call in calls] * 25, strict=True):
        assert np.array_equal(found, alone)


@pytest.mark.parametrize("build", [*COMPILED, TWIN])
@pytest.mark.parametrize("at", [0, -1])  # a column, and the torque
def test_what_is_not_a_number_has_no_residual(build, at):
    tables, own, samples = rows_of(np.random.default_rng(2), 3, 5)
    products = [table @ table.T for table in tables]
    products[1][at] = products[1][:, at] = np.nan
    _, sigma = kernel.reweighted_least_squares(products, own, 5, samples, chosen=build, **RULES)
    assert np.isnan(sigma[1])


@pytest.mark.parametrize("build", [*COMPILED, TWIN])
@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"parameters": [np.arange(3, dtype=np.int32)]}, "Expected products"),
        ({"parameters": [np.array([1, 0], dtype=np.int32)]}, "ascending order"),
        ({"parameters": [np.array([0, 2], dtype=np.int32)]}, "ascending order"),
        ({"rows": [0.0]}, "rows of every joint must be positive"),
        ({"passes": 0}, "`passes`"),
        ({"ridge": 0.0}, "`ridge`"),
    ],
)
def test_what_cannot_be_solved_is_refused(build, changed, reason):
    given = {"products": [np.eye(3)], "parameters": [np.arange(2, dtype=np.int32)], "count": 2, "rows": [5.0]}
    with pytest.raises(ArmidError, match=reason):
        kernel.reweighted_least_squares(**(given | RULES | {"chosen": build} | changed))

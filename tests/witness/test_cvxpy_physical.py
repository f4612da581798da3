"""The convex estimates against another modelling language and other solvers, written down once more from
scratch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armid.estimation.consistency.additional_constraints import Requirements
from armid.estimation.consistency.consistent_fit import ConsistentProgram
from armid.estimation.estimators.log_cholesky import LogCholesky
from armid.estimation.prior import LENGTH, MASS, make_prior
from armid.estimation.problem import EstimationProblem, StandardParameters, standard_of
from armid.estimation.whitened_system import WhitenedSystem, whiten
from armid.information.accumulate import accumulate_information
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, RotorInertia, Viscous
from armid.robot import load_robot
from labs import URDF
from problems import lively_motion, one_run, raw

cp: Any = pytest.importorskip("cvxpy")

RATE, NOISE, EPSILON = 50.0, 0.5, 1e-6

SAME = 1e-6
"""Relative difference of two solvers' objectives."""

SYMBOLS = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> EstimationProblem:
    path = tmp_path_factory.mktemp("arm") / "small.urdf"
    path.write_text(URDF)
    robot = load_robot(path)
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.02), RotorInertia()))
    base = find_base_parameters(model)
    truth = model.nominal_parameters()
    assert truth is not None
    truth = truth.copy()
    truth[model.law_columns] = np.resize([1.0, 0.05, 0.0], len(model.law_columns))  # some at their bounds
    motion = lively_motion(np.random.default_rng(1), robot.n, RATE, 10.0)
    torque = model.torque(motion, truth) + NOISE * np.random.default_rng(2).normal(size=motion.q.shape)
    return EstimationProblem(
        accumulate_information(model, base, raw(one_run(motion, torque, RATE))), standard_of(model, base)
    )


def pseudo(theta: Any, at: dict[str, int]) -> Any:
    """Pseudo-inertia from its definition: second moments from the moments of inertia, row by row."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = (theta[at[s]] for s in SYMBOLS)
    rows = [
        [0.5 * (yy + zz - xx), -xy, -xz, x],
        [-xy, 0.5 * (xx + zz - yy), -yz, y],
        [-xz, -yz, 0.5 * (xx + yy - zz), z],
        [x, y, z, m],
    ]
    return cp.bmat(rows)


def written_again(standard: StandardParameters, weighted: WhitenedSystem, kind: str, weight: float) -> Any:
    """The same program in cvxpy."""
    theta = cp.Variable(len(standard.names))
    belief = make_prior(kind, standard, weighted)
    cost = 0.5 * cp.sum_squares(weighted.rows @ (standard.regrouping @ theta - weighted.values))
    kept = [theta[k] >= 0.0 for k in np.flatnonzero(standard.nonnegative)]
    if kind == "euclidean":
        root = np.sqrt(np.diag(belief.precision))
        inertial = np.isin(np.arange(len(root)), standard.inertial)
        root = np.sqrt(np.where(inertial, weight, 1.0)) * root
        cost += 0.5 * cp.sum_squares(cp.multiply(root, theta - belief.mean))
    else:
        others = [k for k, name in enumerate(standard.names) if name.split("_")[0] not in SYMBOLS]
        root = np.sqrt(np.diag(belief.precision)[others])
        cost += 0.5 * cp.sum_squares(cp.multiply(root, theta[others]))
    for link in range(len(standard.inertial)):
        at = {s: standard.names.index(f"{s}_{link + 1}") for s in SYMBOLS}
        J = pseudo(theta, at)
        kept.append(J >> EPSILON * np.eye(4))
        if kind == "mass":
            cost += weight / MASS * (J[3, 3] + (J[0, 0] + J[1, 1] + J[2, 2]) / LENGTH**2)
        if kind == "log-det":
            assert standard.nominal is not None
            nominal = np.array(pseudo(cp.Constant(standard.nominal), at).value)
            inverse = np.linalg.inv(nominal)
            divergence = cp.trace(inverse @ J) - cp.log_det(J) + np.linalg.slogdet(nominal)[1] - 4.0
            cost += weight * divergence
    return cp.Problem(cp.Minimize(cost), kept)


# Clarabel solves the first two here, so that others check them; Newton's method of our own the third.
@pytest.mark.parametrize(
    ("kind", "weight", "solver"),
    [("mass", 1.0, "SCS"), ("mass", 1.0, "CVXOPT"), ("euclidean", 3.0, "SCS"), ("log-det", 0.3, "CLARABEL")],
)
def test_objectives_agree(problem: EstimationProblem, kind: str, weight: float, solver: str):
    if solver not in cp.installed_solvers():
        pytest.skip(f"cvxpy has no {solver} here")
    standard = problem.require_standard("physical")
    weighted = whiten(problem.information)
    belief = make_prior(kind, standard, weighted)
    ours = ConsistentProgram(standard, Requirements(EPSILON), kind, belief).solve(
        weighted.rows, weighted.rows @ weighted.values, weight
    )
    again = written_again(standard, weighted, kind, weight)
    options = {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iters": 100_000} if solver == "SCS" else {}
    again.solve(solver=solver, **options)
    assert again.status == "optimal"
    assert ours.objective == pytest.approx(again.value, rel=SAME)


def test_a_search_without_cones_ends_at_the_same_objective(problem: EstimationProblem):
    """Log-Cholesky factors against the cone, which asks for a little more than they do: eigenvalues above zero."""
    standard = problem.require_standard("physical")
    weighted = whiten(problem.information)
    belief = make_prior("mass", standard, weighted)
    program = ConsistentProgram(standard, Requirements(1e-9), "mass", belief, weighted.correlation)
    convex = program.solve(weighted.rows, weighted.rows @ weighted.values, 1.0).objective
    fit = LogCholesky().solve(problem)
    (said,) = [finding.evidence for finding in fit.findings if finding.code == "local-search"]
    ends = [float(word.strip(",;")) for word in said.split("objective values ")[1].split(";")[0].split()]
    assert len(ends) == LogCholesky().starts
    np.testing.assert_allclose(ends, convex, rtol=1e-4)  # where they stop, not where they would end

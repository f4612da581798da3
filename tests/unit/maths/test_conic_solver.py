"""Conic programs whose minimum is only approached, and settings that fail."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from armid.errors import UnsolvedError
from armid.maths import conic_solver
from armid.maths.conic_solver import Cone, ConeSolution, solve_cones

FAILING = {"max_iter": 1}
"""No program is solved in one iteration."""


def approached() -> ConeSolution:
    """Solution of: minimise t so that the matrix (x, 1; 1, t) is positive semidefinite, which t = 1 / x → 0 is."""
    matrix = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    return solve_cones(np.array([0.0, 1.0]), [Cone("semidefinite", matrix, np.array([0.0, 1.0, 0.0]))])


def test_a_minimum_that_is_only_approached_is_solved():
    found = approached()
    assert max(found.gap, found.violation) <= conic_solver.ACCEPTED
    assert 0.0 <= found.objective < 1e-3


def test_settings_that_fail_are_followed_by_others(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(conic_solver, "SETTINGS", (FAILING, {}))
    assert approached().objective < 1e-3
    monkeypatch.setattr(conic_solver, "SETTINGS", (FAILING,))
    with pytest.raises(UnsolvedError, match="found no solution"):
        approached()


def test_the_solver_loads_no_more_of_scipy_than_its_functions_of_lapack():
    """The package `scipy.linalg` is not imported for them, and works when it is imported afterwards."""
    script = """
import sys
import numpy as np
from armid.maths.conic_solver import Cone, solve_cones
matrix = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
solve_cones(np.array([1.0, 1.0]), [Cone("semidefinite", matrix, np.array([0.0, 1.0, 0.0]))])
before = "scipy.linalg" in sys.modules
import scipy.linalg
print(before, np.allclose(scipy.linalg.lapack.dpotrf(np.eye(2) * 4.0)[0], np.eye(2) * 2.0))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]

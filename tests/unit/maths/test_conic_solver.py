"""Conic programs whose minimum is only approached, and settings that fail."""

from __future__ import annotations

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

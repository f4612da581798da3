"""Functions as SymPy expressions, where SymPy is installed."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from armid.codegen.sympy_functions import make_symbolic
from armid.errors import MissingExtraError
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody, Viscous
from armid.robot import load_robot
from coded import case
from trees import chain, robot_of


def test_without_sympy_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    each = case("ur5e")
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(MissingExtraError, match=r"armid\[symbolic\]"):
        make_symbolic(each.model, each.base, "gravity_torque")


@pytest.mark.parametrize(
    ("name", "geometry", "function"),
    [
        ("ur5e", True, "inverse_dynamics"),
        ("ur5e", True, "mass_matrix"),
        ("tree-2", False, "inverse_dynamics"),
        ("tree-1", True, "gravity_torque"),
        ("every-term", False, "friction"),
    ],
)
def test_expressions_have_the_values_of_the_model(name: str, geometry: bool, function: str):
    sympy = pytest.importorskip("sympy")
    each = case(name)
    k, motion = each.known, each.motion
    given = {"parameters": each.values, "q": motion.q[k], "dq": motion.dq[k], "ddq": motion.ddq[k]}
    if motion.memory is not None:
        given["state"] = motion.memory[k]
    symbolic = make_symbolic(each.model, each.base, function, geometry=geometry)
    assert bool(symbolic.geometry) == geometry
    arguments = [x for symbols in symbolic.inputs.values() for x in symbols] + list(symbolic.geometry)
    numbers = [x for key in symbolic.inputs for x in given[key]] + list(symbolic.geometry.values())
    scope: dict[str, object] = {"math": math, **dict(zip(map(str, arguments), numbers, strict=True))}
    for shared, expression in symbolic.definitions:
        exec(f"{shared} = {sympy.pycode(expression)}", scope)
    found = np.array([eval(sympy.pycode(x), scope) for x in symbolic.result])
    expected = each.expected[function][k]
    np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=1e-11 * np.abs(expected).max())


def test_a_pendulum_reads_as_in_a_book():
    sympy = pytest.importorskip("sympy")
    up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # z of the joint lies level
    model = DynamicsModel(robot_of(chain("R", [up], [[0.0, 0.0, 0.4]], [0.0, 0.0, -9.81])), (RigidBody(), Viscous()))
    base = find_base_parameters(model)
    symbolic = make_symbolic(model, base, "inverse_dynamics")
    MX, MY, ZZ, FV, q, dq, ddq, gz = sympy.symbols("MX_1 MY_1 ZZ_1 FV_1 q1 dq1 ddq1 gz", real=True)
    expected = ZZ * ddq + FV * dq - gz * (MX * sympy.cos(q) - MY * sympy.sin(q))
    assert sympy.simplify(symbolic.expanded()[0] - expected) == 0
    assert {str(key): value for key, value in symbolic.geometry.items()} == {"gz": -9.81, "d1z": 0.4}


def test_lengths_are_symbols():
    pytest.importorskip("sympy")
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(),))
    symbolic = make_symbolic(model, find_base_parameters(model), "gravity_torque")
    lengths = {str(key): value for key, value in symbolic.geometry.items()}
    assert lengths["gz"] == -9.81 and 0.2155 in np.round(list(lengths.values()), 12)
    read = set().union(*(expression.free_symbols for _, expression in symbolic.definitions))
    assert {str(x) for x in read} & set(lengths)

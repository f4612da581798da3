"""Base parameters as the field writes them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armid.maths.rotations import rotation_x
from armid.model.base_formulas import base_formulas, base_record, column_formulas
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from trees import chain, robot_of

NAMES = ("M_1", "MX_1", "MZ_1", "M_2", "MZ_2", "M_12")


def base_of(kept, rows):
    return BaseParameters(NAMES, ("kg", "kg·m", "kg·m", "kg", "kg·m", "kg"), kept, rows, [0.0, 0.0, -9.81])


def test_own_first_then_ones_then_equal_coefficients_together():
    base = base_of([1], [[0.0, 1.0, -1.0, 0.1 + 0.2, 1.0, 0.3]])
    assert base_formulas(base) == ("MXR_1 = MX_1 - MZ_1 + MZ_2 + 0.3 (M_2 + M_12)",)
    assert base_formulas(base, "latex") == (r"MXR_{1} = MX_{1} - MZ_{1} + MZ_{2} + 0.3\,(M_{2} + M_{12})",)


def test_opposite_coefficients_stand_apart():
    base = base_of([1], [[0.42, 1.0, -0.42, -0.42, 0.0, 0.0]])
    assert base_formulas(base) == ("MXR_1 = MX_1 + 0.42 M_1 - 0.42 (MZ_1 + M_2)",)


def test_columns_of_removed_parameters():
    base = base_of([1, 3], [[0.0, 1.0, -1.0, 0.0, 0.25, 1e-5], [0.0, 0.0, 1.0, 1.0, -0.5, -0.5]])
    assert column_formulas(base) == (
        "Y_{M_1} = 0",
        "Y_{MZ_1} = -Y_{MX_1} + Y_{M_2}",
        "Y_{MZ_2} = 0.25 Y_{MX_1} - 0.5 Y_{M_2}",
        "Y_{M_12} = 1e-05 Y_{MX_1} - 0.5 Y_{M_2}",
    )
    assert column_formulas(base, "latex")[3] == r"Y_{M_{12}} = 1 \cdot 10^{-5}\,Y_{MX_{1}} - 0.5\,Y_{M_{2}}"


def test_an_ungrouped_parameter_keeps_its_name():
    assert base_formulas(base_of([3], [[0, 0, 0, 1.0, 0, 0]])) == ("M_2 = M_2",)


@pytest.mark.parametrize(
    ("coefficient", "printed"),
    [
        (0.2045**2, "0.04182025"),
        (0.2045 + 0.2155, "0.42"),
        (2.0, "2"),
        (np.sqrt(0.5), "0.70710678119"),
        (123456.0, "123456"),
        (1.0 + 2e-16, None),
    ],
)
def test_numbers_print_as_what_they_stand_for(coefficient, printed):
    (formula,) = base_formulas(base_of([1], [[coefficient, 1.0, 0, 0, 0, 0]]))
    assert formula == ("MXR_1 = MX_1 + M_1" if printed is None else f"MXR_1 = MX_1 + {printed} M_1")


def test_record_holds_the_contract():
    tree = chain("RR", [np.eye(3), rotation_x(np.pi / 2)], [[0, 0, 0], [0, 0, 0.3]], [0, 0, -9.81])
    base = find_base_parameters(DynamicsModel(robot_of(tree), (RigidBody(),)))
    record = json.loads(json.dumps(base_record(base), allow_nan=False))
    assert record["count"] == len(record["base"]) == base.count
    assert set(record) == {"count", "zero_columns", "removed", "dependencies", "base"}
    assert record["base"][0] == {
        "name": "ZZR_1",
        "unit": "kg·m²",
        "grouping": {"ZZ_1": 1.0, "YY_2": 1.0},
        "formula": "ZZR_1 = ZZ_1 + YY_2",
    }
    assert record["dependencies"]["YY_2"] == {"ZZ_1": 1.0, "XX_2": -1.0}
    assert record["dependencies"]["M_1"] == {}
    assert set(record["zero_columns"]) <= set(record["removed"])
    assert len(record["removed"]) + record["count"] == 20

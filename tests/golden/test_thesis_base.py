"""Base parameters of the thesis: (3.33), (3.38), (3.39), appendix (A.1) as corrected, Table 4.2.

`data/truth.json` holds numbers derived from the thesis independently of armid.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.maths.inertia import com_inertia_to_vector
from armid.model.base_formulas import base_formulas, base_record, column_formulas
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from trees import iiwa_tree, robot_of

TRUTH = json.loads((Path(__file__).parent / "data" / "truth.json").read_text())

COEFFICIENT = 1e-12
"""Sums and products of a few lengths of the order of one."""

TABLE = 1e-4
"""Table 4.2 carried to base parameters; the reference was rounded nowhere, so this is ample."""

ZERO_COLUMNS = "M_1 MX_1 MY_1 MZ_1 XX_1 XY_1 XZ_1 YY_1 YZ_1 M_2 MZ_2".split()

COLUMNS = """
Y_{YY_2} = Y_{ZZ_1} - Y_{XX_2}
Y_{M_3} = 0.2045 Y_{MY_2} + 0.04182025 (Y_{XX_2} + Y_{ZZ_2})
Y_{MZ_3} = Y_{MY_2} + 0.409 (Y_{XX_2} + Y_{ZZ_2})
Y_{YY_3} = Y_{XX_2} + Y_{ZZ_2} - Y_{XX_3}
Y_{M_4} = 0.42 Y_{MY_2} + 0.1764 (Y_{XX_2} + Y_{ZZ_2})
Y_{MZ_4} = -Y_{MY_3} + 0.2155 Y_{YZ_3}
Y_{YY_4} = Y_{XX_3} + Y_{ZZ_3} - Y_{XX_4}
""".strip().splitlines()


@pytest.fixture(scope="module")
def base():
    return find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), Viscous(), Coulomb(0.0))))


def row_of(base, combination):
    row = np.zeros(len(base.standard_names))
    for name, value in combination.items():
        row[base.standard_names.index(name)] = value
    return row


def test_57_names_in_order(base):
    assert base.count == 57
    assert list(base.names) == TRUTH["base_names"]


def test_zero_columns(base):
    assert sorted(base.standard_names[k] for k in base.zero_columns) == sorted(ZERO_COLUMNS)


def test_removed_of_3_33(base):
    links = range(3, 8)
    removed = [*ZERO_COLUMNS, "YY_2", *(f"{s}_{i}" for i in links for s in ("M", "MZ", "YY"))]
    assert len(removed) == 27
    assert sorted(base.standard_names[k] for k in base.removed) == sorted(removed)


def test_groupings_of_3_39(base):
    expected = np.zeros_like(base.regrouping)
    for name, standard, coefficient in TRUTH["B_nonzeros"]:
        expected[base.names.index(name), base.standard_names.index(standard)] = coefficient
    assert np.array_equal(base.regrouping != 0.0, expected != 0.0)
    assert base.regrouping == pytest.approx(expected, abs=COEFFICIENT)
    assert sum(np.count_nonzero(row) > 1 for row in base.regrouping) == 19


def test_dependencies_of_a_1(base):
    """The list as it should read, link by link (`d` of Table 3.1)."""
    d1, d2, d3, d4, d5, d6, d7 = TRUTH["d"]
    del d1, d2

    def arm(y, link):
        return {f"MY_{link}": y, f"XX_{link}": y * y, f"ZZ_{link}": y * y}

    expected = {name: {} for name in ZERO_COLUMNS} | {
        "YY_2": {"ZZ_1": 1.0, "XX_2": -1.0},
        "M_3": arm(d3, 2),
        "M_4": arm(d3 + d4, 2),
        "M_5": arm(d3 + d4, 2) | arm(d5, 4),
        "M_6": arm(d3 + d4, 2) | arm(d5 + d6, 4),
        "M_7": arm(d3 + d4, 2) | arm(d5 + d6, 4) | arm(d7, 6),
        "MZ_3": {"MY_2": 1.0, "XX_2": 2 * d3, "ZZ_2": 2 * d3},
        "MZ_4": {"MY_3": -1.0, "YZ_3": d4},
        "MZ_5": {"MY_4": 1.0, "XX_4": 2 * d5, "ZZ_4": 2 * d5},
        "MZ_6": {"MY_5": -1.0, "YZ_5": d6},
        "MZ_7": {"MY_6": 1.0, "XX_6": 2 * d7, "ZZ_6": 2 * d7},
    }
    for i in range(3, 8):
        expected[f"YY_{i}"] = {f"XX_{i - 1}": 1.0, f"ZZ_{i - 1}": 1.0, f"XX_{i}": -1.0}
    found = base_record(base)["dependencies"]
    assert set(found) == set(expected)
    for name, combination in expected.items():
        assert found[name] == pytest.approx(combination, abs=COEFFICIENT), name


def test_as_printed(base):
    formulas = base_formulas(base)
    assert formulas[0] == "ZZR_1 = ZZ_1 + YY_2"
    assert "MYR_2 = MY_2 + MZ_3 + 0.2045 M_3 + 0.42 (M_4 + M_5 + M_6 + M_7)" in formulas
    assert "MYR_3 = MY_3 - MZ_4" in formulas
    assert "XXR_7 = XX_7 - YY_7" in formulas
    assert [line for line in column_formulas(base) if not line.endswith("= 0")][:7] == COLUMNS
    assert r"MYR_{4} = MY_{4} + MZ_{5} + 0.1845\,M_{5} + 0.4\,(M_{6} + M_{7})" in base_formulas(base, "latex")


def test_table_4_2_carried_to_base_parameters(base):
    combination = {}
    for i, (m, rx, ry, rz, xx, xy, xz, yy, yz, zz, fv, fs) in enumerate(TRUTH["table42_mu"], 1):
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = com_inertia_to_vector(m, np.array([rx, ry, rz]), tensor)
        symbols = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ", "FV", "FS")
        combination |= {f"{s}_{i}": v for s, v in zip(symbols, (*body, fv, fs), strict=True)}
    values = base.values_of(row_of(base, combination))
    assert dict(zip(base.names, values, strict=True)) == pytest.approx(TRUTH["table42_pi_b"], abs=TABLE)

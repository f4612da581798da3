"""Numbers of base inertial parameters that textbooks give, and the echelon form."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.rotations import rotation_x
from armid.model.structural_identifiability import clean, echelon, parameter_units, structural_base
from trees import chain, iiwa_tree

SYMBOLS = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
DOWN = [0.0, 0.0, -9.81]
LEVEL = [0.0, -9.81, 0.0]
ONE = np.eye(3)


def kept_names(tree):
    return [f"{SYMBOLS[k % 10]}_{k // 10 + 1}" for k in structural_base(tree)[0]]


def quarter(sign):
    return rotation_x(sign * np.pi / 2)


def test_pendulum():
    assert kept_names(chain("R", [ONE], [[0, 0, 0.3]], LEVEL)) == ["MX_1", "MY_1", "ZZ_1"]


def test_turntable():
    assert kept_names(chain("R", [ONE], [[0.1, 0, 0.3]], DOWN)) == ["ZZ_1"]


@pytest.mark.parametrize("gravity", [DOWN, LEVEL, [0.0, 0.0, 0.0]])
def test_slide(gravity):
    assert kept_names(chain("P", [ONE], [[0, 0, 0.3]], gravity)) == ["M_1"]


def test_planar_arm_upright():
    tree = chain("RR", [ONE, ONE], [[0, 0, 0], [0.5, 0, 0]], LEVEL)
    assert kept_names(tree) == ["MX_1", "MY_1", "ZZ_1", "MX_2", "MY_2", "ZZ_2"]
    _, regrouping = structural_base(tree)
    assert regrouping[0, 10] == 0.5
    assert regrouping[2, 10] == 0.25


def test_planar_arm_lying():
    assert kept_names(chain("RR", [ONE, ONE], [[0, 0, 0], [0.5, 0, 0]], DOWN)) == ["ZZ_1", "MX_2", "MY_2", "ZZ_2"]


def test_scara():
    tree = chain("RRPR", [ONE] * 4, [[0, 0, 0.2], [0.3, 0, 0], [0.25, 0, 0], [0, 0, 0]], DOWN)
    assert kept_names(tree) == ["ZZ_1", "MX_2", "MY_2", "ZZ_2", "M_3", "MX_4", "MY_4", "ZZ_4"]


def test_gantry():
    cycle = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    tree = chain("PPP", [cycle] * 3, [[0, 0, 0]] * 3, DOWN)
    assert kept_names(tree) == ["M_1", "M_2", "M_3"]
    _, regrouping = structural_base(tree)
    assert np.count_nonzero(regrouping) == 3


def test_puma_has_36():
    """The PUMA 560 [Gautier1990, Mayeda1990], modified Denavit-Hartenberg."""
    rotations = [ONE, quarter(-1), ONE, quarter(-1), quarter(1), quarter(-1)]
    offsets = [[0, 0, 0], [0, 0.2435, 0], [0.4318, 0, -0.0934], [-0.0203, 0.4331, 0], [0, 0, 0], [0, 0, 0]]
    assert len(kept_names(chain("RRRRRR", rotations, offsets, DOWN))) == 36


def test_iiwa_has_43_under_any_sign_of_gravity():
    up, down = structural_base(iiwa_tree((0, 0, 9.81))), structural_base(iiwa_tree((0, 0, -9.81)))
    assert len(up[0]) == 43
    assert np.array_equal(up[0], down[0])
    assert up[1] == pytest.approx(down[1], abs=1e-14)


def test_a_tilted_base_shows_more_of_the_first_link():
    assert len(structural_base(iiwa_tree((0, 6.0, 7.0)))[0]) == 45


def test_echelon_keeps_the_earliest():
    a, b = np.array([1.0, 2.0, 0.0]), np.array([0.0, 1.0, 1.0])
    matrix = np.column_stack([0 * a, a, -3 * a, b, 2 * a + 0.5 * b])
    kept, E = echelon(matrix, 1e-9)
    assert kept.tolist() == [1, 3]
    assert pytest.approx(matrix, abs=1e-14) == matrix[:, kept] @ E
    assert E[0, 3] == 0.0
    assert E[1, 2] == 0.0


def test_echelon_passes_over_columns_that_barely_stand_off():
    matrix = np.array([[1.0, 1.0, 0.0], [0.0, 1e-6, 1.0]])
    assert echelon(matrix, 1e-9)[0].tolist() == [0, 2]
    assert echelon(matrix[:, :2], 1e-9)[0].tolist() == [0, 1]


def test_clean_keeps_small_coefficients():
    assert np.array_equal(clean(np.array([[1.0, 2e-16, 1e-9]])), [[1.0, 0.0, 1e-9]])
    assert np.array_equal(clean(np.array([[1e5, 1e-10, 1e-8]])), [[1e5, 0.0, 1e-8]])


def test_units_scale_by_a_power_of_two():
    units = parameter_units(chain("R", [ONE], [[0, 0, 0.3]], DOWN))
    assert units.tolist() == [1.0] + [0.5] * 3 + [0.25] * 6

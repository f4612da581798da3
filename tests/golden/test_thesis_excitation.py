"""The excitation of the thesis: Tables A.1 and A.2, what they ask of the arm, and the information they give.

`data/` holds the tables and numbers derived from the thesis independently of armid. Rows are t = 0 … T - 10 ms at
100 Hz, terms rigid bodies, viscous and Coulomb friction of width zero.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.excitation.fourier import load_plan
from armid.information.accumulate import accumulate_information
from armid.information.information import stack, total
from armid.maths.linalg import condition, scaled_condition
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from problems import one_run, raw

DATA = Path(__file__).parent / "data"
TRUTH = json.loads((DATA / "truth.json").read_text())
RATE = 100.0

TORQUE = 1e-9
"""The reference goes through the URDF, whose π has eleven digits."""

CONDITION = 0.01
"""Condition numbers were printed with two digits after the point."""

HANGING, LITERAL = (0.0, 0.0, 9.81), (0.0, 0.0, -9.81)
"""Gravity as an acceleration in the base of the hanging arm, and as the sign of the thesis's equations has it."""


class Arm:
    """The iiwa 14 under one gravity, and its excitations."""

    def __init__(self, gravity):
        robot = load_robot("iiwa14-r820", gravity=gravity)
        self.model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.0)))
        self.base = find_base_parameters(self.model)

    def rows(self, seconds, table="a1"):
        """Base regressor (N, 7, 57) along a table stretched to so many seconds."""
        motion = plan(table).stretched(seconds).sample(RATE)
        assert motion.samples == round(RATE * seconds)
        return self.model.regressor(motion)[:, :, self.base.kept]

    def torque(self, motion, values):
        """Torque (N, 7) for base parameters by name."""
        return self.model.regressor(motion)[:, :, self.base.kept] @ [values[name] for name in self.base.names]


def plan(table):
    return load_plan(DATA / f"table_{table}.json")


@pytest.fixture(scope="module")
def arms():
    return {gravity: Arm(gravity) for gravity in (HANGING, LITERAL)}


@pytest.mark.parametrize(
    ("gravity", "seconds", "plain", "scaled"),
    [
        (HANGING, 20.0, 63.22, 9.065),
        (HANGING, 27.0, 113.68, 9.131),
        (LITERAL, 20.0, 67.57, None),
        (LITERAL, 27.0, 118.16, None),
    ],
)
def test_condition_numbers(arms, gravity, seconds, plain, scaled):
    A = arms[gravity].rows(seconds).reshape(-1, 57)
    assert condition(A) == pytest.approx(plain, abs=CONDITION)
    if scaled is not None:
        assert scaled_condition(A) == pytest.approx(scaled, abs=CONDITION / 10)


@pytest.mark.parametrize("gravity", [HANGING, LITERAL])
@pytest.mark.parametrize("seconds", [20.0, 27.0])
def test_condition_numbers_in_full_from_the_factors_alone(arms, gravity, seconds):
    arm = arms[gravity]
    motion = plan("a1").stretched(seconds).sample(RATE)
    A, _ = stack(
        total(accumulate_information(arm.model, arm.base, raw(one_run(motion, np.zeros_like(motion.q), RATE))))
    )
    expected = TRUTH["cond"][f"T{seconds:.0f}_g{gravity[2]:g}"]
    # The reference's geometry is off by the same rounded π; its numbers agree to eight digits.
    assert condition(A) == pytest.approx(expected["raw"], rel=1e-6)
    assert scaled_condition(A) == pytest.approx(expected["colnorm"], rel=1e-5)


def test_torque_of_the_reference_inertials(arms):
    motion = Motion.of_states(*([row] for row in TRUTH["tau_q_qd_qdd"]))
    for gravity, sign in ((HANGING, "gplus"), (LITERAL, "gminus")):
        model = arms[gravity].model
        torque = model.torque(motion, model.nominal_parameters())[0]
        assert torque == pytest.approx(TRUTH[f"tau_urdf_nofric_{sign}"], abs=TORQUE)


def test_torque_of_table_4_1(arms):
    motion = Motion.of_states(*([row] for row in TRUTH["tau_q_qd_qdd"]))
    values = {name: value for name, (value, _) in TRUTH["table41"].items()}
    for gravity, sign in ((HANGING, "gplus"), (LITERAL, "gminus")):
        assert arms[gravity].torque(motion, values)[0] == pytest.approx(TRUTH[f"tau_table41_{sign}"], abs=TORQUE)


def test_reference_inertials_as_base_parameters(arms):
    arm = arms[HANGING]
    values = dict(zip(arm.base.names, arm.base.values_of(arm.model.nominal_parameters()), strict=True))
    assert values == pytest.approx(TRUTH["urdf_pi_b"], abs=1e-12)


def test_mass_matrix(arms):
    model = arms[HANGING].model
    M = model.mass_matrix([TRUTH["tau_q_qd_qdd"][0]], model.nominal_parameters())[0]
    assert np.diag(M) == pytest.approx(TRUTH["M_urdf_diag"], abs=TORQUE)
    assert np.linalg.eigvalsh(M) == pytest.approx(TRUTH["M_urdf_eig"], abs=TORQUE)


# Peaks, as printed to so many digits -----------------------------------------------------------------------------

PEAKS = [
    ("a1", 20.0, "q", 2, (81.36, 74.79, 124.84, 98.42, 119.51, 102.99, 101.25)),
    ("a1", 20.0, "dq", 2, (75.55, 76.59, 72.65, 63.76, 110.82, 100.27, 78.22)),
    ("a1", 27.0, "dq", 2, (55.97, 56.73, 53.82, 47.23, 82.09, 74.27, 57.94)),
    ("a1", 20.0, "ddq", 3, (1.563, 1.377, 1.467, 1.279, 2.063, 3.082, 1.421)),
    ("a1", 27.0, "ddq", 3, (0.858, 0.755, 0.805, 0.702, 1.132, 1.691, 0.780)),
    ("a2", 20.0, "q", 2, (70.66, 86.01, 134.76, 78.40, 140.79, 111.76, 150.72)),
    ("a2", 20.0, "dq", 2, (79.38, 84.77, 75.46, 61.73, 110.80, 109.96, 123.28)),
    ("a2", 20.0, "ddq", 3, (1.774, 1.330, 1.200, 1.237, 1.800, 2.107, 1.647)),
]


@pytest.mark.parametrize(("table", "seconds", "quantity", "digits", "peaks"), PEAKS)
def test_peaks_of_the_motion(table, seconds, quantity, digits, peaks):
    """Angles and velocities in degrees, accelerations in rad/s²."""
    motion = plan(table).stretched(seconds).sample(10 * RATE)
    x = np.abs(getattr(motion, quantity)).max(axis=0)
    x = x if quantity == "ddq" else np.degrees(x)
    assert x == pytest.approx(peaks, abs=0.51 * 10.0**-digits)


@pytest.mark.parametrize(
    ("seconds", "peaks"),
    [(20.0, (47.5, 77.2, 22.2, 33.8, 18.8, 7.8, 6.9)), (27.0, (38.0, 71.2, 20.4, 30.4, 15.8, 6.7, 5.9))],
)
def test_peaks_of_the_torque(arms, seconds, peaks):
    """Reference inertials with the friction of Table 4.1."""
    friction = {name: value for name, (value, _) in TRUTH["table41"].items() if name.startswith("F")}
    torque = arms[HANGING].torque(plan("a1").stretched(seconds).sample(RATE), TRUTH["urdf_pi_b"] | friction)
    assert np.abs(torque).max(axis=0) == pytest.approx(peaks, abs=0.051)


def test_peaks_of_the_torque_of_table_4_1_with_the_literal_sign(arms):
    values = {name: value for name, (value, _) in TRUTH["table41"].items()}
    torque = arms[LITERAL].torque(plan("a1").stretched(27.0).sample(RATE), values)
    assert np.abs(torque).max(axis=0) == pytest.approx((38.4, 89.9, 29.2, 37.7, 16.1, 7.1, 6.5), abs=0.051)


@pytest.mark.parametrize("table", ["a1", "a2"])
def test_the_motion_begins_and_ends_at_rest(table):
    """Coefficients have five digits, so their sums vanish to as many."""
    start = plan(table).at([0.0])
    assert np.abs(start.q).max() < 1e-4
    assert np.abs(start.dq).max() < 5e-5
    assert np.abs(start.ddq).max() < 5e-5


# Shape of the printed deviations ------------------------------------------------------------------------------


def spread(rows, names):
    """Standard deviation of ln(printed deviation / [(YᵀY)⁻¹]^½) over all rows of Table 4.1 but ZZR_6."""
    A = rows.reshape(-1, len(names))
    inverse = np.linalg.inv(np.linalg.qr(A, mode="r"))
    shape = np.sqrt(np.sum(inverse**2, axis=1))
    printed = np.array([percent / 100.0 * abs(value) for value, percent in (TRUTH["table41"][n] for n in names)])
    counted = np.array([name != "ZZR_6" for name in names])
    assert counted.sum() == 56
    return np.std(np.log(printed / shape)[counted])


@pytest.mark.parametrize(("gravity", "expected"), [(HANGING, 0.033), (LITERAL, 0.025)])
def test_printed_deviations_are_those_of_27_seconds(arms, gravity, expected):
    arm = arms[gravity]
    assert spread(arm.rows(27.0), arm.base.names) == pytest.approx(expected, abs=0.002)
    assert spread(arm.rows(20.0), arm.base.names) > 0.2

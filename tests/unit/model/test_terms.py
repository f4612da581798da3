"""Laws of each torque term; what all of them must do stands in the contract."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    Coulomb,
    Coupling,
    Hysteresis,
    LoadCoulomb,
    LoadViscous,
    Offset,
    PiecewiseViscous,
    PowerViscous,
    RigidBody,
    Ripple,
    RotorInertia,
    Sigmoid,
    Stribeck,
    Viscous,
)
from memories import dragged
from trees import random_tree, robot_of


@pytest.fixture(scope="module")
def robot():
    """Three joints, the last one sliding."""
    rng = np.random.default_rng(0)
    tree = random_tree(rng, 3, prismatic=0.0)
    prismatic = np.array([0, 0, 1], dtype=np.uint8)
    return robot_of(type(tree)(tree.parent, prismatic, tree.axis, tree.rotation, tree.translation, tree.gravity))


STATES = Motion.of_states(
    [[0.1, 0.2, 0.3], [1.0, -1.0, 0.5]], [[0.5, -2.0, 0.0], [-0.5, 1e-9, 3.0]], [[1.0, 2.0, 4.0], [-1.0, 0.0, 0.25]]
)


def torques(robot, term, values):
    """Torque of a term alone along the two states."""
    model = DynamicsModel(robot, (term,))
    return model, model.torque(STATES, values)


def test_viscous(robot):
    model, torque = torques(robot, Viscous(), [10.0, 20.0, 30.0])
    assert torque.tolist() == [[5.0, -40.0, 0.0], [-5.0, 2e-8, 90.0]]
    assert [p.name for p in model.parameters] == ["FV_1", "FV_2", "FV_3"]
    assert [p.unit for p in model.parameters] == ["N·m·s/rad", "N·m·s/rad", "N·s/m"]
    assert all(p.nonnegative for p in model.parameters)


def test_coulomb_without_width_is_a_sign_that_rests_at_zero(robot):
    model, torque = torques(robot, Coulomb(width=0.0), [10.0, 20.0, 30.0])
    assert torque.tolist() == [[10.0, -20.0, 0.0], [-10.0, 20.0, 30.0]]
    assert [p.unit for p in model.parameters] == ["N·m", "N·m", "N"]


def test_coulomb_with_width_is_smooth(robot):
    _, torque = torques(robot, Coulomb(width=0.5), [10.0, 20.0, 30.0])
    assert torque == pytest.approx(np.array([10.0, 20.0, 30.0]) * np.tanh(STATES.dq / 0.5), rel=1e-15)


def test_offset_and_rotor_inertia(robot):
    model, torque = torques(robot, Offset(), [1.0, -2.0, 3.0])
    assert torque.tolist() == [[1.0, -2.0, 3.0]] * 2
    assert not any(p.nonnegative for p in model.parameters)
    model, torque = torques(robot, RotorInertia(), [2.0, 2.0, 4.0])
    assert torque.tolist() == [[2.0, 4.0, 16.0], [-2.0, 0.0, 1.0]]
    assert [p.unit for p in model.parameters] == ["kg·m²", "kg·m²", "kg"]


def test_terms_on_chosen_joints(robot):
    model, torque = torques(robot, Viscous(("joint_3", "joint_1")), [10.0, 30.0])
    assert torque.tolist() == [[5.0, 0.0, 0.0], [-5.0, 0.0, 90.0]]
    assert [p.name for p in model.parameters] == ["FV_1", "FV_3"]


def test_a_coupling_does_the_work_of_its_coordinate(robot):
    """Motor coordinate c = 2 q_1 - q_2: each joint feels the drive's torque times its weight."""
    model, torque = torques(robot, Coupling({"joint_2": -1.0, "joint_1": 2.0}), [3.0, 5.0, 7.0])
    assert [p.name for p in model.parameters] == ["IAM_2", "FVM_2", "FSM_2"]
    rate, acceleration = STATES.dq @ [2.0, -1.0, 0.0], STATES.ddq @ [2.0, -1.0, 0.0]
    drive = 3.0 * acceleration + 5.0 * rate + 7.0 * np.sign(rate)
    assert torque == pytest.approx(np.outer(drive, [2.0, -1.0, 0.0]), rel=1e-15)
    assert np.sum(torque * STATES.dq, axis=1) == pytest.approx(drive * rate, rel=1e-14)


def test_rigid_bodies_bring_ten_parameters_a_link(robot):
    names = [p.name for p in DynamicsModel(robot, (RigidBody(),)).parameters]
    assert names[:10] == ["M_1", "MX_1", "MY_1", "MZ_1", "XX_1", "XY_1", "YY_1", "XZ_1", "YZ_1", "ZZ_1"]
    assert len(names) == 30


def column(term, dq, **more):
    """Columns (N, p) of a term on a single joint that has velocities dq."""
    one = robot_of(random_tree(np.random.default_rng(1), 1, prismatic=0.0))
    dq = np.asarray(dq, dtype=float)[:, None]
    q = np.reshape(more.get("q", 0.0 * dq), dq.shape)
    return DynamicsModel(one, (term,)).regressor(Motion.of_states(q, dq, 0.0 * dq))[:, 0]


SPEEDS = np.array([-3.0, -0.4, -0.05, 0.0, 0.05, 0.4, 3.0])


def test_each_direction_has_its_own_friction():
    """FS + FSA forward and FS - FSA backward, FV + FVA and FV - FVA alike."""
    coulomb = column(Coulomb(), SPEEDS) * 5.0 + column(AsymmetricCoulomb(), SPEEDS) * 1.0
    assert coulomb[:, 0].tolist() == [-4.0, -4.0, -4.0, 0.0, 6.0, 6.0, 6.0]
    viscous = column(Viscous(), SPEEDS) * 5.0 + column(AsymmetricViscous(), SPEEDS) * 1.0
    assert viscous[:, 0] == pytest.approx(np.where(SPEEDS > 0.0, 6.0, 4.0) * SPEEDS, rel=1e-15)
    soft = column(AsymmetricCoulomb(0.2), SPEEDS)[:, 0]
    assert soft == pytest.approx(np.abs(np.tanh(SPEEDS / 0.2)), rel=1e-14)


def test_stribeck_falls_to_its_shape():
    for shape in (1.0, 2.0):
        law = np.exp(-((np.abs(SPEEDS) / 0.4) ** shape))
        assert column(Stribeck(0.4, shape), SPEEDS)[:, 0] == pytest.approx(law * np.sign(SPEEDS), rel=1e-14)
        soft = column(Stribeck(0.4, shape, 0.1), SPEEDS)[:, 0]
        assert soft == pytest.approx(law * np.tanh(SPEEDS / 0.1), rel=1e-14)


def test_a_power_is_one_well_above_its_width_and_smooth_below():
    for exponent in (0.3, 0.5, 1.7):
        law = column(PowerViscous(exponent, 1e-4), SPEEDS)[:, 0]
        assert law == pytest.approx(np.sign(SPEEDS) * np.abs(SPEEDS) ** exponent, rel=1e-5)
        slow = column(PowerViscous(exponent, 0.1), [1e-6, 2e-6])[:, 0]
        assert slow == pytest.approx(0.1 ** (exponent - 1.0) * np.array([1e-6, 2e-6]), rel=1e-9)


def test_the_sigmoid_is_that_of_its_paper():
    slope, shift = 7.0, 0.06
    law = 1.0 / (1.0 + np.exp(-slope * (SPEEDS + shift))) - 1.0 / (1.0 + np.exp(-slope * shift))
    assert column(Sigmoid(slope, shift), SPEEDS)[:, 0] == pytest.approx(law, abs=1e-15)
    assert np.isfinite(column(Sigmoid(1e4, 0.1), [-1e3, 1e3])).all()  # where the exponential would overflow


def test_pieces_change_their_slope_at_the_knots():
    speeds = np.linspace(-2.0, 2.0, 401)
    torque = column(Viscous(), speeds)[:, 0] + column(PiecewiseViscous((0.5, 1.0)), speeds) @ [-0.4, 2.0]
    slope = np.diff(torque) / np.diff(speeds)
    at = np.abs(0.5 * (speeds[1:] + speeds[:-1]))
    assert slope == pytest.approx(np.select([at < 0.5, at < 1.0], [1.0, 0.6], 2.6), abs=1e-9)
    assert torque == pytest.approx(-torque[::-1], abs=1e-12)


def test_hysteresis_is_a_loop():
    """There and back: the same positions, torques that differ by what the springs have turned."""
    q = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])
    found = column(Hysteresis((0.1, 0.25)), 0.0 * q, q=q)
    for k, r in enumerate((0.1, 0.25)):
        z = dragged(q, r, 0.0)
        assert found[60:, k] == pytest.approx(((q - z) / r)[60:], abs=1e-12)
    assert found[100].tolist() == pytest.approx([1.0, 1.0]) and found[-1].tolist() == pytest.approx([-1.0, -1.0])
    assert found[111, 0] == pytest.approx(0.0, abs=1e-9) and found[111, 1] == pytest.approx(0.6, abs=1e-9)


def test_ripple_of_joint_and_motor():
    q = np.linspace(-1.0, 2.0, 9)
    found = column(Ripple((1.0, 2.5), (2.0,), 51.0), 0.0 * q, q=q)
    phases = (q, 2.5 * q, 102.0 * q)
    expected = np.column_stack([wave(phase) for phase in phases for wave in (np.sin, np.cos)])
    assert found == pytest.approx(expected, abs=1e-13)
    one = robot_of(random_tree(np.random.default_rng(1), 1))
    names = [law.symbol for law in Ripple((1.0, 2.5), (2.0,), 51.0).laws(one)]
    assert names == ["RS1", "RC1", "RS2.5", "RC2.5", "RSM2", "RCM2"]


def test_load_dependent_friction(robot):
    bodies = np.random.default_rng(2).normal(size=(3, 10))
    load = DynamicsModel(robot, (RigidBody(),)).torque(STATES, bodies.ravel())
    for term, law in ((LoadCoulomb(), np.sign(STATES.dq)), (LoadViscous(), STATES.dq)):
        found = DynamicsModel(robot, (term,), bodies).torque(STATES, [1.0, 2.0, 3.0])
        assert found == pytest.approx(np.abs(load) * law * [1.0, 2.0, 3.0], rel=1e-12)


def test_one_term_with_other_shapes_on_other_joints(robot):
    model = DynamicsModel(robot, (Stribeck(0.1, joints=("joint_1",)), Stribeck(0.9, joints=("joint_2",))))
    found = model.torque(STATES, [1.0, 1.0])
    for j, velocity in ((0, 0.1), (1, 0.9)):
        law = np.exp(-((STATES.dq[:, j] / velocity) ** 2)) * np.sign(STATES.dq[:, j])
        assert found[:, j] == pytest.approx(law, rel=1e-13)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: AsymmetricCoulomb(-0.1), "finite and not negative"),
        (lambda: LoadCoulomb(float("inf")), "finite and not negative"),
        (lambda: Stribeck(velocity=0.0), "velocity must be positive"),
        (lambda: Stribeck(shape=0.5), "shape .* at least 1"),
        (lambda: Stribeck(width="wide"), "finite and not negative"),  # pyright: ignore[reportArgumentType]
        (lambda: PowerViscous(exponent=-1.0), "exponent .* positive"),
        (lambda: PowerViscous(width=0.0), "width .* positive"),
        (lambda: Sigmoid(slope=0.0), "slope .* positive"),
        (lambda: Sigmoid(shift=float("nan")), "shift .* number"),
        (lambda: PiecewiseViscous((1.0, 0.5)), "ascending"),
        (lambda: PiecewiseViscous(()), "ascending"),
        (lambda: PiecewiseViscous(0.5), "ascending"),  # pyright: ignore[reportArgumentType]
        (lambda: Hysteresis((0.1, 0.1)), "ascending"),
        (lambda: Hysteresis((0.0,)), "positive numbers"),
        (lambda: Ripple(()), "at least one harmonic"),
        (lambda: Ripple((-1.0,)), "positive numbers"),
        (lambda: Ripple(motor_harmonics=(1.0,)), "gear ratio"),
        (lambda: Ripple(gear_ratio=0.0), "gear ratio .* positive"),
        (lambda: Coulomb(width=-0.1), "finite and not negative"),
        (lambda: Coulomb(width=float("nan")), "finite and not negative"),
        (lambda: Coupling({"joint_1": 1.0}), "at least two joints"),
        (lambda: Coupling({"joint_1": 1.0, "joint_2": 0.0}), "at least two joints"),
        (lambda: Coupling({"joint_1": 1.0, "joint_2": 1.0}, width=-1.0), "finite and not negative"),
    ],
)
def test_shapes_without_a_meaning_are_refused(make, problem):
    with pytest.raises(ModelError, match=problem):
        make()


def test_a_coupling_of_turning_and_sliding_joints_is_refused(robot):
    with pytest.raises(ModelError, match="all revolute or all prismatic"):
        DynamicsModel(robot, (Coupling({"joint_2": 1.0, "joint_3": 1.0}),))


def test_a_joint_that_is_not_there_is_refused(robot):
    with pytest.raises(ArmidError, match="joint_9"):
        DynamicsModel(robot, (Viscous(("joint_9",)),))

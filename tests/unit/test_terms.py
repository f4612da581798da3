"""What each torque term says; what all of them must do stands in the contract."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Coupling, Offset, RigidBody, RotorInertia, Viscous
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


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: Coulomb(width=-0.1), "zero or positive"),
        (lambda: Coulomb(width=float("nan")), "zero or positive"),
        (lambda: Coupling({"joint_1": 1.0}), "at least two joints"),
        (lambda: Coupling({"joint_1": 1.0, "joint_2": 0.0}), "at least two joints"),
        (lambda: Coupling({"joint_1": 1.0, "joint_2": 1.0}, width=-1.0), "zero or positive"),
    ],
)
def test_shapes_without_a_meaning_are_refused(make, problem):
    with pytest.raises(ModelError, match=problem):
        make()


def test_a_coupling_of_turning_and_sliding_joints_is_refused(robot):
    with pytest.raises(ModelError, match="not both"):
        DynamicsModel(robot, (Coupling({"joint_2": 1.0, "joint_3": 1.0}),))


def test_a_joint_that_is_not_there_is_refused(robot):
    with pytest.raises(ArmidError, match="joint_9"):
        DynamicsModel(robot, (Viscous(("joint_9",)),))

"""Base parameters of models with friction and other terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.dataclass_files import load, save
from armid.errors import ModelError
from armid.maths.rotations import rotation_x
from armid.model import base_parameters as base_module
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import (
    TERMS,
    AsymmetricCoulomb,
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
from memories import with_any_past
from trees import chain, iiwa_tree, random_inertial, random_states, random_tree, robot_of, structured_tree

EVERY_TERM = tuple(term() for name, term in TERMS.items() if name != "coupling")

REGROUPING = 1e-10
"""Y - Y[:, kept] · regrouping over the largest entry of Y: rounding times coefficients of up to 1e5."""

LEVEL = [0.0, -9.81, 0.0]
ONE = np.eye(3)


def groupings(base: BaseParameters) -> dict[str, dict[str, float]]:
    return {
        name: {base.standard_names[k]: float(row[k]) for k in np.flatnonzero(row)}
        for name, row in zip(base.names, base.regrouping, strict=True)
    }


@pytest.mark.parametrize("seed", range(30))
def test_regrouped_columns_make_the_whole_regressor(seed):
    rng = np.random.default_rng(seed)
    make = structured_tree if seed % 2 else random_tree
    model = DynamicsModel(robot_of(make(rng, 1 + seed % 7)), EVERY_TERM)
    base = find_base_parameters(model)
    model = replace(model, load_parameters=random_inertial(rng, model.n))
    q, dq, ddq = random_states(rng, 100, model.n)
    dq[50:] *= 0.03  # where friction turns
    Y = model.regressor(with_any_past(model, Motion.of_states(q, dq, ddq), rng))
    assert np.abs(Y - Y[:, :, base.kept] @ base.regrouping).max() <= REGROUPING * np.abs(Y).max()
    stacked = Y.reshape(-1, Y.shape[2])[:, base.kept]
    assert np.linalg.matrix_rank(stacked / np.linalg.norm(stacked, axis=0)) == base.count
    theta = rng.normal(size=Y.shape[2])
    torque = Y @ theta
    assert np.abs(Y[:, :, base.kept] @ base.values_of(theta) - torque).max() <= REGROUPING * np.abs(torque).max()


def test_rotor_inertia_of_the_first_joint_is_inertia_of_the_first_link():
    base = find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), RotorInertia())))
    grouped = groupings(base)
    assert grouped["ZZR_1"] == pytest.approx({"ZZ_1": 1.0, "IA_1": 1.0, "YY_2": 1.0}, abs=1e-12)
    assert {"IA_2", "IA_1"} <= {base.standard_names[k] for k in base.removed}
    assert grouped["IA_3"] == {"IA_3": 1.0}


def test_weight_of_a_lift_is_rotor_inertia_and_offset():
    tree = chain("P", [ONE], [[0, 0, 0]], [0, 0, -9.81])
    base = find_base_parameters(DynamicsModel(robot_of(tree), (RigidBody(), Offset(), RotorInertia())))
    assert base.names == ("MR_1", "FOR_1")
    assert groupings(base)["MR_1"] == pytest.approx({"M_1": 1.0, "IA_1": 1.0}, abs=1e-12)
    assert groupings(base)["FOR_1"] == pytest.approx({"FO_1": 1.0, "IA_1": -9.81}, abs=1e-12)


def test_a_slide_across_gravity_cannot_tell_mass_from_rotor():
    tree = chain("P", [ONE], [[0, 0, 0]], LEVEL)
    base = find_base_parameters(DynamicsModel(robot_of(tree), (RigidBody(), Offset(), RotorInertia())))
    assert base.names == ("MR_1", "FO_1")
    assert groupings(base)["MR_1"] == pytest.approx({"M_1": 1.0, "IA_1": 1.0}, abs=1e-12)


def test_friction_alone():
    base = find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (Viscous(), Coulomb(0.02))))
    assert base.count == 14
    assert base.names == base.standard_names
    assert not len(base.removed)


def test_couplings_that_say_the_same():
    tree = chain("RRR", [ONE, rotation_x(np.pi / 2), ONE], [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], LEVEL)
    terms = (RigidBody(), Coupling({"joint_2": 1.0, "joint_3": 1.0}), Viscous(), RotorInertia())
    base = find_base_parameters(DynamicsModel(robot_of(tree), terms))
    names = {base.standard_names[k] for k in base.kept}
    # A shared motor's damping differs from that of each joint; columns that touch two rows are kept apart.
    assert {"FV_2", "FV_3", "FVM_3", "FSM_3"} <= names


def test_the_first_harmonic_of_a_joint_is_its_weight():
    """Joint 2 of the hanging iiwa is the only one to which the moments of its link are nothing but weight."""
    model = DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), Ripple((1.0, 2.0))))
    base = find_base_parameters(model)
    gone = {base.standard_names[k] for k in base.removed}
    assert {name for name in gone if name.startswith("R")} == {"RS1_2", "RC1_2"}
    grouped = groupings(base)
    moments = [abs(grouped["MXR_2"]["RC1_2"]), abs(grouped["MYR_2"]["RS1_2"])]
    assert moments == pytest.approx([1.0 / 9.81] * 2, abs=1e-12)


def test_without_gravity_every_harmonic_is_its_own():
    model = DynamicsModel(robot_of(iiwa_tree((0, 0, 0))), (RigidBody(), Ripple((1.0,))))
    assert {"RS1_2", "RC1_2"} <= set(find_base_parameters(model).names)


def test_an_asymmetric_sign_is_an_offset_and_a_soft_one_is_not():
    robot = robot_of(iiwa_tree())
    hard = find_base_parameters(DynamicsModel(robot, (Coulomb(), Offset(), AsymmetricCoulomb())))
    soft = find_base_parameters(DynamicsModel(robot, (Coulomb(0.02), Offset(), AsymmetricCoulomb(0.02))))
    assert groupings(hard)["FOR_1"] == pytest.approx({"FO_1": 1.0, "FSA_1": 1.0}, abs=1e-12)
    assert (hard.count, soft.count) == (14, 21)


def test_laws_of_any_scale_are_seen():
    """Knots faster than the usual random states, friction that is gone at a thousandth of their speed, loads of an
    estimate to come: all are parameters of their own."""
    terms = (
        RigidBody(),
        Viscous(),
        Coulomb(0.001),
        PiecewiseViscous((0.001, 2.5, 4.0)),
        Stribeck(velocity=0.003, width=0.001),
        PowerViscous(width=1e-3),
        Sigmoid(slope=500.0, shift=0.002),
        Hysteresis((1e-4, 0.5)),
        Ripple((7.0,), (1.0,), 160.0),
        LoadCoulomb(0.02),
        LoadViscous(),
    )
    model = DynamicsModel(robot_of(iiwa_tree()), terms)
    base = find_base_parameters(model)
    assert base.count == 43 + 7 * (2 + 3 + 3 + 2 + 4 + 2)


def test_gravity_decides():
    free = find_base_parameters(DynamicsModel(robot_of(iiwa_tree((0, 0, 0))), (RigidBody(),)))
    hanging = find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (RigidBody(),)))
    tilted = find_base_parameters(DynamicsModel(robot_of(iiwa_tree((0, 5, 5))), (RigidBody(),)))
    # The first three axes meet: only gravity shows the moments of what turns about that point.
    assert (free.count, hanging.count, tilted.count) == (39, 43, 45)
    assert tilted.gravity.tolist() == [0, 5, 5]


def test_saved_and_loaded(tmp_path):
    base = find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), Viscous())))
    again = load(BaseParameters, save(base, tmp_path / "base.npz"))
    assert again.names == base.names
    assert again.units == base.units
    assert np.array_equal(again.kept, base.kept)
    assert np.array_equal(again.regrouping, base.regrouping)


@pytest.mark.parametrize(("change", "found"), [("miss", "42"), ("invent", "44"), ("distort", "43")])
def test_disagreement_is_loud(monkeypatch, change, found):
    """Structure that misses, invents or distorts a parameter is refused, with both numbers."""
    true_base = base_module.structural_base

    def wrong(tree):
        kept, regrouping = true_base(tree)
        if change == "miss":
            return kept[:-1], regrouping[:-1]
        if change == "invent":
            return np.insert(kept, 0, 0), np.vstack([np.eye(70)[:1], regrouping])
        regrouping = regrouping.copy()
        regrouping[0, 16] *= 1.001
        return kept, regrouping

    monkeypatch.setattr(base_module, "structural_base", wrong)
    with pytest.raises(ModelError, match=f"gives {found} base parameters.* 43"):
        find_base_parameters(DynamicsModel(robot_of(iiwa_tree()), (RigidBody(),)))

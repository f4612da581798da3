"""Numbers of parameters by kind, their joints, and chosen friction in words."""

from __future__ import annotations

from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.parameter_counts import by_joint, count_text, joint_number
from armid.model.term_descriptions import describe_term, friction_of_joint
from armid.model.terms import TERMS, Coulomb, Hysteresis, Offset, RigidBody, RotorInertia, Stribeck, Viscous
from armid.robot import load_robot


def test_the_iiwa_has_the_count_that_papers_give():
    robot = load_robot("iiwa14-r820")
    names = find_base_parameters(DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))).names
    assert count_text(names) == "43 inertial + 14 friction"


def test_rotors_count_by_themselves_grouped_or_not_and_copies_of_recordings_each():
    assert count_text(["ZZR_1", "IA_3", "IAR_2", "FO_1[1]", "FO_1[2]"]) == "1 inertial + 2 rotor inertia + 2 friction"
    assert count_text(["FV_1"]) == "1 friction" and count_text([]) == ""


def test_every_kind_of_parameter_is_counted_where_it_belongs():
    robot = load_robot("ur5e")
    model = DynamicsModel(robot, (RigidBody(), RotorInertia(), Offset(), Stribeck()))
    assert count_text(p.name for p in model.parameters) == "60 inertial + 6 rotor inertia + 12 friction"


def test_names_end_in_the_number_of_their_joint():
    assert joint_number("FV_12[3]") == 12
    assert by_joint(["FV_2", "XX_1", "FS_2[1]"]) == {1: [1], 2: [0, 2]}


def test_laws_of_a_joint_stand_in_words_with_units_and_once():
    terms = (
        Hysteresis((0.001, 0.03), ("elbow",)),
        Stribeck(0.05, joints=("elbow", "wrist")),
        Coulomb(joints=("wrist",)),
    )
    assert friction_of_joint(terms, "elbow") == ("hysteresis over 0.001, 0.03 rad", "Stribeck effect at 0.05 rad/s")
    assert friction_of_joint(terms, "wrist", prismatic=True) == ("Stribeck effect at 0.05 m/s", "coulomb")
    assert friction_of_joint(terms, "base") == ()


def test_every_term_has_words():
    for name, kind in TERMS.items():
        if name != "coupling":  # has no shape by default
            assert describe_term(kind())

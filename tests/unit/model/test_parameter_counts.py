"""Numbers of parameters by kind, their joints, and chosen friction in words."""

from __future__ import annotations

from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.parameter_counts import by_joint, count_text
from armid.model.parameter_name import parameter_names
from armid.model.term_descriptions import describe_term, friction_of_joint
from armid.model.terms import TERMS, Coulomb, Hysteresis, Offset, RigidBody, RotorInertia, Stribeck, Viscous
from armid.robot import load_robot


def test_the_iiwa_has_the_count_that_papers_give():
    robot = load_robot("iiwa14-r820")
    names = find_base_parameters(DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))).names
    assert count_text(names) == "43 inertial + 14 friction"


def test_rotors_count_by_themselves_grouped_or_not_and_copies_of_recordings_each():
    names = parameter_names(["ZZR_1", "IA_3", "IAR_2", "FO_1[1]", "FO_1[2]"])
    assert count_text(names) == "1 inertial + 2 rotor inertia + 2 friction"
    assert count_text(parameter_names(["FV_1"])) == "1 friction" and count_text([]) == ""


def test_every_kind_of_parameter_is_counted_where_it_belongs():
    robot = load_robot("ur5e")
    model = DynamicsModel(robot, (RigidBody(), RotorInertia(), Offset(), Stribeck()))
    assert count_text(p.name for p in model.parameters) == "60 inertial + 6 rotor inertia + 12 friction"


def test_names_end_in_the_number_of_their_joint():
    assert by_joint(parameter_names(["FV_2", "XX_1", "FS_2[1]"])) == {1: [1], 2: [0, 2]}


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


def test_no_symbol_of_a_term_ends_in_the_mark_of_regrouping():
    """`ParameterName.read` takes a last R for that mark."""
    robot = load_robot("iiwa14-r820")
    terms = [term() for name, term in TERMS.items() if name != "coupling"]
    names = {each.symbol for term in terms for each in DynamicsModel(robot, (term,)).parameters}
    names |= {law.symbol for law in TERMS["coupling"](dict.fromkeys(robot.joint_names[:2], 1.0)).laws(robot)}
    assert len(names) > 20 and not [name for name in names if name.endswith("R")]

"""Bodies of a description that a link carries on fixed or held joints, with inertias that no real body has."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.errors import Finding, OutputError
from armid.export.fixed_body_inertias import as_carried, is_possible, moved
from armid.export.plausibility import far_bodies
from armid.export.types import Body, Content
from armid.export.write import export_run
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import InertialParameters, load_robot
from exports import WITNESSES, run_of, run_with

URDF = """<robot name="gripping"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.3"/><limit lower="-2" upper="2" velocity="2" effort="20"/></joint>
<link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="3"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.04"/></inertial></link>
<joint name="b" type="revolute"><parent link="upper"/><child link="hand"/><axis xyz="1 0 0"/>
<origin xyz="0 0 0.3"/><limit lower="-2" upper="2" velocity="2" effort="20"/></joint>
<link name="hand"><inertial><origin xyz="0 0 0.05"/><mass value="1"/>
<inertia ixx="{hand}" ixy="0" ixz="0" iyy="{hand}" iyz="0" izz="{hand}"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
<origin xyz="0 0.03 0.1"/><limit lower="0" upper="0.04" velocity="1" effort="20"/></joint>
<link name="finger"><inertial><mass value="0.08"/>
<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.0002" iyz="0" izz="0.0002"/></inertial></link>
</robot>"""
"""A finger of 80 g with ixx = 2 g·m², far above iyy + izz, as grippers in public descriptions have."""

MJCF = """<mujoco model="gripping"><worldbody>
<body name="upper" pos="0 0 0.3"><joint name="a" axis="0 1 0" range="-90 90"/>
<inertial pos="0 0 0.1" mass="3" diaginertia="0.05 0.06 0.04"/>
<body name="hand" pos="0 0 0.3"><joint name="b" axis="1 0 0" range="-90 90"/>
<inertial pos="0 0 0.05" mass="1" diaginertia="{hand} {hand} {hand}"/>
<body name="finger" pos="0 0.03 0.1"><joint name="slide" type="slide" axis="0 1 0" range="0 0.04"/>
<inertial pos="0 0 0" mass="0.08" diaginertia="0.002 0.0002 0.0002"/></body></body></body></worldbody></mujoco>"""

TEXTS = {"urdf": URDF, "mjcf": MJCF}


def the_run(folder, to, hand):
    path = folder / ("arm.xml" if to == "mjcf" else "arm.urdf")
    path.write_text(TEXTS[to].format(hand=hand))
    robot = load_robot(path, locked=["slide"])
    vectors = robot.inertial_vector.copy()
    if hand < 0.01:  # what is identified is a body that exists, whatever the description says of its parts
        vectors[1] = InertialParameters.from_com(1.1, [0, 0, 0.01], 1e-3 * np.eye(3)).vector
    terms = (RigidBody(), Viscous(), Coulomb(width=0.02))  # no rotor inertia that the hand's could go to
    return run_of(folder / "run", path, inertial=vectors, locked={"slide": 0.0}, terms=terms), path


def finger(path):
    text = path.read_text()
    return re.search(r'<link name="finger">.*?</link>|<body name="finger".*?</body>', text, re.DOTALL)[0]


@pytest.mark.parametrize("to", TEXTS)
def test_what_was_not_identified_stays_as_the_vendor_has_it(tmp_path, to):
    run, path = the_run(tmp_path, to, 0.05)
    exported = export_run(run, to, tmp_path / f"out.{to}")
    assert finger(exported.path) == finger(path)
    found = {finding.code: finding for finding in exported.findings}
    assert found["carried-impossible"].severity == "info" and "finger" in found["carried-impossible"].evidence
    assert all(check.ok for check in exported.checks) and not {"unphysical", "children-scaled"} & set(found)


@pytest.mark.parametrize("to", TEXTS)
def test_an_impossible_finger_does_not_stop_an_export(tmp_path, to):
    """The finger has more inertia than the identified hand with it: what is left would be no body."""
    run, _ = the_run(tmp_path, to, 1e-4)
    exported = export_run(run, to, tmp_path / f"out.{to}")
    found = {finding.code: finding for finding in exported.findings}
    said = found["carried-corrected"]
    assert said.severity == "warning" and said.channel == "hand" and "finger" in said.evidence
    assert "--lumped" in said.remedy and "correct the masses of finger" in said.remedy
    again = load_robot(exported.path)
    assert all(is_possible(link.inertial) for link in again.links)
    wanted = run.estimate.fit.standard.values[run.model.inertial_columns].reshape(2, 10)
    assert again.lock(["slide"]).inertial_vector == pytest.approx(wanted, abs=1e-12)
    assert {check.name.rsplit(" ", 1)[-1] for check in exported.checks} >= {"armid", *WITNESSES}


def test_lumped_gives_the_whole_link_to_the_body_that_carries(tmp_path):
    run, _ = the_run(tmp_path, "urdf", 1e-4)
    exported = export_run(run, "urdf", tmp_path / "out.urdf", lumped=True)
    again = load_robot(exported.path)
    wanted = run.estimate.fit.standard.values[run.model.inertial_columns].reshape(2, 10)
    assert again.inertial_vector[:2] == pytest.approx(wanted, abs=2e-6)
    assert 0.0 < again.links[2].inertial.mass < 1e-5  # on a joint that simulators let move
    with pytest.raises(OutputError, match="--lumped has no effect"):
        export_run(run, "mjcf", tmp_path / "out.xml", lumped=True)


def test_links_that_were_identified_must_be_possible_still(tmp_path):
    run, path = the_run(tmp_path, "urdf", 1e-4)
    theta = run.estimate.fit.standard.values.copy()
    theta[run.model.inertial_columns[14:16]] = 5.0
    bad = run_with(tmp_path / "bad", path, run.model, theta, locked={"slide": 0.0})
    with pytest.raises(OutputError, match=r"Not physically consistent: .*hand"):
        export_run(bad, "urdf", tmp_path / "bad.urdf")


def test_as_little_as_possible_is_changed():
    """Sound bodies stay as they are where it suffices to correct the impossible one; scaling comes last."""
    rng = np.random.default_rng(0)
    hand = InertialParameters.from_com(1.0, [0, 0, 0.05], 1e-3 * np.eye(3))
    cover = Body("cover", 0, np.eye(4), InertialParameters.from_com(0.2, [0, 0, 0.05], 1e-4 * np.eye(3)))
    odd = InertialParameters.from_com(0.08, 0.01 * rng.normal(size=3), np.diag([2e-3, 2e-4, 2e-4]))
    tip = Body("tip", 0, np.eye(4), odd)
    written, (said,) = as_carried(hand, "hand", [cover, tip])
    assert written[0] is cover.nominal and is_possible(written[1]) and said.code == "carried-corrected"
    left = hand.vector - sum(moved(b, w).vector for b, w in zip([cover, tip], written, strict=True))
    assert is_possible(InertialParameters.from_vector(left))
    heavy = Body("heavy", 0, np.eye(4), InertialParameters.from_com(2.0, [0, 0, 0.05], 1e-4 * np.eye(3)))
    written, (said,) = as_carried(hand, "hand", [heavy, tip])
    assert (
        said.code == "children-scaled"
        and "tip had an inertia that is not physically consistent" in said.evidence
        and said.remedy
    )
    assert written[0].mass == pytest.approx(2.0 * written[1].mass / 0.08)
    inside_out = Body("odd", 0, np.eye(4), InertialParameters.from_com(0.5, [0, 0, 0.3], -0.01 * np.eye(3)))
    written, (said,) = as_carried(hand, "hand", [inside_out])
    assert said.code == "carried-corrected" and is_possible(written[0])


def test_a_prior_that_was_used_already_is_no_remedy_for_far_masses(tmp_path):
    run, _ = the_run(tmp_path, "urdf", 0.05)
    links = [
        replace(link, inertial=InertialParameters.from_vector(40 * link.inertial.vector)) for link in run.robot.links
    ]
    heavy = replace(run.robot, links=tuple(links))
    kept = run.estimate.fit.standard
    for kind, proposed in (("none", True), ("log-det", False)):
        unknown = ("prior-dominated",) * len(kept.names)
        standard = replace(kept, prior=replace(kept.prior, kind=kind), status=unknown)
        fit = replace(run.estimate.fit, standard=standard)
        same = replace(run, estimate=replace(run.estimate, fit=fit))
        (said,) = far_bodies(same, Content(heavy, {}), None, "nearest")
        assert ("log-det" in said.remedy) is proposed and said.remedy
        assert "do not determine these values one by one" in said.evidence


def test_far_masses_that_the_torque_determines_are_not_called_undetermined(tmp_path):
    """The hand alone is known: of two links far from the description each is in its own finding."""
    run, _ = the_run(tmp_path, "urdf", 0.05)
    links = [
        replace(link, inertial=InertialParameters.from_vector(40 * link.inertial.vector)) for link in run.robot.links
    ]
    kept = run.estimate.fit.standard
    status = tuple("identified" if name.endswith("_2") else "prior-dominated" for name in kept.names)
    fit = replace(run.estimate.fit, standard=replace(kept, status=status))
    known = replace(run, estimate=replace(run.estimate, fit=fit))
    told, guessed = far_bodies(known, Content(replace(run.robot, links=tuple(links)), {}), None, "estimated")
    assert (
        told.evidence.startswith("In the exported file, hand has a mass of 43.2 kg")
        and "recordings determine" in told.evidence
    )
    assert "same arm" in told.remedy and "--nearest" not in told.remedy
    assert "upper has a mass of 120 kg" in guessed.evidence and "do not determine" in guessed.evidence


DUMMY = """<robot name="dummy"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="roll"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" velocity="2" effort="20"/></joint>
<link name="roll"><inertial><mass value="0.1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="weld" type="fixed"><parent link="roll"/><child link="upper"/><origin xyz="0.1 0 0"/></joint>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="6"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.04"/></inertial></link>
</robot>"""
"""A dummy that the joint moves, and the body on a fixed joint, as arms in public descriptions have."""

DUMMY_MJCF = """<mujoco model="dummy"><worldbody><body name="roll"><joint name="a" axis="1 0 0" range="-90 90"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="0.01 0.01 0.01"/>
<body name="upper" pos="0.1 0 0"><inertial pos="0.2 0 0" mass="6" diaginertia="0.05 0.06 0.04"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize(("to", "text"), [("urdf", DUMMY), ("mjcf", DUMMY_MJCF)])
def test_the_heaviest_body_takes_what_was_identified(tmp_path, to, text):
    """A share of 2 % of the link is nothing to its heaviest body, and no body at all to a dummy of 0.1 kg."""
    path = tmp_path / ("arm.xml" if to == "mjcf" else "arm.urdf")
    path.write_text(text)
    found = load_robot(path).inertial_vector * 0.98
    run = run_of(tmp_path / "run", path, inertial=found, terms=(RigidBody(), Viscous(), Coulomb(width=0.02)))
    exported = export_run(run, to, tmp_path / f"out.{to}")
    said = {finding.code: finding for finding in exported.findings}
    assert said["difference-taken"].channel == "upper" and "roll keeps" in said["difference-taken"].evidence
    assert "mass-far-from-description" not in said and all(check.ok for check in exported.checks)
    assert load_robot(exported.path).inertial_vector == pytest.approx(found, abs=1e-12)
    written = exported.path.read_text()
    dummy = re.search(r'(?<=<link name="roll">).*?</link>|<inertial pos="0 0 0"[^>]*>', written, re.DOTALL)[0]
    assert dummy in text


def test_a_body_whose_described_mass_is_a_placeholder_is_not_compared(tmp_path):
    run, _ = the_run(tmp_path, "urdf", 0.05)
    (*others, last) = run.robot.links
    tiny = replace(last, inertial=InertialParameters.from_com(1e-9, np.zeros(3), 4e-13 * np.eye(3)))
    placeholder = replace(run, robot=replace(run.robot, links=(*others, tiny)))
    assert far_bodies(placeholder, Content(run.robot, {}), None, "estimated") == []
    (said,) = far_bodies(run, Content(placeholder.robot, {}), None, "estimated")
    assert last.name in said.evidence


def test_a_centre_of_mass_outside_of_its_body_is_told(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(DUMMY)
    body = InertialParameters.from_com(0.1, np.zeros(3), 0.01 * np.eye(3))
    run = run_of(tmp_path / "run", path, terms=(RigidBody(), Viscous()))
    bodies, taken = [Body("roll", 0, np.eye(4), body)], Finding("difference-taken", "info", "roll", "")
    for x, told in ((0.2, False), (1.7, True)):
        written = InertialParameters.from_com(0.09, [x, 0, 0], 0.01 * np.eye(3))
        found = far_bodies(run, Content(run.robot, {}, bodies={"roll": written}), bodies, "estimated", [taken])
        assert bool(found) is told
    assert "the centre of mass of roll is 1.7 m away from" in found[0].evidence and "--lumped" in found[0].remedy

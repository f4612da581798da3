"""Runs written as robot descriptions: what changes, what stays, what is refused."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid import accumulate_information, find_base_parameters
from armid.errors import OutputError
from armid.estimation.estimate_record import InputDigest
from armid.estimation.estimators import PhysicallyConsistent
from armid.estimation.problem import EstimationProblem, standard_of
from armid.excitation.thesis_plans import builtin_plan
from armid.export import standard_values, verification
from armid.export.body_split import share_out
from armid.export.fixed_body_inertias import is_possible
from armid.export.formats import urdf
from armid.export.types import Body, Content, Witness, rpy_of, text_of, unique_names
from armid.export.write import Exported, export_run
from armid.maths.rotations import homogeneous, rotation_x, rpy_rotation
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import InertialParameters, Link, load_robot
from armid.runs.run import Run
from exports import LOCKED, MJCF, URDF, run_of, run_with
from problems import one_run, raw
from trees import random_inertial


def write(folder: Path, text: str, name: str = "odd.urdf") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def codes(exported: Exported) -> dict[str, str]:
    return {finding.code: f"{finding.channel}: {finding.evidence}" for finding in exported.findings}


def masked(data: bytes) -> bytes:
    """A URDF without what an export may touch: numbers in inertials, damping and friction."""
    data = re.sub(rb"\n[ \t]*<inertial><origin[^>]*/><mass[^>]*/><inertia[^>]*/></inertial>(?=\n</link>)", b"", data)
    data = re.sub(rb"\s*<dynamics damping=\"[^\"]*\" friction=\"[^\"]*\"/>", b"", data)
    for name in (b"damping", b"friction", b"value", b"ixx", b"ixy", b"ixz", b"iyy", b"iyz", b"izz"):
        data = re.sub(name + rb"(\s*=\s*)([\"'])[^\"']*[\"']", name + rb"\1\2#\2", data)
    inertials = re.compile(rb"<inertial>.*?</inertial>", re.DOTALL)
    return inertials.sub(lambda found: re.sub(rb' ?<origin xyz="[^"]*"/>| xyz="[^"]*"', b"", found[0]), data)


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_urdf_keeps_every_byte_that_is_not_a_number(tmp_path: Path, ends: str):
    source = write(tmp_path, URDF.replace("\n", ends))
    exported = export_run(run_of(tmp_path / "run", source, locked=LOCKED), "urdf")
    found, before = exported.path.read_bytes(), source.read_bytes()
    assert exported.path == tmp_path / "run" / "odd.urdf" and exported.edited == str(source)
    assert masked(found) == masked(before) and found != before
    assert found.count(b"\r") == before.count(b"\r") + (found.count(b"\n") - before.count(b"\n")) * (ends == "\r\n")
    assert b'rpy="0.1 0.2 0.3"' in found and b"<!-- from the CAD -->" in found
    assert b'<link name="base"><inertial><mass value="9"/>' in found  # what does not move is not identified
    assert b'<link name="two"/>' in found  # a mere frame stays one; the body on it has the mass


def test_children_keep_their_values_and_the_carrier_takes_the_difference(tmp_path: Path):
    source = write(tmp_path, URDF)
    run = run_of(tmp_path / "run", source, locked=LOCKED)
    exported = export_run(run, "urdf")
    found = exported.path.read_text()
    assert '<link name="plate"><inertial><origin xyz="0 0 0.01"/><mass value="0.2"/>' in found
    assert '<link name="tip"><inertial><mass value="0.1"/>' in found
    assert codes(exported)["difference-taken"].startswith(("one: plate keep", "three: tip keep"))
    again = load_robot(exported.path, locked=LOCKED)
    theta = run.estimate.fit.standard
    assert theta is not None and again.inertial_vector is not None
    expected = theta.values[run.model.inertial_columns].reshape(-1, 10)
    np.testing.assert_allclose(again.inertial_vector, expected, rtol=0, atol=1e-15)


def test_children_too_large_for_the_link_are_scaled_and_it_is_said(tmp_path: Path):
    source = write(tmp_path, URDF.replace('"1e-3"', '"50"'))  # the inertia of a plate far larger than the link
    light = random_inertial(np.random.default_rng(1), 3)
    robot = load_robot(source, locked=LOCKED)
    model = DynamicsModel(robot, (RigidBody(), Viscous()))
    theta = np.ones(len(model.parameters))
    theta[model.inertial_columns] = light.ravel()
    exported = export_run(run_with(tmp_path / "run", source, model, theta, locked=LOCKED), "urdf")
    assert codes(exported)["children-scaled"].startswith(
        "one: with the inertia of plate in the description, the rest of the identified link"
    )
    again = load_robot(exported.path, locked=LOCKED).inertial_vector
    np.testing.assert_allclose(again, light, rtol=0, atol=1e-14)


def test_friction_goes_where_the_format_has_a_place_and_all_of_it_to_the_side(tmp_path: Path):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    exported = export_run(run, "urdf")
    side = json.loads(exported.side.read_text())
    value = {each["name"]: each["value"] for each in side["parameters"]}
    placed = {each["name"] for each in side["parameters"] if each["in_file"]}
    text = exported.path.read_text()
    # What stood there keeps its order and its quotes.
    assert f"<dynamics friction='{value['FS_1']!r}'   damping = \"{value['FV_1']!r}\"/>" in text
    assert f'<dynamics damping="{value["FV_3"]!r}" friction="{value["FS_3"]!r}"/>' in text
    assert {"FV_1", "FS_2", "M_3"} <= placed and not {"FO_1", "IA_2"} & placed
    assert exported.side == tmp_path / "run" / "odd.urdf.armid.json"
    law = next(each for each in side["parameters"] if each["name"] == "FS_2")
    assert law["torque"] == str(run.model.laws[5][1].expression) and law["acts_on"] == [{"joint": "b", "weight": 1.0}]
    severity = {f.channel: f.severity for f in exported.findings if f.code == "no-place"}
    assert severity == {"offset": "info", "rotor-inertia": "warning"}


def test_an_mjcf_keeps_its_text_and_gets_attributes(tmp_path: Path):
    source = write(tmp_path, MJCF, "odd.xml")
    run = run_of(tmp_path / "run", source)
    exported = export_run(run, "mjcf")
    found = exported.path.read_text()
    lines = [line for line in MJCF.splitlines() if not re.search("joint|inertial|cover", line)]
    assert [line for line in found.splitlines() if not re.search("joint|inertial|cover", line)] == lines
    assert 'diaginertia="0.02' not in found and "quat" not in found and "damping='3'" not in found
    assert re.search(
        r"<joint name=\"a\" axis=\"0 0 1\" damping='\S+' range=\"-90 90\" frictionloss=\"\S+\" arm", found
    )
    assert '<inertial pos="0.0 0.0 0.0" mass="0.0" diaginertia="0.0 0.0 0.0"/><geom mesh="shell"/></body>' in found
    assert codes(exported)["mesh-mass-removed"].startswith("cover: the description gives this body no inertia")
    assert "ball keeps the inertia of the description" in codes(exported)["difference-taken"]


def test_what_an_mjcf_includes_is_put_in_its_place(tmp_path: Path):
    first, rest = MJCF.split('    <body name="one"', 1)
    body, last = rest.split("  </worldbody>", 1)
    write(tmp_path, f'<mujocoinclude><!-- inside -->\n<body name="one"{body}</mujocoinclude>', "inside.xml")
    source = write(tmp_path, f'{first}<include file="inside.xml"/></worldbody>{last}', "outer.xml")
    run = run_of(tmp_path / "run", source)
    with pytest.raises(OutputError, match="or a file that it includes"):
        export_run(run, "mjcf", out=tmp_path / "inside.xml")
    exported = export_run(run, "mjcf")
    assert "includes-inlined" in codes(exported)
    assert "<!-- inside -->" in exported.path.read_text() and "<include" not in exported.path.read_text()


@pytest.mark.parametrize("to", ["urdf", "mjcf", "sdf"])
def test_a_table_becomes_a_file_of_its_own(tmp_path: Path, to: str):
    run = run_of(tmp_path / "run", "iiwa14-r820", gravity=(0.0, 0.0, 9.81))
    exported = export_run(run, to)
    assert exported.edited == "" and exported.path.stem == "iiwa14-r820"
    assert {"gravity-differs"} & set(codes(exported)) == (set() if to == "mjcf" else {"gravity-differs"})
    if to != "sdf":
        again = load_robot(exported.path)
        assert again.joint_names == run.robot.joint_names
        for a, b in zip(again.joints, run.robot.joints, strict=True):
            np.testing.assert_allclose(a.placement, b.placement, rtol=0, atol=1e-15)
            np.testing.assert_allclose(a.position_limits, b.position_limits, rtol=1e-15)
            assert a.effort_limit == b.effort_limit


def test_base_values_get_the_nearest_bodies_that_have_exactly_them(tmp_path: Path):
    source = write(tmp_path, URDF)
    known = export_run(run_of(tmp_path / "a", source, locked=LOCKED), "urdf")
    run = run_of(tmp_path / "b", source, locked=LOCKED, standard=False)
    exported = export_run(run, "urdf")
    assert (known.standard, exported.standard) == ("estimated", "nearest")
    side = json.loads(exported.side.read_text())
    theta = np.array([each["value"] for each in side["parameters"]])
    np.testing.assert_allclose(run.estimate.base.values_of(theta), run.estimate.fit.values, rtol=0, atol=1e-14)


def smallest_bodies(folder: Path, size: float) -> tuple[Run, Path]:
    """The smallest bodies that give the torque of the iiwa, all of it smaller: on the edge of what can exist."""
    robot = load_robot("iiwa14-r820")
    links = [
        Link(x.name, InertialParameters.from_vector(size * x.inertial.vector)) for x in robot.links if x.inertial
    ]
    path = folder / "arm.urdf"
    path.write_bytes(urdf.write(Content(replace(robot, links=tuple(links)), {})).data)
    model = DynamicsModel(load_robot(path), (RigidBody(), Viscous()))
    base, motion = find_base_parameters(model), builtin_plan("thesis-a1").sample(50.0)
    truth = np.full(len(model.parameters), size)
    truth[model.inertial_columns] = np.ravel(model.robot.inertial_vector)
    noise = 0.3 * size * np.random.default_rng(0).normal(size=(motion.samples, model.n))
    observations = raw(one_run(motion, model.torque(motion, truth) + noise, 50.0, block_rows=50))
    problem = EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base
    )
    fit = PhysicallyConsistent(prior="mass").solve(problem).standard
    assert fit is not None
    run = run_with(folder / "run", path, model, fit.values)
    standard = replace(run.estimate.fit.standard, status=fit.status)
    return replace(run, estimate=replace(run.estimate, fit=replace(run.estimate.fit, standard=standard))), path


@pytest.mark.parametrize("size", [1.0, 0.03])
def test_masses_far_from_the_description_are_told_and_nearest_brings_them_back(tmp_path: Path, size: float):
    run, path = smallest_bodies(tmp_path, size)
    plain = export_run(run, "urdf", tmp_path / "plain.urdf")
    assert plain.standard == "estimated"
    (far,) = (f for f in plain.findings if f.code == "mass-far-from-description")
    assert (
        "link_1 has a mass of 1.01e-06 kg" in far.evidence and "--nearest" in far.remedy and "log-det" in far.remedy
    )
    near = export_run(run, "urdf", tmp_path / "near.urdf", nearest=True)
    assert near.standard == "nearest"
    described, found = (load_robot(each).inertial_vector for each in (path, tmp_path / "near.urdf"))
    assert described is not None and found is not None
    assert 0.5 < found[0, 0] / described[0, 0] < 2.0  # no torque sees the first link, so that it may be as described


def test_bodies_that_are_asked_for_and_not_found_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(standard_values, "_search", lambda *_: None)
    exported = export_run(run_of(tmp_path / "run", "ur5e"), "urdf", nearest=True)
    assert exported.standard == "estimated" and "nearest-not-found" in codes(exported)
    assert "nearest-not-found" not in codes(export_run(run_of(tmp_path / "run", "ur5e"), "urdf"))


def test_nothing_is_left_in_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any):
    """MuJoCo warns of limits that are equal, on standard error and in a file of its own, if it is let."""
    source = write(tmp_path, URDF.replace('lower="-2" upper="2"', 'lower="0" upper="0"'))
    run = run_of(tmp_path / "run", source, locked=LOCKED)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    exported = export_run(run, "urdf")
    assert "rigid-body torque in mujoco" in {each.name for each in exported.checks}
    assert list(Path().iterdir()) == [] and "limit" not in capfd.readouterr().err


def test_base_values_of_no_body_are_refused(tmp_path: Path):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED, standard=False)
    values = np.array(run.estimate.fit.values)
    values[run.estimate.base.names.index("FV_1")] = -1.0
    bad = replace(run, estimate=replace(run.estimate, fit=replace(run.estimate.fit, values=values)))
    with pytest.raises(OutputError, match=r'No physically consistent links .* wls .*\n.*\n.*method = "physical"'):
        export_run(bad, "urdf")
    exported = export_run(bad, "urdf", allow_unphysical=True)
    assert exported.standard == "unphysical" and "the viscous parameter of a" in codes(exported)["unphysical"]


def test_links_of_no_body_are_named_and_refused(tmp_path: Path):
    source = write(tmp_path, URDF)
    inertial = np.array(load_robot(source, locked=LOCKED).inertial_vector)
    inertial[2, 4] = -0.5  # about the axis of the last joint, where torque sees it alone
    run = run_of(tmp_path / "run", source, locked=LOCKED, inertial=inertial)
    with pytest.raises(OutputError, match="Not physically consistent: three"):
        export_run(run, "urdf", out=tmp_path / "out.urdf")
    assert not (tmp_path / "out.urdf").exists() and not (tmp_path / "out.urdf.armid.json").exists()
    exported = export_run(run, "urdf", allow_unphysical=True)
    again = load_robot(exported.path, locked=LOCKED).inertial_vector
    assert again is not None
    np.testing.assert_allclose(again[2], inertial[2], rtol=0, atol=1e-14)
    assert "physically consistent: three" in codes(exported)["unphysical"] and codes(exported)["not-checked"]


def test_the_description_is_never_written_over(tmp_path: Path):
    source = write(tmp_path, URDF)
    run = run_of(tmp_path / "run", source, locked=LOCKED)
    with pytest.raises(OutputError, match="this file is the description or a file that it includes"):
        export_run(run, "urdf", out=tmp_path / "run" / ".." / "odd.urdf")
    assert source.read_text() == URDF


@pytest.mark.parametrize("to", ["urdf", "mjcf", "sdf"])
def test_what_another_run_or_hand_has_written_is_never_written_over(tmp_path: Path, to: str):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    out = tmp_path / "arm.out"
    out.write_text("by hand")
    with pytest.raises(OutputError, match="would be overwritten, but it is not an earlier export of"):
        export_run(run, to, out)
    assert out.read_text() == "by hand"
    out.unlink()
    mine = export_run(run, to, out).path.read_bytes()
    assert export_run(run, to, out).path.read_bytes() == mine
    other = replace(
        run, estimate=replace(run.estimate, made_from=(*run.estimate.made_from, InputDigest("options", "others")))
    )
    with pytest.raises(OutputError, match="would be overwritten"):
        export_run(other, to, out)
    assert out.read_bytes() == mine


def test_a_description_that_has_changed_is_no_ground_to_write_on(tmp_path: Path):
    source = write(tmp_path, URDF)
    run = run_of(tmp_path / "run", source, locked=LOCKED)
    moved = source.rename(tmp_path / "moved.urdf")
    with pytest.raises(OutputError, match=r"does not exist any more(.|\n)*--description FILE"):
        export_run(run, "urdf")
    assert export_run(run, "urdf", description=moved).edited == str(moved)
    moved.write_text(URDF.replace("3.0", "3.1"))
    with pytest.raises(OutputError, match="has changed"):
        export_run(run, "urdf", description=moved)


def test_a_file_that_says_something_else_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The check is real: one digit lost in writing is enough."""
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    monkeypatch.setattr(urdf, "text_of", lambda *numbers: " ".join(f"{x:.7g}" for x in numbers))
    with pytest.raises(OutputError, match="differs from the identified model"):
        export_run(run, "urdf")
    assert not (tmp_path / "run" / "odd.urdf").exists()


@pytest.mark.witness
def test_a_wrong_friction_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    monkeypatch.setattr(urdf, "ATTRIBUTES", {"viscous": "friction", "coulomb": "damping"})
    with pytest.raises(OutputError, match="viscous of a in pinocchio"):
        export_run(run, "urdf")


def test_settings_that_make_other_inertias_are_refused(tmp_path: Path):
    source = write(tmp_path, MJCF.replace("meshdir", 'balanceinertia="true" meshdir'), "odd.xml")
    with pytest.raises(OutputError, match="compiler settings balanceinertia"):
        export_run(run_of(tmp_path / "run", source), "mjcf")


def test_rounded_angles_stay_as_they_are_and_are_told(tmp_path: Path):
    source = write(tmp_path, URDF.replace("1.5707963267948966", "1.5708"))
    exported = export_run(run_of(tmp_path / "run", source, locked=LOCKED), "urdf")
    assert 'rpy="1.5708 0 0"' in exported.path.read_text()
    assert "the torque changes by" in codes(exported)["description-rounded"]
    assert all(c.value < verification.TORQUE for c in exported.checks)


def test_an_unknown_format(tmp_path: Path):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    with pytest.raises(OutputError, match=r"Unknown format 'step'.\nPossible: urdf, mjcf, sdf"):
        export_run(run, "step")


def test_a_run_without_bodies_has_nothing_to_write(tmp_path: Path):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    model = DynamicsModel(run.robot, (Viscous(), Coulomb()))
    friction = run_with(tmp_path / "f", tmp_path / "odd.urdf", model, np.ones(6), locked=LOCKED)
    with pytest.raises(OutputError, match="no rigid bodies"):
        export_run(friction, "urdf")


def test_shares_add_up_to_the_link():
    rng = np.random.default_rng(0)
    link = InertialParameters.from_vector(random_inertial(rng, 1)[0])
    pose = homogeneous(rpy_rotation([0.1, 0.2, 0.3]), [0.1, 0.0, 0.2])
    for size in (0.01, 100.0):
        child = InertialParameters.from_vector(size * random_inertial(rng, 1)[0])
        bodies = [Body("own", 0, np.eye(4), link), Body("child", 0, pose, child)]
        changed, _ = share_out([link], bodies)
        part = changed.get("child", child)
        together = changed["own"] + part.seen_from(pose[:3, :3], pose[:3, 3])
        np.testing.assert_allclose(together.vector, link.vector, rtol=0, atol=1e-14)
        assert is_possible(changed["own"]) and is_possible(part)
        assert ("child" in changed) == (size > 1.0)


@pytest.mark.parametrize("pitch", [0.0, 0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-12, np.pi / 2 - 1e-9])
def test_angles_of_a_rotation_give_it_back(pitch: float):
    for roll, yaw in np.random.default_rng(2).uniform(-3, 3, (20, 2)):
        rotation = rpy_rotation([roll, pitch, yaw]) @ rotation_x(0.0)
        np.testing.assert_allclose(rpy_rotation(rpy_of(rotation)), rotation, rtol=0, atol=1e-15)


def test_numbers_and_names_come_back():
    numbers = np.random.default_rng(3).normal(size=20) * 10.0 ** np.arange(-10, 10)
    assert [float(word) for word in text_of(*numbers).split()] == numbers.tolist()
    assert text_of(-0.0) == "0.0"
    assert unique_names(["a", "b", "a", "a_2"], ["b"]) == ["a", "b_2", "a_2", "a_2_2"]


def test_a_body_of_nothing_on_a_locked_joint_gets_a_speck(tmp_path: Path):
    """MuJoCo takes no moving body without mass, and would make one from the mesh."""
    cover = '<body name="cover" pos="0 0 0.1"><joint name="hinge"/>'
    source = write(tmp_path, MJCF.replace('<body name="cover" pos="0 0 0.1">', cover), "odd.xml")
    exported = export_run(run_of(tmp_path / "run", source, locked=["hinge"]), "mjcf")
    assert '<inertial pos="0.0 0.0 0.0" mass="1e-06"' in exported.path.read_text()
    assert "rigid-body torque in mujoco" in {found.name for found in exported.checks}


def test_a_witness_that_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    said = codes(export_run(run, "urdf"))["not-checked"]
    assert said == "pinocchio: the package pin is not installed (pip install 'armid[witness]')"


@pytest.mark.witness
def test_a_program_that_takes_the_description_must_take_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    taken = urdf.witnesses

    def stumbles(data: bytes, *states: Any) -> list[Witness]:
        found = taken(data, *states)
        return found if data == URDF.encode() else [Witness("pinocchio", None, {}, "it stumbles."), *found[1:]]

    monkeypatch.setattr(urdf, "witnesses", stumbles)
    with pytest.raises(OutputError, match="pinocchio rejects the file that would be written: it stumbles"):
        export_run(run, "urdf")
    monkeypatch.setattr(urdf, "witnesses", lambda *_: [Witness("mujoco", None, {}, "not there", is_absent=True)])
    assert codes(export_run(run, "urdf"))["not-checked"] == "mujoco: not there"


def test_two_formats_in_one_folder_keep_the_whole_model_of_each(tmp_path: Path):
    run = run_of(tmp_path / "run", write(tmp_path, URDF), locked=LOCKED)
    sides = {to: export_run(run, to, tmp_path / "out" / f"arm.{end}").side for to, end in ENDS.items()}
    assert len(set(sides.values())) == len(ENDS)
    for to, end in ENDS.items():
        assert json.loads(sides[to].read_text())["file"]["name"] == f"arm.{end}"


ENDS = {"urdf": "urdf", "mjcf": "xml", "sdf": "sdf"}

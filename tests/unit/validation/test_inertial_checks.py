"""Stated inertia beside shapes: evenly filled bodies are sound, and every mistake is named with its cause."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import Finding
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot import load_robot
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.described_bodies.reading import described_bodies
from armid.robot.shapes import Shape
from armid.validation.inertial_checks.causes import unit_mistake
from armid.validation.inertial_checks.filled_shape import filled_shape
from armid.validation.inertial_checks.findings import check_bodies, check_inertials
from armid.validation.inertial_checks.measures import HEAVIEST, LIGHTEST, measures_of
from command_line import exit_code
from mesh_texts import collada, prism, write_mesh

EDGES = np.array([0.06, 0.08, 0.4])
POLYGON = 0.03
"""Error of the moments of a round body by the polygons that stand for its circles: 2 % with 32 corners."""


def box(name: str = "rod", *, edges: np.ndarray = EDGES, density: float = 1000.0, at: float = 0.2) -> DescribedBody:
    """Box that is filled evenly, with the origin of its link at a distance `at` below its centre."""
    mass, sq = density * float(edges.prod()), edges**2
    about = np.diag(mass / 12.0 * np.array([sq[1] + sq[2], sq[0] + sq[2], sq[0] + sq[1]]))
    place = homogeneous(np.eye(3), [0.0, 0.0, at])
    return DescribedBody(name, mass, place[:3, 3], about, (Shape(name, -1, "box", edges, place),))


def warnings(*bodies: DescribedBody) -> list[Finding]:
    return [finding for finding in check_bodies(bodies).findings if finding.severity == "warning"]


@pytest.mark.parametrize(
    ("kind", "size", "volume", "moments"),
    [
        ("box", [0.1, 0.2, 0.3], 0.006, [0.01 / 12, 0.04 / 12, 0.09 / 12]),
        ("sphere", [0.1], 4 / 3 * np.pi * 1e-3, [0.002, 0.002, 0.002]),
        ("cylinder", [0.1, 0.3], np.pi * 0.003, [0.0025, 0.0025, 0.09 / 12]),
        ("ellipsoid", [0.1, 0.2, 0.3], 4 / 3 * np.pi * 0.006, [0.002, 0.008, 0.018]),
    ],
)
def test_a_filled_shape_has_the_moments_of_the_textbook(kind, size, volume, moments):
    turned = homogeneous(rpy_rotation([0.3, -0.5, 1.1]), [0.4, -0.2, 0.1])
    body = DescribedBody("body", 1.0, np.zeros(3), np.eye(3), (Shape("body", -1, kind, np.array(size), turned),))
    shape, lost = filled_shape(body)
    assert shape is not None and not lost
    assert shape.volume == pytest.approx(volume, rel=POLYGON)
    np.testing.assert_allclose(shape.centroid, turned[:3, 3], atol=1e-12)
    own = turned[:3, :3].T @ shape.second_moment @ turned[:3, :3]
    np.testing.assert_allclose(own, np.diag(moments), rtol=POLYGON, atol=1e-10)


def test_a_capsule_is_as_long_as_its_ends():
    body = DescribedBody(
        "body", 1.0, np.zeros(3), np.eye(3), (Shape("body", -1, "capsule", np.array([0.1, 0.4]), np.eye(4)),)
    )
    shape, _ = filled_shape(body)
    assert shape is not None
    assert shape.volume == pytest.approx(np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 1e-3, rel=POLYGON)
    assert np.ptp(shape.corners[:, 2]) == pytest.approx(0.6)


@pytest.mark.parametrize("seed", range(20))
def test_bodies_that_are_filled_evenly_agree_with_their_shapes(seed):
    rng = np.random.default_rng(seed)
    edges = rng.uniform(0.03, 0.5, 3)
    body = box(edges=edges, density=float(rng.uniform(100.0, 8000.0)), at=float(rng.uniform(-0.5, 0.5) * edges[2]))
    shape, _ = filled_shape(body)
    assert shape is not None
    found = measures_of(body, shape)
    assert found.ratio == pytest.approx(1.0) and found.is_sound
    assert found.reach <= 1.0 / 3.0 + 1e-9  # a third of the bound, which all mass at both ends reaches
    assert not warnings(body)


def test_no_body_inside_its_hull_reaches_the_bound():
    """All mass at the corners is as far out as it can be: the largest moment there is, and no finding."""
    body = box()
    far = np.diag(body.mass * np.array([e @ e for e in (EDGES[[1, 2]], EDGES[[0, 2]], EDGES[[0, 1]])]) / 4.0)
    assert not warnings(replace(body, inertia=far))


@pytest.mark.parametrize(
    ("mass", "com", "inertia", "words"),
    [
        (1e3, 1, 1, "mass is in grams"),
        (1e3, 1, 1e3, "mass and inertia are in grams"),
        (1, 1, 1e6, "kg·mm²"),
        (1, 1, 1e3, "g·m²"),
        (1, 1, 1e9, "g·mm²"),
        (1, 1e3, 1, "centre of mass is in millimetres"),
        (1, 1e3, 1e6, "centre of mass and inertia are in millimetres"),
        (1e3, 1e3, 1e9, "g, mm, g·mm²"),
        (1, 1, 1e-3, "1000 times too small"),
        (1e-3, 1, 1, "mass is 1000 times too small"),
    ],
)
def test_a_wrong_unit_is_named(mass, com, inertia, words):
    body = box()
    wrong = replace(body, mass=mass * body.mass, com=com * body.com, inertia=inertia * body.inertia)
    (finding,) = warnings(wrong)
    assert finding.code == "inertial-unit" and words in finding.evidence.lower() and finding.channel == "rod"
    assert finding.remedy


@pytest.mark.parametrize(("factor", "words"), [(1e3, "drawn in millimetres"), (1e-3, "scaled down")])
def test_meshes_of_another_unit_are_named(tmp_path, factor, words):
    path = write_mesh(tmp_path / "part.stl", *prism())
    shape = Shape("part", -1, "mesh", np.ones(3), np.eye(4), str(path))
    filled, _ = filled_shape(DescribedBody("part", 1.0, np.zeros(3), np.eye(3), (shape,)))
    assert filled is not None
    mass = 1000.0 * filled.volume
    about = mass * (np.trace(filled.second_moment) * np.eye(3) - filled.second_moment)
    body = DescribedBody("part", mass, filled.centroid, about, (shape,))
    assert not warnings(body)
    (finding,) = warnings(replace(body, shapes=(replace(shape, size=factor * shape.size),)))
    assert finding.code == "mesh-unit" and words in finding.evidence.lower()


def test_inertia_about_the_origin_is_named():
    body = box()
    c = body.com
    (finding,) = warnings(replace(body, inertia=body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))))
    assert finding.code == "inertia-about-origin" and "0.2 m" in finding.evidence


def test_copied_numbers_are_named_where_shapes_differ():
    one, small = box("one"), box("small", edges=0.5 * EDGES, at=0.1)
    copy = replace(small, mass=one.mass, com=one.com, inertia=one.inertia)
    assert [f.channel for f in warnings(one, copy) if f.code == "inertial-copied"] == ["one, small"]
    assert check_bodies([one, copy, box("sound", edges=2.0 * EDGES)]).named == ("one", "small")
    assert not warnings(one, replace(one, name="other side"))


@pytest.mark.parametrize("moment", [0.0, 1e-4, 1e-3, 1.0])
def test_a_placeholder_is_named(moment):
    (finding,) = warnings(replace(box(), inertia=moment * np.eye(3)))
    assert finding.code == "inertial-placeholder"


def test_a_cube_may_have_equal_moments():
    assert not warnings(box(edges=np.full(3, 0.1), at=0.0))


def test_numbers_without_a_cause_are_told_one_by_one():
    body = box()
    assert [f.code for f in warnings(replace(body, com=body.com + np.array([0.0, 0.15, 0.0])))] == [
        "com-outside-hull"
    ]
    assert [f.code for f in warnings(replace(body, inertia=30.0 * body.inertia))] == ["inertia-too-large"]
    assert [f.code for f in warnings(replace(body, inertia=0.01 * body.inertia))] == ["inertia-too-small"]
    heavy = 2.0 * HEAVIEST / 1000.0
    lead = replace(body, mass=heavy * body.mass, inertia=heavy * body.inertia)
    assert {f.code for f in warnings(lead)} <= {"density-implausible", "inertial-unit"} and warnings(lead)
    assert LIGHTEST < 1000.0 < HEAVIEST


def test_no_body_has_a_moment_above_the_sum_of_the_others():
    (finding,) = warnings(replace(box(), inertia=np.diag([1.0, 1.0, 3.0])))
    assert finding.code == "inertia-impossible"


def test_a_sound_body_has_no_mistake_of_a_unit_in_other_units_too():
    """A correction is only looked for where something is wrong; for a sound body the first candidates do not fit."""
    body = box()
    shape, _ = filled_shape(body)
    assert shape is not None and unit_mistake(body, shape) is None


def test_what_cannot_be_examined_is_said(tmp_path):
    gone = Shape("rod", -1, "mesh", np.ones(3), np.eye(4), str(tmp_path / "gone.stl"))
    lost = check_bodies([replace(box(), shapes=(gone,)), replace(box("bare"), shapes=())])
    (finding,) = lost.findings
    assert finding.code == "shapes-not-examined" and "gone.stl" in finding.evidence and "bare" in finding.evidence
    assert not lost.measures and lost.without_shapes == ("bare",)


def test_part_of_the_shapes_is_no_basis(tmp_path):
    """A body beside the one mesh of two that was found is not called outside its hull."""
    gone = Shape("rod", -1, "mesh", np.ones(3), np.eye(4), str(tmp_path / "gone.stl"))
    body = box()
    assert not warnings(replace(body, com=body.com + np.array([0.0, 0.5, 0.0]), shapes=(*body.shapes, gone)))


@pytest.mark.collision
def test_meshes_of_every_format_give_one_hull(tmp_path):
    vertices, faces = prism()
    (tmp_path / "part.dae").write_text(collada(vertices, faces))
    paths = [write_mesh(tmp_path / f"part{end}", vertices, faces) for end in (".stl", ".obj")]
    volumes = []
    for path in (*paths, tmp_path / "part.dae"):
        shape = Shape("part", -1, "mesh", np.ones(3), np.eye(4), str(path))
        filled, lost = filled_shape(DescribedBody("part", 1.0, np.zeros(3), np.eye(3), (shape,)))
        assert filled is not None and not lost
        volumes.append(filled.volume)
    np.testing.assert_allclose(volumes, volumes[0], rtol=1e-5)  # an STL has single precision


URDF = """<robot name="two">
  <link name="base"><inertial><mass value="5"/><inertia ixx="9" ixy="0" ixz="0" iyy="9" iyz="0" izz="9"/></inertial>
  </link>
  <link name="arm">
    <inertial><origin xyz="0 0 0.2" rpy="0 0 {turn}"/><mass value="{mass}"/>
      <inertia ixx="0.0266240" ixy="0" ixz="0" iyy="0.0261760" iyz="0" izz="0.0016000"/></inertial>
    <visual><origin xyz="0 0 0.2" rpy="0 0 {turn}"/><geometry><box size="0.06 0.08 0.4"/></geometry></visual>
  </link>
  <link name="tool">
    <inertial><origin xyz="0 0 0.05"/><mass value="1.0"/>
      <inertia ixx="0.0015" ixy="0" ixz="0" iyy="0.0014" iyz="0" izz="0.0016"/></inertial>
    <collision><origin xyz="0 0 0.05"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 0.4"/></joint>
</robot>
"""

MJCF = """<mujoco model="two"><worldbody>
  <geom type="sphere" size="0.01" pos="1 0 0" contype="0" conaffinity="0"/>
  <body name="arm"><joint name="turn" type="hinge" axis="0 1 0" range="-57 57" armature="0.1"/>
    <inertial pos="0 0 0.2" mass="{mass}" diaginertia="0.0266240 0.0261760 0.0016000"/>
    <geom type="box" size="0.03 0.04 0.2" pos="0 0 0.2"/>
    <body name="tool" pos="0 0 0.4"><inertial pos="0 0 0.05" mass="1.0" diaginertia="0.0015 0.0014 0.0016"/>
      <geom type="box" size="0.05 0.05 0.05" pos="0 0 0.05"/></body>
    <body name="computed"><geom type="box" size="0.05 0.05 0.05"/></body>
  </body>
</worldbody></mujoco>
"""


def written(folder: Path, text: str, suffix: str, **numbers: float) -> Path:
    path = folder / f"two{suffix}"
    path.write_text(text.format(**{"mass": 1.92, "turn": 0.0, **numbers}))
    return path


@pytest.mark.parametrize(("text", "suffix"), [(URDF, ".urdf"), (MJCF, ".xml")])
def test_bodies_on_fixed_joints_are_examined_one_by_one(tmp_path, text, suffix):
    """The base does not move, and MuJoCo computes the third body of the MJCF from its shape."""
    robot = load_robot(written(tmp_path, text, suffix))
    assert [body.name for body in described_bodies(robot)] == ["arm", "tool"]
    found = check_inertials(robot)
    assert set(found.measures) == {"arm", "tool"} and found.bodies == 2
    assert not [f for f in found.findings if f.severity == "warning"]
    assert found.measures["arm"].ratio == pytest.approx(1.0, abs=0.01)
    assert [f.code for f in found.findings] == (["armature-missing"] if suffix == ".urdf" else [])


def test_turned_axes_of_an_inertial_are_those_of_the_link(tmp_path):
    (arm, _) = described_bodies(load_robot(written(tmp_path, URDF, ".urdf", turn=np.pi / 2)))
    np.testing.assert_allclose(np.diag(arm.inertia), [0.026176, 0.026624, 0.0016], rtol=1e-9)


def test_a_locked_joint_leaves_its_body_with_the_arm_that_moves(tmp_path):
    text = URDF.replace('name="weld" type="fixed"', 'name="weld" type="revolute"')
    path = written(tmp_path, text, ".urdf")
    assert len(described_bodies(load_robot(path, lock="weld"))) == 2
    assert [body.name for body in described_bodies(load_robot(path, lock="turn"))] == ["tool"]


def test_a_built_in_arm_has_bodies_without_shapes():
    found = check_inertials(load_robot("ur10e"))
    assert found.bodies == 6 and not found.measures and not [f for f in found.findings if f.severity == "warning"]


def test_certify_names_a_mass_in_grams(tmp_path, capsys):
    path = written(tmp_path, URDF, ".urdf", mass=1920.0)
    assert exit_code("certify", path) == 0  # the body is possible, but not with this shape
    shown = capsys.readouterr()
    assert "shapes: 2 of 2 bodies" in shown.out and "1 does not agree" in " ".join(shown.out.split())
    assert "inertial-unit" in shown.err and "arm" in shown.err
    assert exit_code("certify", path, "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["shapes"]["compared"]["arm"]["density"] == pytest.approx(1e6)
    assert "inertial-unit" in [finding["code"] for finding in record["findings"]]


def test_values_are_not_compared_with_shapes(tmp_path, capsys):
    path, values = written(tmp_path, URDF, ".urdf", mass=1920.0), tmp_path / "values.json"
    ones, zeros = ("m", "Ixx", "Iyy", "Izz"), ("rx", "ry", "rz", "Ixy", "Ixz", "Iyz")
    values.write_text(json.dumps({f"{name}_1": float(name in ones) for name in (*ones, *zeros)}))
    assert exit_code("certify", path, values) == 0
    assert "shapes:" not in capsys.readouterr().out


@pytest.mark.parametrize("semi_axes", [(0.01, 0.01, 0.2), (0.1, 0.02, 0.05)])
def test_an_ellipsoid_is_sound_with_its_own_inertia_and_not_with_that_of_a_sphere(tmp_path, semi_axes):
    mass = 4000.0 / 3.0 * np.pi * np.prod(semi_axes)
    moments = mass / 5.0 * (np.sum(np.square(semi_axes)) - np.square(semi_axes))
    path = tmp_path / "arm.xml"

    def text(size, moments) -> str:
        inertial = f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{" ".join(map(str, moments))}"/>'
        geom = f'<geom type="ellipsoid" size="{" ".join(map(str, size))}"/>'
        return (
            '<mujoco><worldbody><body name="a"><joint name="j" armature="0.1"/>'
            f"{inertial}{geom}</body></worldbody></mujoco>"
        )

    path.write_text(text(semi_axes, moments))
    found = check_inertials(load_robot(path))
    assert found.measures["a"].density == pytest.approx(1000.0, rel=POLYGON)
    assert found.measures["a"].ratio == pytest.approx(1.0, rel=POLYGON)
    assert not found.findings
    path.write_text(text(semi_axes, np.full(3, 0.4 * mass * max(semi_axes) ** 2)))
    assert [finding.channel for finding in check_inertials(load_robot(path)).findings] == ["a"]

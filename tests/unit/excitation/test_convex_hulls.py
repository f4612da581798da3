"""Convex bodies closer around bodies than capsules: what they hold, how they are measured, which pairs need them."""

from __future__ import annotations

import pickle
import struct

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.collision import coal
from armid.excitation.collision.capsules import covering
from armid.excitation.collision.collision_model import collision_of, collision_options, make_collision_model
from armid.excitation.collision.distances import floor
from armid.excitation.collision.hull_distances import Hulls, polyhedron, prism
from armid.excitation.collision.mesh_hulls import hull_points
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics
from armid.robot.shapes import Shape
from distances import CORNERS, slopes_wrong

pytestmark = pytest.mark.collision

ROUNDING = 1e-12
"""Metres by which points of a body may be outside the hull that they made."""

SOLVER = 1e-4
"""Coal iterates for cylinders and stops within so many metres."""

PRISM = 0.06 * (1.0 / np.cos(np.pi / 32) - 1.0)
"""Distance by which the corners of the prism exceed a cylinder of 60 mm [m]."""

ELBOW = """<robot name="elbow"><link name="base"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="post"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="50"/></joint><link name="post"/>
<joint name="lift" type="revolute"><parent link="post"/><child link="upper"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.6"/><limit lower="-1" upper="1" velocity="2" effort="50"/></joint>
<link name="upper"><collision><origin xyz="0 0 0.15"/>
<geometry><cylinder radius="0.06" length="0.3"/></geometry></collision></link>
<joint name="roll" type="revolute"><parent link="upper"/><child link="between"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.33"/><limit lower="-3" upper="3" velocity="2" effort="50"/></joint><link name="between"/>
<joint name="bend" type="revolute"><parent link="between"/><child link="knee"/><axis xyz="0 1 0"/>
<limit lower="-1.3" upper="1.3" velocity="2" effort="50"/></joint><link name="knee"/>
<joint name="twist" type="revolute"><parent link="knee"/><child link="fore"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.04"/><limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<link name="fore"><collision><origin xyz="0 0 0.15"/>
<geometry><cylinder radius="0.06" length="0.3"/></geometry></collision></link></robot>"""
"""Two cylinders, 70 mm apart where the arm is straight; capsules around them overlap in every pose."""

STRAIGHT = np.zeros(5)
PAIR = "upper - fore"


@pytest.fixture
def elbow(tmp_path):
    path = tmp_path / "elbow.urdf"
    path.write_text(ELBOW)
    return load_robot(str(path))


def tetrahedra(path, corners):
    """A mesh of the sides of tetrahedra (k, 4, 3), as binary STL."""
    sides = [
        body[[a, b, c]] for body in np.asarray(corners) for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    ]
    facets = [struct.pack("<12fH", 0.0, 0.0, 0.0, *side.ravel(), 0) for side in sides]
    path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))
    return str(path)


def outside(points, hull):
    """Tell how far points (v, 3) are outside a hull at most [m]."""
    return float((points @ hull.equations[:, :3].T + hull.equations[:, 3]).max())


def test_a_prism_goes_around_its_cylinder_closely():
    angle = np.linspace(0.0, 2.0 * np.pi, 997)
    ring = 0.06 * np.column_stack([np.cos(angle), np.sin(angle)])
    rims = np.vstack([np.column_stack([ring, np.full(len(ring), z)]) for z in (-0.15, 0.15)])
    corners = prism(0.06, 0.3)
    assert outside(rims, hull_points(corners)) < ROUNDING
    assert np.hypot(*corners[:, :2].T).max() == pytest.approx(0.06 + PRISM)
    assert (np.abs(corners[:, 2]) == 0.15).all()


def test_a_flat_body_has_a_hull():
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    assert outside(flat, hull_points(flat)) < ROUNDING


def test_between_capsules_and_bodies(elbow, tmp_path):
    """No hull is closer than its capsules, none further than the bodies; what is convex already is as it is."""
    rng = np.random.default_rng(4)
    mesh = Shape(
        "star", 4, "mesh", np.ones(3), np.eye(4), tetrahedra(tmp_path / "star.stl", rng.normal(size=(3, 4, 3)) * 0.1)
    )
    block = Shape("block", -1, "box", np.array([0.2, 0.3, 0.1]), np.eye(4))
    ball = Shape("ball", 1, "sphere", np.array([0.1]), np.eye(4))
    shapes = (*elbow.shapes, mesh, block, ball, floor(-0.2))
    pairs = np.array([[0, 1], [0, 2], [3, 1], [3, 2], [4, 1], [4, 2], [1, 5], [2, 5], [4, 5]])
    poses = forward_kinematics(elbow, rng.uniform(-1.2, 1.2, (60, 5)))
    hulls = Hulls(shapes, pairs, np.arange(len(pairs)))
    distance, first, second, normal = hulls.nearest(poses)
    bodies = coal.distances(shapes, pairs, poses)
    apart = bodies > 0.0
    assert (distance <= bodies + SOLVER)[apart].all()
    assert np.abs(distance - bodies)[:, -1].max() < SOLVER  # a sphere over the floor
    assert (distance >= bodies - PRISM - SOLVER)[:, [0, 2, 4, 6]].all()  # cylinders
    gap = first - second
    np.testing.assert_allclose(gap, distance[..., None] * normal, atol=1e-9)


def test_a_pair_that_needs_them_is_looked_at(elbow):
    """Capsules overlap always, bodies do not: the pair is kept apart, with exact gradients and a certificate."""
    limits = limits_of(elbow)
    cell = make_collision_model(elbow, limits, margin=0.02)
    k = cell.bodies.labels.index(PAIR)
    assert 0.2 < cell.touching[k] < 0.8 and not cell.required.kind[k]
    made = collision_options(cell, STRAIGHT)
    assert made.skipped == () and made.every.labels == (PAIR,)
    assert made.searched is not None and made.searched.labels == (PAIR,)
    bent = np.array([0.0, 0.0, 0.0, 1.2, 0.0])
    with pytest.raises(ArmidError, match=f"In the start pose, the distance between {PAIR} is"):
        collision_options(cell, bent)
    for size in (0.15, 0.4):
        wrong, corners = slopes_wrong(elbow, STRAIGHT, made.every, size)
        assert not wrong and corners < CORNERS
    model = DynamicsModel(elbow, (RigidBody(),))
    goal, basis = CriterionGoal(model, find_base_parameters(model)), SeriesBasis(1.0, 4, STRAIGHT)
    x = 0.3 * np.random.default_rng(2).normal(size=basis.unknowns)
    coarse, fine = (States(Objective(goal, basis, samples), x) for samples in (200, 2000))
    seen = made.every.values(coarse).max(axis=0) + made.every.between(coarse, basis.period / 200)
    assert (made.every.values(fine).max(axis=0) <= seen).all()
    sent = pickle.loads(pickle.dumps(made.every))
    np.testing.assert_array_equal(sent.values(coarse), made.every.values(coarse))


def test_pairs_keep_their_hulls_when_some_are_chosen(elbow):
    made = collision_of(elbow, limits_of(elbow), STRAIGHT, [floor(-1.0)], margin=0.02)
    bodies, poses = made.every.bodies, forward_kinematics(elbow, STRAIGHT[None])
    assert set(bodies.labels) == {PAIR, "upper - floor", "fore - floor"}
    for k, label in enumerate(bodies.labels):
        one = bodies.only([k])
        assert one.labels == (label,)
        assert one.nearest(poses)[0][0] == bodies.nearest(poses)[0][0, k]
        assert len(one.hulls) == (label == PAIR)
    assert bodies.nearest(poses)[0][0, bodies.labels.index(PAIR)] == pytest.approx(0.07)


def test_a_start_pose_is_refused_for_bodies_and_not_for_capsules(elbow):
    """Capsules that touch in a few poses, the start among them, are no reason where the bodies are apart."""
    shelf = Shape("shelf", -1, "box", np.array([0.4, 0.4, 0.02]), np.eye(4))
    shelf = shelf.on(-1, np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1.32], [0, 0, 0, 1]]))
    cell = make_collision_model(elbow, limits_of(elbow), [shelf], margin=0.005)
    k = cell.bodies.labels.index("fore - shelf")
    assert cell.touching[k] < 0.5 and cell.distances(STRAIGHT[None])[0, k] < 0.0
    made = collision_options(cell, STRAIGHT)
    assert "fore - shelf" in made.every.labels


@pytest.mark.parametrize("semi_axes", [(0.05, 0.1, 0.02), (0.1, 0.05, 0.05), (0.03, 0.06, 0.06), (0.04, 0.04, 0.04)])
def test_what_encloses_an_ellipsoid(semi_axes):
    """Capsule and polyhedron hold all points of its surface, and the capsule touches it."""
    size = np.array(semi_axes)
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points = np.vstack([points / np.linalg.norm(points, axis=1)[:, None], np.eye(3), -np.eye(3)]) * size
    (capsule,) = covering(Shape("a", -1, "ellipsoid", size, np.eye(4)))
    along = capsule.placement[:3, 2]
    beside = np.clip(points @ along, -0.5 * capsule.size[1], 0.5 * capsule.size[1])
    apart = np.linalg.norm(points - beside[:, None] * along, axis=1) - capsule.size[0]
    assert abs(apart.max()) < ROUNDING
    assert 0.5 * capsule.size[1] + capsule.size[0] == pytest.approx(size.max())
    hull = hull_points(polyhedron(size))
    assert (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max() < ROUNDING
    assert np.abs(hull.points / size).max() < 1.03


def test_distance_of_an_ellipsoid():
    """Two ellipsoids whose nearest points are known, as Coal measures the bodies, and with polyhedra around them."""
    R, p = np.tile(np.eye(3), (1, 2, 1, 1)), np.array([[[0.0, 0, 0], [0.5, 0, 0]]])
    shapes = tuple(Shape(f"{k}", k, "ellipsoid", np.array([0.1, 0.2, 0.3]), np.eye(4)) for k in range(2))
    pairs = np.array([[0, 1]])
    assert coal.distances(shapes, pairs, (R, p), coal.whole)[0, 0] == pytest.approx(0.3, abs=SOLVER)
    around = Hulls(shapes, pairs, np.arange(1)).distances((R, p))[0, 0]
    assert 0.3 - 0.2 * 0.03 < around <= 0.3 + ROUNDING

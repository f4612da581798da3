"""Distances that are evaluated in few points: segments and boxes, certificates, factors of feasible plans, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from armid.excitation.certification import certified, fine_grid, margins
from armid.excitation.collision.collision_model import collision_of, make_collision_model
from armid.excitation.collision.distances import floor
from armid.excitation.collision.required_distances import MEASURED
from armid.excitation.collision.segment_distances import nearest_on_box
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.sqp import DescentProblem, about_start, max_utilisation, shrink_to_feasible
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.maths.rotations import homogeneous
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.robot.shapes import Shape

ROUNDING = 1e-9
"""Of distances of the size of a metre, which are roots of sums of squares."""


def signed_distance(point, half):
    """Distance of points from a box, negative inside by the nearest face."""
    beyond = np.abs(point) - half
    deepest = beyond.max(axis=-1)
    return np.where(deepest > 0.0, np.linalg.norm(np.maximum(beyond, 0.0), axis=-1), deepest)


def test_no_point_of_a_segment_is_nearer_to_a_box_than_the_nearest():
    """Segments in all directions, along the axes, of no length, beside, through and inside the box."""
    rng = np.random.default_rng(3)
    a, u = rng.normal(size=(2, 4000, 3))
    u[:500, 0], u[500:700, :2], u[700:800] = 0.0, 0.0, 0.0
    a[1000:2000] *= 0.2
    half = np.array([0.5, 0.3, 0.8])
    place, distance, slope = nearest_on_box(a, u, half)
    along = np.linspace(0.0, 1.0, 301)[:, None, None]
    assert (distance <= signed_distance(a + along * u, half).min(axis=0) + ROUNDING).all()
    np.testing.assert_allclose(signed_distance(a + place[:, None] * u, half), distance, atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(slope, axis=-1), 1.0, atol=ROUNDING)


@pytest.fixture(scope="module")
def problem():
    """An arm among a box, a ball and a floor, on a motion of several blocks of the certificate."""
    robot, start = load_robot("ur5e"), np.array([0.0, -1.5, 1.0, -1.0, -1.5, 0.0])
    around = (
        floor(-0.3),
        Shape("crate", -1, "box", np.array([0.3, 0.2, 0.4]), homogeneous(np.eye(3), [0.9, 0.3, 0.4])),
        Shape("ball", -1, "sphere", np.array([0.15]), homogeneous(np.eye(3), [-0.9, 0.2, 0.6])),
    )
    made = collision_of(robot, limits_of(robot), start, around, margin=0.01)
    model = DynamicsModel(robot, (RigidBody(),))
    basis = SeriesBasis(2.0 * np.pi / 3.1, 4, start)
    return DescentProblem(CriterionGoal(model, find_base_parameters(model)), basis, (made.every,))


@pytest.mark.collision
def test_a_certificate_holds_and_is_exact_for_bodies_that_come_near(problem):
    """Pairs within `SCALE` of what they keep are evaluated in every point of the grid; no pair is ever nearer."""
    rng = np.random.default_rng(1)
    x = shrink_to_feasible(problem, problem.fine, rng.normal(size=problem.basis.unknowns))
    x, found = certified(problem, fine_grid(problem), x)
    (channel,) = problem.channels
    dense = problem.grid(4 * sum(len(chunk.times) for chunk in fine_grid(problem)))
    actual = channel.values(States(dense, x)).max(axis=0)
    grid = np.max([channel.values(States(chunk, x)).max(axis=0) for chunk in fine_grid(problem)], axis=0)
    bound, reached = np.array([each.certified for each in found]), np.array([each.share for each in found])
    assert (actual <= bound + ROUNDING).all() and bound.max() <= 1.0
    near = bound > 0.0
    assert near.any() and not near.all()
    np.testing.assert_allclose(reached[near], grid[near], atol=ROUNDING)
    assert [each.certified for each in margins(problem, fine_grid(problem), x)] == bound.tolist()


@pytest.mark.collision
def test_a_motion_is_shrunk_into_the_limits_and_no_further(problem):
    """Within 1e-3 above the factor that bisections find, some motion leaves the limits."""
    drawn = [3.0 * np.random.default_rng(seed).normal(size=problem.basis.unknowns) for seed in range(8)]
    outside = [x for x in drawn if max_utilisation(problem, problem.fine, x) > 1.0]
    assert outside
    for x in outside:
        inside = shrink_to_feasible(problem, problem.fine, x)
        assert max_utilisation(problem, problem.fine, inside) <= 1.0 + ROUNDING
        larger = [about_start(problem.basis, inside, factor) for factor in np.linspace(1.0, 1.001, 20)]
        assert max(max_utilisation(problem, problem.fine, each) for each in larger) > 1.0


def disc(path, radius, centre, *, inner=0.0):
    """A disc or a ring of 60 mm height about z, as a mesh [m]; the inside of a ring is off the centre, too."""
    angle = 2.0 * np.pi * np.arange(96) / 96
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    outer, hole = radius * ring + (0.0 if inner else 1.0) * np.array([centre, 0.0]), inner * ring + [centre, 0.0]
    corners = [(*xy, z) for part in (outer, hole) for z in (-0.03, 0.03) for xy in part.tolist()]
    faces: list[tuple[int, int, int]] = []
    k, after = np.arange(96), np.roll(np.arange(96), -1)
    for a, b in ((0, 1), (3, 2), (1, 3), (2, 0)):  # outside, inside, top, bottom
        one, other = 96 * a + 1, 96 * b + 1
        faces += [
            *zip(one + k, one + after, other + after, strict=True),
            *zip(one + k, other + after, other + k, strict=True),
        ]
    path.write_text(
        "".join("v {!r} {!r} {!r}\n".format(*corner) for corner in corners)
        + "".join(f"f {a} {b} {c}\n" for a, b, c in faces)
    )


@pytest.mark.collision
def test_bodies_that_turn_about_each_other_across_a_gap_keep_a_part_of_it_that_excludes_no_pose(tmp_path):
    """A pin in a bush, each a little off its centre: the gap is 0.4 to 2 mm in all poses, and hulls know of none."""
    disc(tmp_path / "bush.obj", 0.07, 0.0008, inner=0.05)
    disc(tmp_path / "pin.obj", 0.048, 0.0008)
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="9"/></joint>'
    )
    body = '<collision><geometry><mesh filename="{}.obj"/></geometry></collision>'
    (tmp_path / "hinge.urdf").write_text(
        f'<robot name="hinge"><link name="bush">{body.format("bush")}</link><link name="between"/>'
        f'<link name="pin">{body.format("pin")}</link>'
        + joint.format("one", "bush", "between")
        + joint.format("two", "between", "pin")
        + "</robot>"
    )
    robot = load_robot(tmp_path / "hinge.urdf")
    cell = make_collision_model(robot, limits_of(robot))
    assert cell.required.kind.tolist() == [MEASURED]
    assert 1e-4 < cell.required.margin[0] < 4e-4
    assert cell.apart(np.random.default_rng(5).uniform(-3.0, 3.0, (200, 2))).all()

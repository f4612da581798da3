"""Distances of bodies: against Coal, with exact gradients, and what a plan keeps apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.certification import fine_grid, margins
from armid.excitation.collision import coal
from armid.excitation.collision.collision_model import collision_of, collision_options, make_collision_model
from armid.excitation.collision.distances import floor
from armid.excitation.collision.environment import load_environment
from armid.excitation.collision.mesh_hulls import capsules_of
from armid.excitation.collision.required_distances import LEFT_OUT
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.design.sqp import DescentProblem, shrink_to_feasible
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.limits.workspace import SCALE
from armid.excitation.preflight import preflight
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.start_pose import choose_start, free_range, usual_pose
from armid.maths.rotations import homogeneous
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics
from armid.robot.shapes import Shape, capsule_between
from distances import CORNERS, slopes_wrong
from trees import random_rotation

pytestmark = pytest.mark.collision

SOLVER = 1e-4
"""Coal iterates for boxes and stops within so many metres."""

ARMS = ("iiwa14-r820", "iiwa7-r800", "panda", "ur5e", "ur10e")

START = {"panda": [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0]} | {
    name: [0.0, -1.5, 1.0, -1.0, -1.5, 0.0] for name in ("ur5e", "ur10e")
}


def surroundings():
    rng = np.random.default_rng(8)
    turned = homogeneous(random_rotation(rng), [0.9, 0.3, 0.4])
    return (
        floor(-0.3),
        Shape("crate", -1, "box", np.array([0.3, 0.2, 0.4]), turned),
        Shape("ball", -1, "sphere", np.array([0.15]), homogeneous(np.eye(3), [-0.9, 0.2, 0.6])),
    )


@pytest.fixture(scope="module", params=ARMS)
def collision(request):
    robot = load_robot(request.param)
    start = np.array(START.get(request.param, np.zeros(robot.n)))
    return robot, start, collision_of(robot, limits_of(robot), start, surroundings(), margin=0.01)


def test_as_coal_measures_it(collision):
    """Capsules, spheres, boxes and half-spaces as an independent library has them, wherever they do not overlap."""
    robot, _, made = collision
    rng = np.random.default_rng(0)
    limits = limits_of(robot)
    poses = forward_kinematics(robot, rng.uniform(limits.lower, limits.upper, (40, robot.n)))
    mine = made.every.bodies.nearest(poses)[0]
    theirs = coal.distances(made.shapes, made.pairs, poses)
    apart = mine > 1e-3
    assert apart.mean() > 0.8
    assert np.abs(mine - theirs)[apart].max() < SOLVER
    assert (theirs[mine < -1e-3] < SOLVER).all()


@pytest.mark.parametrize("size", [0.15, 0.5])
def test_gradient(collision, size):
    """Of every pair in every sample, apart or overlapping; see `distances.slopes_wrong` for what is no derivative."""
    robot, start, made = collision
    wrong, corners = slopes_wrong(robot, start, made.every, size)
    assert not wrong
    assert corners < CORNERS


def test_nothing_hides_between_the_points_of_a_grid(collision):
    robot, start, made = collision
    model = DynamicsModel(robot, (RigidBody(),))
    goal = CriterionGoal(model, find_base_parameters(model))
    basis = SeriesBasis(1.0, 4, start)
    x = 0.15 * np.random.default_rng(2).normal(size=basis.unknowns)
    coarse, fine = (States(Objective(goal, basis, samples), x) for samples in (200, 2000))
    seen = made.every.values(coarse).max(axis=0) + made.every.between(coarse, basis.period / 200)
    assert (made.every.values(fine).max(axis=0) <= seen).all()


def test_the_certificate_of_a_long_motion_asks_for_no_more_than_its_speed():
    """A rough bound does far from the floor; it is none for an arm that is near."""
    robot = load_robot("ur10e")
    start = np.array([0.0, -1.57, 0.5, 0.0, 0.5, 0.0])
    made = collision_of(robot, limits_of(robot), start, [floor()])
    model = DynamicsModel(robot, (RigidBody(),))
    basis = SeriesBasis(2.0 * np.pi / 10.0, 4, start)
    problem = DescentProblem(CriterionGoal(model, find_base_parameters(model)), basis, (made.every,))
    x = shrink_to_feasible(problem, problem.fine, basis.project(np.random.default_rng(1).normal(size=(6, 9))))
    assert x is not None
    grid = fine_grid(problem)
    assert len(grid) > 1
    near = [margin for margin in margins(problem, grid, x) if margin.share > 0.5]
    assert near
    # No point of this arm is faster than its joints together at its reach; half a step of a millisecond.
    fastest = 1.5 * np.abs(States(problem.fine, x).derivatives[1]).max(axis=0).sum()
    assert all(margin.certified - margin.share < 0.0005 * fastest / SCALE for margin in near)


@pytest.mark.parametrize("name", ["iiwa14-r820", "ur5e"])
def test_the_closest_approach_of_a_slow_motion_is_that_of_all_its_poses(name):
    """Looking at few poses finds what looking at all of them does."""
    robot = load_robot(name)
    start = np.array(START.get(name, np.zeros(robot.n)))
    made = collision_of(robot, limits_of(robot), start, surroundings(), margin=0.01)
    model = DynamicsModel(robot, (RigidBody(),))
    basis = SeriesBasis(2.0 * np.pi / 20.0, 3, start)
    x = 0.1 * np.random.default_rng(2).normal(size=basis.unknowns)
    problem = DescentProblem(CriterionGoal(model, find_base_parameters(model)), basis, (made.every,))
    found = {each.pair: each.distance for each in preflight(problem, x, made).approaches}
    q = basis.excitation(x).sample(50.0).q
    every = coal.distances(made.shapes, made.pairs, forward_kinematics(robot, q)).min(axis=0)
    for label, distance in zip(made.every.labels, every, strict=True):
        assert found[label] == pytest.approx(distance, abs=SOLVER)


def inside(capsules, points):
    """Tell how far points lie outside the nearest of capsules that the base carries, shape (v,)."""
    distances = []
    for capsule in capsules:
        local = (points - capsule.placement[:3, 3]) @ capsule.placement[:3, :3]
        beyond = np.maximum(np.abs(local[:, 2]) - 0.5 * capsule.size[1], 0.0)
        distances.append(np.hypot(np.hypot(local[:, 0], local[:, 1]), beyond) - capsule.size[0])
    return np.min(distances, axis=0)


def test_capsules_go_around_bodies(tmp_path):
    """Every point of every triangle of a body lies in one of its capsules, also where a body is cut."""
    rng = np.random.default_rng(3)
    placement = homogeneous(random_rotation(rng), rng.normal(size=3))
    box = Shape("box", 0, "box", np.array([0.2, 0.1, 0.5]), placement)
    # An elbow: two boxes at right angles, of large triangles.
    bent = np.concatenate(
        [box_triangles([0.1, 0.1, 0.6], [0, 0, 0.3]), box_triangles([0.6, 0.1, 0.1], [0.3, 0, 0.6])]
    )
    some = rng.normal(size=(9, 3, 3))
    for shape, triangles in (
        (box, box_triangles(box.size, [0, 0, 0])),
        (mesh_of(bent, tmp_path / "bent.obj", placement), bent),
        (mesh_of(some, tmp_path / "some.obj", placement), some),
    ):
        capsules = capsules_of(shape)
        weights = rng.dirichlet(np.ones(3), 2000)
        points = np.einsum("vk,vkx->vx", weights, triangles[rng.integers(len(triangles), size=2000)])
        assert inside(capsules, points @ placement[:3, :3].T + placement[:3, 3]).max() < 1e-9
        assert len(capsules) > 1 or triangles is not bent


def mesh_of(triangles, path, placement):
    """A body of triangles in a file."""
    corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in triangles.reshape(-1, 3).tolist())
    path.write_text(corners + "".join(f"f {k} {k + 1} {k + 2}\n" for k in range(1, 3 * len(triangles), 3)))
    return Shape("mesh", 0, "mesh", np.ones(3), placement, str(path))


def box_triangles(size, centre):
    """Two triangles a side."""
    corners = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size + centre
    faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    return np.array([corners[[a, b, c]] for a, b, c, d in faces] + [corners[[a, c, d]] for a, b, c, d in faces])


def test_neighbours_are_skipped_and_others_refused():
    robot = load_robot("iiwa14-r820")
    limits = limits_of(robot)
    made = collision_of(robot, limits, np.zeros(7), [floor()])
    assert "link_1 - link_2" not in made.every.labels
    assert "base - floor" not in made.every.labels
    low = Shape("shelf", -1, "box", np.array([1.0, 1.0, 0.1]), homogeneous(np.eye(3), [0.0, 0.0, 1.2]))
    with pytest.raises(ArmidError, match=r"In the start pose, the distance between link_\d - shelf"):
        collision_of(robot, limits, np.zeros(7), [low])
    with pytest.raises(ArmidError, match="contains no shapes of the links"):
        collision_of(load_robot("iiwa14-r820").__class__(
            robot.name, robot.joints, robot.links, robot.tip), limits, np.zeros(7))  # fmt: skip


def ball(name, link, radius):
    return Shape(name, link, "sphere", np.array([radius]), np.eye(4))


def test_what_touches_in_every_pose_is_left_out_and_told():
    """However many joints apart; what touches in most poses only has to be near, and is told apart from that."""
    iiwa = load_robot("iiwa14-r820")
    limits = limits_of(iiwa)
    # Elbow and flange are 0.4 m apart and a little more; elbow and base between 0.3 and 0.8 m.
    robot = replace(iiwa, shapes=(ball("foot", -1, 0.3), ball("elbow", 3, 0.3), ball("flange", 6, 0.3)))
    bent = np.array([0.0, 0.4, 0.0, -1.5, 0.0, 0.0, 0.0])
    made = collision_of(robot, limits, bent, margin=0.01)
    assert [(each.pair, each.share) for each in made.skipped] == [("elbow - flange", 1.0)]
    assert made.every.labels == ("foot - elbow", "foot - flange")
    robot = replace(iiwa, shapes=(ball("foot", -1, 0.36), ball("elbow", 3, 0.35)))
    cell = make_collision_model(robot, limits, margin=0.01)
    assert 0.5 < cell.touching[0] < 0.98 and not cell.required.kind.any()


def test_links_that_are_built_close_keep_part_of_what_is_between_them():
    """They may collide, so they are looked at, but what is asked of others would leave them no pose."""
    near = load_robot("panda")
    tight = make_collision_model(near, limits_of(near))
    k = tight.bodies.labels.index("link_5 - link_7")
    assert 0.5 < tight.touching[k] < 0.99 and tight.required.kind[k] != LEFT_OUT
    made = collision_options(tight, np.array(START["panda"]))
    assert "link_5 - link_7" in made.every.labels
    distance = made.every.bodies.distances(forward_kinematics(near, np.array([START["panda"]])))[0]
    assert (distance > made.every.margins).all()


def test_the_floor_is_touched_by_construction_by_the_first_link_alone():
    """An upper arm whose shoulder is always near the floor still could go through it."""
    iiwa = load_robot("iiwa14-r820")
    limits = limits_of(iiwa)
    robot = replace(iiwa, shapes=(ball("shoulder", 0, 0.4), ball("upper arm", 1, 0.4)))
    cell = make_collision_model(robot, limits, [floor()])
    assert dict(zip(cell.bodies.labels, cell.required.of(LEFT_OUT), strict=True)) == {
        "shoulder - floor": True,
        "upper arm - floor": False,
    }
    with pytest.raises(ArmidError, match="In the start pose, the distance between upper arm - floor is 0 mm"):
        collision_of(robot, limits, np.zeros(7), [floor()])


def test_of_many_pairs_a_stage_looks_at_those_that_come_near():
    """All where they are few; a ball far away is out, one within reach of the motion stays."""
    robot = load_robot("iiwa14-r820")
    model = DynamicsModel(robot, (RigidBody(),))
    basis = SeriesBasis(1.0, 3, np.zeros(7))
    objective = Objective(CriterionGoal(model, find_base_parameters(model)), basis, 64)
    states = States(objective, np.zeros(basis.unknowns))
    balls = [
        Shape(f"ball {k}", -1, "sphere", np.array([0.05]), homogeneous(np.eye(3), [x, 0.0, 0.8]))
        for k, x in enumerate((0.25, *range(2, 15)))
    ]
    few = collision_of(robot, limits_of(robot), np.zeros(7), balls[:3]).every
    assert few.near(states) is few
    many = collision_of(robot, limits_of(robot), np.zeros(7), balls).every
    distance = many.bodies.nearest(states.poses)[0].min(axis=0)
    near = [label for label, gap in zip(many.labels, distance - many.margins, strict=True) if gap < 0.15]
    assert many.near(states).labels == tuple(near)
    assert any("ball 0" in label for label in near) and not any("ball 9" in label for label in near)


def test_a_carriage_keeps_away_from_the_end_of_its_rail(tmp_path):
    """A first joint that slides brings its link to what stands around."""
    path = tmp_path / "rail.urdf"
    path.write_text(RAIL)
    robot = load_robot(str(path))
    stop = Shape("stop", -1, "box", np.array([0.1, 0.5, 0.5]), homogeneous(np.eye(3), [1.0, 0.0, 0.0]))
    made = collision_of(robot, limits_of(robot), np.zeros(2), [stop])
    assert "carriage - stop" in made.every.labels


RAIL = """<robot name="rail"><link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="5"/></joint>
<link name="carriage"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="carriage"/><child link="arm"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="5"/></joint><link name="arm"/></robot>"""


def test_shapes_follow_links_when_joints_are_locked():
    robot = load_robot("panda")
    q = np.array([[0.3, -0.2, 0.5, -1.4, 0.2, 1.1, 0.4]])
    held = robot.lock({"panda_joint3": 0.5, "panda_joint7": 0.4})
    rest = np.delete(q, [2, 6], axis=1)

    def centres(arm, q):
        R, p = forward_kinematics(arm, q)
        return np.array([
            s.placement[:3, 3] if s.link < 0 else p[0, s.link] + R[0, s.link] @ s.placement[:3, 3] for s in arm.shapes
        ])  # fmt: skip

    assert centres(held, rest) == pytest.approx(centres(robot, q), abs=1e-12)


URDF = """<robot name="arm">
<link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><origin xyz="0 0 0.2"/>
<limit lower="-1" upper="1" velocity="1" effort="5"/></joint>
<link name="a"/>
<joint name="f" type="fixed"><parent link="a"/><child link="b"/>
<origin xyz="0 0 0.5" rpy="0 1.5707963267948966 0"/></joint>
<link name="b">
<collision><origin xyz="0.1 0 0"/><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision>
<collision><geometry><mesh filename="package://none/b.stl"/></geometry></collision>
</link></robot>"""


def test_shapes_of_a_urdf(tmp_path):
    """Bodies behind fixed joints stand where these put them; a mesh that is not there is said to be missing."""
    (tmp_path / "arm.urdf").write_text(URDF)
    robot = load_robot(tmp_path / "arm.urdf")
    box, cylinder = robot.shapes
    assert (box.kind, box.link, box.size.tolist()) == ("box", -1, [0.2, 0.2, 0.1])
    assert (cylinder.kind, cylinder.link) == ("cylinder", 0)
    assert cylinder.placement[:3, 3] == pytest.approx([0.0, 0.0, 0.4])
    assert cylinder.placement[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    assert [finding.code for finding in robot.findings if finding.severity == "warning"] == ["mesh-missing"]


def test_environment(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(
        '[[box]]\nname = "table"\nsize = [1, 2, 0.1]\nxyz = [0, 0, -0.3]\n[[sphere]]\nradius = 0.2\nxyz = [1, 0, 0]\n'
        '[[half-space]]\nname = "wall"\nnormal = [2, 0, 0]\noffset = -1.5\n'
    )
    robot = load_robot("panda")
    table, ball, wall = load_environment(path, robot)
    assert (table.name, ball.name, wall.name) == ("table", "sphere 1", "wall")
    assert wall.placement[:3, 2] == pytest.approx([1.0, 0.0, 0.0])
    assert wall.placement[:3, 3] == pytest.approx([-1.5, 0.0, 0.0])
    for text, problem in (
        ("[[cone]]\nradius = 1", "unknown entry 'cone'"),
        ("[[box]]\nsize = [1, 1, 1]\nplace = [0, 0, 0]", "unknown key 'place'"),
        ("[[sphere]]\nxyz = [0, 0, 0]", "radius"),
        ("[[", "is not valid TOML"),
        (
            '[[sphere]]\nradius = 0.1\nxyz = [0, 0, 0]\nlink = "hand"',
            "panda has no link 'hand', so no link can carry this body",
        ),
    ):
        path.write_text(text)
        with pytest.raises(ArmidError, match=problem):
            load_environment(path, robot)


def test_a_tool_goes_with_its_link(tmp_path):
    """A long tool on the last link comes near what the bare arm stays away from."""
    path = tmp_path / "tool.toml"
    path.write_text('[[box]]\nname = "blade"\nlink = "link_7"\nsize = [0.05, 0.05, 0.6]\nxyz = [0, 0, 0.3]\n')
    robot = load_robot("panda")
    (blade,) = load_environment(path, robot)
    assert blade.link == robot.n - 1
    start = np.array(START["panda"])
    bare, armed = (collision_of(robot, limits_of(robot), start, (floor(-0.4), *more)) for more in ((), (blade,)))
    poses = forward_kinematics(robot, start[None])
    lowest = [made.every.bodies.nearest(poses)[0][0, made.every.labels.index(name)]
              for made, name in ((bare, "link_7 - floor"), (armed, "blade - floor"))]  # fmt: skip
    assert lowest[1] < lowest[0] - 0.3
    assert "blade - floor" in armed.every.labels and "link_7 - blade" not in armed.every.labels


def test_the_start_that_is_found_has_room():
    """Lying flat on the floor the UR10e has nowhere to go; a pose is found that has, the same every time."""
    robot = load_robot("ur10e")
    limits = limits_of(robot)
    cell = make_collision_model(robot, limits, [floor()])
    found = choose_start(cell, limits)
    usual = free_range(cell, limits, usual_pose(limits))
    assert not found.usual and found.free_share > usual + 0.3
    assert (found.pose == choose_start(cell, limits).pose).all()
    assert cell.excess_distance(found.pose[None])[0] > 0.0
    upright = load_robot("iiwa14-r820")
    assert choose_start(make_collision_model(upright, limits_of(upright), [floor()]), limits_of(upright)).usual
    # Where gravity asks too much of poses that are bent, one that stands is chosen.
    held = choose_start(cell, limits, lambda q: np.abs(q[:, 1] + 1.5) < 0.3)
    assert abs(held.pose[1] + 1.5) < 0.3
    with pytest.raises(ArmidError, match="which its torques can hold"):
        choose_start(cell, limits, lambda q: np.zeros(len(q), dtype=np.bool_))
    full = Shape("block", -1, "box", np.array([3.0, 3.0, 3.0]), homogeneous(np.eye(3), [0.0, 0.0, 1.0]))
    with pytest.raises(ArmidError, match=r"in 100 % bodies are too close \(link_\d - block 100 %"):
        choose_start(make_collision_model(upright, limits_of(upright), [floor(), full]), limits_of(upright))


def test_a_capsule_of_no_size():
    with pytest.raises(ArmidError, match="needs positive sizes"):
        capsule_between("link", 0, [0, 0, 0], [0, 0, 1], 0.0)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (0.0, 0.0, 9.81), (9.81, 0.0, 0.0), (3.0, -4.0, 5.0)])
def test_a_floor_is_where_things_fall(gravity: tuple[float, float, float]):
    below = floor(-1.5, gravity)
    down = np.array(gravity) / np.linalg.norm(gravity)
    np.testing.assert_allclose(below.placement[:3, 2], -down, atol=1e-12)  # out of the floor
    np.testing.assert_allclose(below.placement[:3, 3], 1.5 * down, atol=1e-12)


def test_meshes_that_are_missing_are_what_is_missing(tmp_path):
    """The description has shapes of its links, but the files of the meshes are missing."""
    text = """<robot name="arm"><link name="base"/><link name="a"><collision><geometry>
      <mesh filename="package://arm/a.stl"/></geometry></collision></link>
      <joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    (tmp_path / "arm.urdf").write_text(text)
    robot = load_robot(tmp_path / "arm.urdf")
    with pytest.raises(ArmidError, match=r"(?s)mesh package://arm/a.stl is missing.*--package NAME=DIR"):
        make_collision_model(robot, limits_of(robot))


def test_bounds_of_approach_do_not_depend_on_how_many_poses_are_computed_together(monkeypatch):
    robot = load_robot("ur10e")
    bodies = make_collision_model(robot, limits_of(robot)).bodies
    rng = np.random.default_rng(3)
    poses = forward_kinematics(robot, rng.uniform(-1.0, 1.0, (7, robot.n)))
    for speed in (rng.uniform(0.0, 1.0, robot.n), rng.uniform(0.0, 1.0, (7, robot.n))):
        whole = bodies.approach(poses, robot.tree, speed)
        monkeypatch.setattr("armid.excitation.collision.distances.TILE", 2 * len(bodies.groups))
        np.testing.assert_allclose(bodies.approach(poses, robot.tree, speed), whole, rtol=1e-14)  # order of sums
        monkeypatch.undo()

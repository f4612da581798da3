"""The preview's parts: meshes, ellipsoids, motions for the screen, nearest bodies, and where a page comes from."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.collision.coal import distances
from armid.excitation.collision.collision_model import pairs_of_bodies
from armid.excitation.fourier import save_plan
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.plan import Plan
from armid.excitation.poses_and_sweeps import Moves
from armid.excitation.thesis_plans import builtin_plan
from armid.maths.inertia import com_inertia_to_vector
from armid.measurement.recording import Recording
from armid.report.preview.animation_frames import FRAMES, MAX_FRAMES, Clip, clip_of_plan, clip_of_recording
from armid.report.preview.inertia_ellipsoids import ellipsoid_of
from armid.report.preview.make_preview import preview_of
from armid.report.preview.mesh_simplification import mesh_record, simplified
from armid.report.preview.nearest_bodies import bodies_to_watch, closest
from armid.report.preview.page import Preview, render_preview
from armid.report.preview.scene import bodies_of, joint_records
from armid.robot import Robot, load_robot
from armid.robot.kinematics import forward_kinematics
from armid.robot.shapes import Shape
from armid.study.plans.plan_reading import is_plan, limits_record, read_whole_plan, shape_records
from armid.study.storage.records import to_json
from labs import small_plan, small_recording, write_arm
from reports import Page

EXACT = 1e-9
"""Lengths of metres through eigenvectors and square roots."""

BETWEEN = 1e-3
"""Rad by which a straight line between two frames may miss the fastest of the thesis's motions: h²/8 of 8 rad/s²."""


def numbers(record: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(record["bdata"]), dtype=f"<{record['dtype']}")


def sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A ball of radius 0.1 m as a mesh."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(0).normal(size=(count, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1)[:, None]
    return points, np.asarray(ConvexHull(points).simplices, dtype=np.intp)


@pytest.fixture(scope="module")
def iiwa() -> Robot:
    return load_robot("iiwa14-r820")


@pytest.fixture(scope="module")
def clip() -> Clip:
    return clip_of_plan(Plan(builtin_plan("thesis-a1")), "thesis-a1")


# Meshes ---------------------------------------------------------------------------------------------------------


def test_a_small_mesh_stays_as_it_is():
    points, triangles = sphere(200)
    corners, kept = simplified(points, triangles, len(triangles))
    assert {tuple(np.sort(t)) for t in corners[kept].round(12).reshape(-1, 9)} == {
        tuple(np.sort(t)) for t in points[triangles].round(12).reshape(-1, 9)
    }


def test_a_large_mesh_keeps_to_its_budget_and_its_shape():
    points, triangles = sphere(20_000)
    corners, kept = simplified(points, triangles, 3000)
    assert 1000 < len(kept) <= 3000
    assert np.allclose(np.linalg.norm(corners, axis=1), 0.1, atol=0.01)  # a cell is 200 mm / 24 across
    a, b, c = kept.T
    assert ((a != b) & (b != c) & (c != a)).all()


def test_places_are_written_to_a_step():
    points, triangles = sphere(500)
    record = mesh_record(points, triangles)
    back = np.array(record["low"]) + np.array(record["step"]) * numbers(record["places"]).reshape(-1, 3)
    assert np.abs(back - points).max() <= 0.5 * max(record["step"]) + EXACT
    assert (numbers(record["index"]).reshape(-1, 3) == triangles).all()


# Masses ---------------------------------------------------------------------------------------------------------


def test_the_ellipsoid_of_an_ellipsoid_is_itself():
    half, mass, com = np.array([0.3, 0.2, 0.1]), 4.0, np.array([0.1, -0.2, 0.3])
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    about = turn @ np.diag(mass / 5.0 * (np.sum(half**2) - half**2)) @ turn.T
    axes, directions = ellipsoid_of(com_inertia_to_vector(mass, com, about))
    assert np.sort(axes) == pytest.approx(np.sort(half), abs=EXACT)
    assert np.linalg.det(directions) == pytest.approx(1.0)
    assert directions @ np.diag(axes) @ directions.T == pytest.approx(turn @ np.diag(half) @ turn.T, abs=EXACT)


def test_an_impossible_inertia_has_no_ellipsoid():
    assert ellipsoid_of(com_inertia_to_vector(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))) is None


# Motions --------------------------------------------------------------------------------------------------------


def test_a_plan_on_the_screen_is_the_plan(clip: Clip):
    plan = Plan(builtin_plan("thesis-a1"))
    time = np.linspace(0.0, plan.duration, 5003)
    seen = np.column_stack([np.interp(time, clip.time, x) for x in clip.q.T])
    assert np.abs(seen - plan.at(time).q).max() < BETWEEN
    assert len(clip.time) == round(plan.duration * FRAMES) + 1


def test_a_long_recording_has_fewer_frames_a_second():
    time = np.arange(40_000) * 0.1
    clip = clip_of_recording(Recording(time, np.sin(time)[:, None]), "long")
    assert len(clip.time) == MAX_FRAMES + 1 and clip.time[-1] == pytest.approx(3999.9)


def test_what_was_not_recorded_is_passed_over():
    q = np.linspace(0.0, 1.0, 101)[:, None].copy()
    q[40:60] = np.nan
    clip = clip_of_recording(Recording(np.arange(101) * 0.01, q), "gap")
    assert np.allclose(clip.q[:, 0], clip.time, atol=1e-9)
    assert np.allclose(clip.dq, 1.0)


def test_rows_without_a_clock_follow_each_other():
    q = np.zeros((21, 1))
    assert clip_of_recording(Recording(None, q, rate=100.0), "rate").time[-1] == pytest.approx(0.2)
    assert clip_of_recording(Recording(None, q, consecutive=False), "rows").time[-1] == pytest.approx(2.0)


# Nearest bodies -------------------------------------------------------------------------------------------------


@pytest.mark.collision
def test_the_nearest_pair_is_that_of_all_pairs(iiwa: Robot, clip: Clip):
    """Against Coal on every pair at every moment."""
    box = Shape(
        "box", -1, "box", np.array([0.4, 0.4, 0.4]), np.eye(4) + np.pad([[0.9], [0.0], [0.5]], ((0, 1), (3, 0)))
    )
    watched = bodies_to_watch(iiwa, (box,))
    assert watched is not None
    found = closest(iiwa, clip, watched)
    assert found is not None and len(found.time) == 600
    every = np.searchsorted(clip.time, found.time)
    shapes = (*iiwa.shapes, box)
    pairs = pairs_of_bodies(iiwa, shapes)[1]
    names = [f"{shapes[a].name} – {shapes[b].name}" for a, b in pairs]
    assert {"box – base", "base – box"} & set(found.pairs) == set()  # at rest
    kept = pairs[[names.index(pair) for pair in found.pairs]]
    table = distances(shapes, kept, forward_kinematics(iiwa, clip.q[every]))
    assert found.distance == pytest.approx(table.min(axis=1), abs=EXACT)
    apart = np.linalg.norm(found.points[:, 0] - found.points[:, 1], axis=1)
    assert apart == pytest.approx(np.abs(found.distance), abs=1e-6)


def test_an_arm_without_bodies_has_no_distances(tmp_path: Path):
    robot = load_robot(write_arm(tmp_path))
    assert bodies_to_watch(robot) is None


# From files -----------------------------------------------------------------------------------------------------


def test_plans_are_read_back_whole(tmp_path: Path):
    plan = Plan(small_plan(1), 3, np.ones(3), None, 2.0, 0.0)
    save_plan(plan.excitation, tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    box = Shape("table", -1, "box", np.array([1.0, 2.0, 3.0]), np.eye(4))
    record |= {"repetitions": 3, "begin": [1, 1, 1], "end": None, "lead_in": 2.0, "lead_out": 0.0}
    (tmp_path / "plan.json").write_text(to_json(record | {"surroundings": shape_records([box])}))
    for name in (str(tmp_path / "plan.json"), str(tmp_path)):
        assert is_plan(name)
        back, around = read_whole_plan(name)
        assert isinstance(back, Plan) and back.duration == plan.duration
        assert np.array_equal(back.at([1.0, 7.0]).q, plan.at([1.0, 7.0]).q)
        assert around[0].name == "table" and np.array_equal(around[0].size, box.size)


def test_poses_are_read_back(tmp_path: Path):
    moves = Moves(("a", "b"), np.arange(6.0).reshape(3, 2), np.array([1.0, 2.0]), np.zeros((3, 2)), ("way", "rest"))
    record: dict[str, Any] = {"joints": moves.joints, "poses": moves.poses, "speeds": moves.speeds}
    record["stretches"] = [{"kind": "way", "seconds": 1.0}, {"kind": "rest", "seconds": 2.0}]
    (tmp_path / "plan.json").write_text(to_json(record))
    back, _ = read_whole_plan(str(tmp_path))
    assert np.array_equal(back.at(np.array([0.3, 2.0])).q, moves.at(np.array([0.3, 2.0])).q)


def test_a_plan_is_drawn_under_the_limits_that_it_was_designed_under(tmp_path: Path):
    robot = load_robot(write_arm(tmp_path))
    given = {("joint_1", "position"): (-0.5, 0.7), ("joint_2", "velocity"): 0.3}
    limits = limits_of(robot, given)
    save_plan(small_plan(1), tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text()) | {"joints": robot.joint_names}
    drawn = preview_of(robot, str(tmp_path))
    assert drawn.limits is None and "Limits are those of the description" in Page(render_preview(drawn)).prose
    (tmp_path / "plan.json").write_text(to_json(record | {"joint_limits": limits_record(limits)}))
    drawn = preview_of(robot, str(tmp_path))
    assert drawn.limits is not None and np.array_equal(drawn.limits.effort, limits.effort)
    assert "Limits are those that the plan was designed under" in Page(render_preview(drawn)).prose
    first, second, *_ = joint_records(robot, drawn.limits)
    assert (first["low"], first["high"], second["fastest"]) == (-0.5, 0.7, 0.3)
    (tmp_path / "plan.json").write_text(to_json(record | {"joint_limits": {"lower": 1}}))
    with pytest.raises(ArmidError, match="joint_limits"):
        preview_of(robot, str(tmp_path))


@pytest.mark.parametrize("text", ["", "[]", '{"stretches": 1}', '{"robot": "x"}'])
def test_what_is_no_plan_is_refused(text: str, tmp_path: Path):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(ArmidError, match=r"plan\.json"):
        read_whole_plan(str(tmp_path))


def test_a_motion_of_another_arm_is_refused(iiwa: Robot, tmp_path: Path):
    save_plan(small_plan(1), tmp_path / "plan.json")
    with pytest.raises(ArmidError, match="moves 3 joints"):
        preview_of(iiwa, str(tmp_path / "plan.json"))


def test_a_mesh_that_cannot_be_read_is_named(iiwa: Robot, tmp_path: Path):
    from dataclasses import replace

    (tmp_path / "broken.stl").write_text("no mesh")
    elbow = next(shape.name for shape in iiwa.shapes if shape.link == 2)
    broken = Shape(elbow, 2, "mesh", np.ones(3), np.eye(4), str(tmp_path / "broken.stl"))
    bodies, meshes, missing = bodies_of(replace(iiwa, visuals=(broken,)))
    assert meshes == [] and [each.channel for each in missing] == [elbow]
    assert {body["link"] for body in bodies} == {-1, 0, 1, 3, 4, 5, 6}  # the others keep their capsules


def test_a_visual_that_makes_no_sense_costs_no_other(tmp_path: Path):
    visuals = {"a": '<sphere radius="-1"/>', "b": '<box size="0.1 0.2 0.3"/>'}
    text = "".join(
        f'<link name="{name}"><visual><geometry>{shape}</geometry></visual></link>'
        f'<joint name="to-{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/></joint>'
        for (name, shape), parent in zip(visuals.items(), ("base", "a"), strict=True)
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{text}</robot>')
    robot = load_robot(tmp_path / "arm.urdf")
    assert [shape.name for shape in robot.visuals] == ["b"]
    (finding,) = [each for each in robot.findings if each.code == "visual-left-out"]
    assert finding.channel == "a" and "positive sizes" in finding.evidence
    bodies, _, missing = bodies_of(robot)
    assert [body["name"] for body in bodies] == ["b"]
    assert missing == (finding,)


# The page -------------------------------------------------------------------------------------------------------


def test_the_page_is_whole_and_fetches_nothing(iiwa: Robot, clip: Clip):
    pytest.importorskip("jinja2")
    page = Page(html := render_preview(Preview(iiwa, clip)))
    assert [where for where in page.fetched if not where.startswith(("#", "data:"))] == []
    assert page.headings == [1, 2, 2, 2] and all(name in page.words for name in iiwa.joint_names)
    assert "three-packed" in page.scripts and len(html) < 400_000
    assert html == render_preview(Preview(iiwa, clip))


def test_a_recording_is_a_motion(tmp_path: Path):
    recording = small_recording(1)
    clip = clip_of_recording(recording, "run")
    assert clip.time[-1] == pytest.approx(recording.time[-1] - recording.time[0])
    assert np.abs(clip.q[0] - recording.q[0]).max() < EXACT

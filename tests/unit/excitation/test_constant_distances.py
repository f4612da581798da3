"""Neighbours at the same distance in every pose are not taken for the closest approach."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.excitation.collision.closest_approach import ClosestApproach, closest_approaches
from armid.excitation.preflight import Preflight
from armid.model.motion import Motion
from armid.report.preflight_page import nearest_of_links
from armid.report.preview.animation_frames import clip_of_motion
from armid.report.preview.nearest_bodies import bodies_to_watch, closest
from armid.report.preview.page import Preview, render_preview
from armid.robot import Robot, load_robot
from armid.robot.collision_body_names import BodyName, BodyPair
from armid.study.plans.preflight_text import constant_text

GAP = 0.002
"""Distance of the two spheres on the common axis in every pose [m]."""

MEASURED = 1e-6
"""Accuracy of Coal's iterative distances [m]."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Two links on one axis; a sphere of the last turns on the axis close to the base's, another passes a post."""
    sphere = '<collision><origin xyz="{}"/><geometry><sphere radius="{}"/></geometry></collision>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint>'
    )
    path = tmp_path_factory.mktemp("wheel") / "wheel.urdf"
    path.write_text(
        '<robot name="wheel">'
        f'<link name="base">{sphere.format("0 0 0", 0.05)}{sphere.format("0 0.4 0.3", 0.05)}</link>'
        f'<link name="between"/><link name="rim">{sphere.format(f"0 0 {0.1 + GAP}", 0.05)}'
        f"{sphere.format('0.4 0 0.3', 0.05)}</link>"
        + joint.format("one", "base", "between")
        + joint.format("two", "between", "rim")
        + "</robot>"
    )
    return load_robot(path)


@pytest.fixture(scope="module")
def motion() -> Motion:
    time = np.linspace(0.0, 10.0, 501)
    phase = 2.0 * np.pi * time / 10.0
    q = np.column_stack([0.6 * np.sin(phase), 0.5 * np.sin(phase)])
    return Motion(time, q, np.gradient(q, time, axis=0), np.zeros_like(q))


@pytest.mark.collision
def test_the_list_begins_with_the_closest_pair_whose_distance_changes(robot: Robot, motion: Motion):
    watched = bodies_to_watch(robot)
    assert watched is not None
    found = closest_approaches(watched, robot, motion.time, motion.q)
    *changing, last = found
    assert last.constant and last.distance == pytest.approx(GAP, abs=MEASURED) and last.is_sufficient
    assert changing and not any(each.constant for each in changing)
    assert changing[0].distance == min(each.distance for each in changing) > GAP
    assert [each.pair.links for each in nearest_of_links((last, *changing))].count(last.pair.links) == 1
    assert constant_text([last]).endswith(
        f"required distance: {last.pair} 2.0 mm ({1000 * last.required_distance:.1f} mm)"
    )


@pytest.mark.collision
def test_the_preview_draws_the_pair_whose_distance_changes_and_names_the_other(robot: Robot, motion: Motion):
    watched, clip = bodies_to_watch(robot), clip_of_motion(motion, "wheel")
    assert watched is not None
    found = closest(robot, clip, watched)
    assert found is not None and found.distance.min() > 10.0 * GAP
    ((pair, distance),) = found.constant
    assert pair not in {found.pairs[k] for k in found.pair} and distance == pytest.approx(GAP, abs=MEASURED)
    assert f"{pair} 2.0 mm" in render_preview(Preview(robot, clip, collision=watched))


@pytest.mark.collision
def test_a_pair_that_is_too_close_in_every_pose_heads_the_list(robot: Robot, motion: Motion):
    watched = bodies_to_watch(robot)
    assert watched is not None
    near = watched.every.margins < watched.every.margins.max()
    closer = replace(watched.every, margin=np.where(near, 2.0 * GAP, watched.every.margins))
    found = closest_approaches(replace(watched, every=closer), robot, motion.time, motion.q)
    assert not found[0].constant and found[0].distance == pytest.approx(GAP, abs=MEASURED)
    assert Preflight((), found, (), None).verdict == "fail"


@pytest.mark.collision
def test_a_distance_that_changes_beyond_the_poses_of_a_motion_is_not_constant(tmp_path: Path):
    """Off the axis, the spheres are 2 mm apart at zero and 7.5 mm at the joints' limits; the motion is small."""
    sphere = '<collision><origin xyz="0.02 0 {}"/><geometry><sphere radius="0.05"/></geometry></collision>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint>'
    )
    far = '<collision><origin xyz="{} 0.5 0.3"/><geometry><sphere radius="0.05"/></geometry></collision>'
    path = tmp_path / "cam.urdf"
    path.write_text(
        f'<robot name="cam"><link name="base">{sphere.format(0)}{far.format(1)}</link><link name="between"/>'
        f'<link name="rim">{sphere.format(0.1 + GAP)}{far.format(0)}</link>'
        + joint.format("one", "base", "between")
        + joint.format("two", "between", "rim")
        + "</robot>"
    )
    robot = load_robot(path)
    watched, time = bodies_to_watch(robot), np.linspace(0.0, 10.0, 101)
    assert watched is not None
    q = 0.2 * np.sin(time)[:, None] * np.ones(2)
    nearest = closest_approaches(watched, robot, time, q)[0]
    assert nearest.distance == pytest.approx(GAP, abs=MEASURED) and not nearest.constant


@pytest.mark.collision
def test_an_arm_in_one_pose_has_no_constant_distances(robot: Robot, motion: Motion):
    watched = bodies_to_watch(robot)
    assert watched is not None
    found = closest_approaches(watched, robot, motion.time[:1], motion.q[:1])
    assert not any(each.constant for each in found)


def test_links_with_a_body_at_constant_distance_are_named_by_the_one_that_comes_closest():
    found = nearest_of_links(
        [
            ClosestApproach(BodyPair("base", "hand"), 0.001, 0.0, 0.0005, constant=True),
            ClosestApproach(BodyPair("base", BodyName("hand", 2)), 0.030, 1.0, 0.02),
        ]
    )
    assert [each.pair for each in found] == [BodyPair("base", BodyName("hand", 2))]

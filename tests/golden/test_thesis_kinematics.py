"""The built-in iiwa 14 is the arm of the thesis: frames, flange and reference inertials."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.robot import forward_kinematics, frame_pose, load_robot

TRUTH = json.loads((Path(__file__).parent / "data" / "truth.json").read_text())
TOLERANCE = 1e-12
"""Seven products of rotations; the truth was computed apart, with ten digits and more."""


@pytest.fixture(scope="module")
def robot():
    return load_robot("iiwa14-r820", gravity=[0.0, 0.0, 9.81])


def test_origins_and_flange(robot):
    q = [TRUTH["fk_q"]]
    _, p = forward_kinematics(robot, q)
    _, flange = frame_pose(robot, q)
    np.testing.assert_allclose(np.vstack([p[0], flange]), TRUTH["fk_p"], rtol=0, atol=TOLERANCE)


def test_orientation_of_the_last_frame(robot):
    R, _ = forward_kinematics(robot, [TRUTH["fk_q"]])
    np.testing.assert_allclose(R[0, -1], TRUTH["fk_R7"], rtol=0, atol=TOLERANCE)


def test_origins_at_rest_are_exact(robot):
    _, p = forward_kinematics(robot, np.zeros((1, 7)))
    np.testing.assert_allclose(p[0, :, 2], np.cumsum(TRUTH["d"]), rtol=0, atol=1e-15)
    assert not p[0, :, :2].any()


def test_rotations_of_table_3_1_are_exact(robot):
    for joint in robot.joints:
        assert set(np.abs(joint.placement[:3, :3]).ravel()) == {0.0, 1.0}
        assert joint.axis.tolist() == [0.0, 0.0, 1.0]


def test_reference_inertials(robot):
    for link, row in zip(robot.links, TRUTH["urdf_mu"], strict=True):
        m, x, y, z, xx, xy, xz, yy, yz, zz = row[:10]
        r = np.array([x, y, z])
        about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + m * (r @ r * np.eye(3) - np.outer(r, r))
        entries = [about_origin[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        np.testing.assert_allclose(link.inertial.vector, [m, *(m * r), *entries], rtol=0, atol=1e-15)
        assert link.inertial.is_consistent()


def test_limits(robot):
    degrees = [np.degrees(j.position_limits).round(9).tolist() for j in robot.joints]
    assert degrees == [[-a, a] for a in (170, 120, 170, 120, 170, 120, 175)]
    assert np.degrees([j.velocity_limit for j in robot.joints]).round(9).tolist() == [85, 85, 100, 75, 130, 135, 135]
    assert [j.effort_limit for j in robot.joints] == [320, 320, 176, 176, 110, 40, 40]

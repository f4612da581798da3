"""The page on DH tables: its examples work, its claims hold, and it has every key that the reader knows."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armid.errors import RobotError
from armid.maths.rotations import homogeneous, rotation_x, rotation_z
from armid.robot import frame_pose, load_robot
from armid.robot.readers import dh
from paged import DOCS, follow

PAGE = (DOCS / "dh.md").read_text()


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dh")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert follow(PAGE) == 6
    return folder


def test_the_page_is_followed_and_its_count_is_true(followed, capsys):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(followed)
        follow("```bash\narmid base arm.toml\n```\n")
    assert "15 of the links and 6 of friction" in PAGE
    counts = "21 base parameters (15 inertial + 6 friction) of 36 standard parameters"
    assert counts in " ".join(capsys.readouterr().out.split())


def test_the_short_table_is_the_same_arm(followed):
    arm, short = load_robot(followed / "arm.toml"), load_robot(followed / "short.toml")
    assert short.joint_names == ("joint_1", "joint_2", "joint_3") and short.name == "short"
    for field in ("parent", "axis", "rotation", "translation"):
        np.testing.assert_array_equal(getattr(arm.tree, field), getattr(short.tree, field))
    assert arm.joints[0].velocity_limit == pytest.approx(np.radians(120.0))


def test_the_sliding_arm_ends_where_its_rows_say(followed):
    """Each row of the standard convention, multiplied out by hand."""
    robot = load_robot(followed / "scara.toml")
    q = np.array([0.3, -0.8, 0.2, 1.1])
    pose = homogeneous(rotation_z(np.pi / 2), [0.0, 0.0, 0.1])
    rows = [(0.35, 0.0, 0.4, q[0]), (0.3, np.pi, 0.0, q[1]), (0.0, 0.0, q[2], 0.0), (0.0, 0.0, 0.0, q[3])]
    for a, alpha, d, theta in rows:
        pose = pose @ homogeneous(rotation_z(theta), [0, 0, d]) @ homogeneous(rotation_x(alpha), [a, 0, 0])
    R, p = frame_pose(robot, q[None])
    assert R[0] == pytest.approx(pose[:3, :3]) and p[0] == pytest.approx(pose[:3, 3])
    assert [joint.kind for joint in robot.joints] == ["revolute", "revolute", "prismatic", "continuous"]


def test_the_page_has_every_key():
    keys = {*dh.TOP, *dh.JOINT, *dh.INERTIA, *(key for pair in dh.ROWS.values() for keys in pair for key in keys)}
    keys |= {"mass", "com", "inertia", "from", "to", "radius", "xyz", "rpy", *dh.ROWS, *dh.KINDS}
    missing = {key for key in keys if not re.search(rf"\b{key}\b", PAGE)}
    assert missing == set()


ROW = 'convention = "modified"\n[[joint]]\nd = 0.1\n'


@pytest.mark.parametrize(
    ("text", "problem", "said"),
    [
        (ROW.replace("modified", "modifed"), "convention has the unknown value 'modifed'", "did you mean 'modified'"),
        ("[[joint]]\nd = 1\n", "the key 'convention' is missing", "standard, modified, thesis"),
        (ROW + "[joint.inertial]\nmas = 2\n", "unknown key 'mas'", "write 'mass'"),
        (ROW + "[joint.inertial]\n", "inertial: mass, com are missing", "write mass = …, com = …"),
        (ROW + "capsule = [{ radius = 1 }]\n", "from, to are missing", "write from = …, to = …"),
    ],
)
def test_an_error_names_what_is_missing_or_misspelt(tmp_path, text, problem, said):
    path = tmp_path / "arm.toml"
    path.write_text(text)
    with pytest.raises(RobotError) as caught:
        load_robot(path)
    assert problem in caught.value.problem
    assert said in f"{caught.value.possible} {caught.value.remedy}"

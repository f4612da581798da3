"""Duties of every reader of robot descriptions. `arms/` holds one arm in every format: a new one adds its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from damage import changed, cut, is_helpful, junk

from armid.errors import ArmidError, RobotError
from armid.robot import Robot, load_robot
from armid.robot.readers import READERS

ARMS = Path(__file__).parent / "arms"
SAMPLES = {name: [p for p in ARMS.iterdir() if p.suffix == form.suffixes[0]] for name, form in READERS.items()}

EXACT = 1e-15
"""Lengths of a few decimetres, in some formats through quaternions and Pinocchio."""

READER = pytest.mark.parametrize("name", READERS)


def sample(name: str) -> Path:
    assert len(SAMPLES[name]) == 1, f"arms/ needs one file ending in {READERS[name].suffixes[0]}"
    return SAMPLES[name][0]


def assert_read_or_refused(path: Path, content: bytes) -> ArmidError | None:
    """A robot, or an error that says what to do; anything else fails."""
    path.write_bytes(content)
    try:
        assert isinstance(load_robot(path), Robot)
    except ArmidError as error:
        assert is_helpful(error), error
        return error
    return None


@READER
def test_suffixes(name: str):
    assert READERS[name].suffixes
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in READERS[name].suffixes)


@READER
def test_recognises_its_own_and_no_other(name: str):
    """The text decides where readers share an ending."""
    text = sample(name).read_text()
    sharing = [r for r in READERS.values() if set(r.suffixes) & set(READERS[name].suffixes)]
    assert [r for r in sharing if r.reader.recognises(text)] == [READERS[name]]


@READER
def test_every_format_says_the_same_arm(name: str):
    arm, other = load_robot(sample(name)), load_robot(ARMS / "arm.toml")
    assert arm.name == other.name and arm.joint_names == other.joint_names
    assert [j.kind for j in arm.joints] == [j.kind for j in other.joints]
    assert [j.effort_limit for j in arm.joints] == [j.effort_limit for j in other.joints]
    for field in ("parent", "axis", "rotation", "translation", "gravity"):
        np.testing.assert_allclose(getattr(arm.tree, field), getattr(other.tree, field), rtol=0, atol=EXACT)
    np.testing.assert_array_equal([j.position_limits for j in arm.joints], [j.position_limits for j in other.joints])
    np.testing.assert_allclose(arm.inertial_vector, other.inertial_vector, rtol=0, atol=EXACT)


@READER
def test_reads_the_same_twice_and_leaves_the_file(name: str):
    path = sample(name)
    before = path.read_bytes()
    first, second = load_robot(path), load_robot(path)
    assert first.source == str(path) and len(first.sha256) == 64 and first.sha256 == second.sha256
    assert first.tree.rotation.tobytes() == second.tree.rotation.tobytes()
    assert first.inertial_vector.tobytes() == second.inertial_vector.tobytes()
    assert path.read_bytes() == before


@READER
def test_locked_joints_leave_the_arm(name: str):
    arm = load_robot(sample(name), locked={"joint_2": 0.4})
    welded = load_robot(sample(name)).lock({"joint_2": 0.4})
    assert arm.joint_names == ("joint_1", "joint_3")
    np.testing.assert_allclose(arm.tree.rotation, welded.tree.rotation, rtol=0, atol=EXACT)
    np.testing.assert_allclose(arm.inertial_vector, welded.inertial_vector, rtol=0, atol=EXACT)


@READER
@pytest.mark.parametrize("wrong", [{"locked": ["elbow"]}, {"tip": "elbow"}], ids=str)
def test_unknown_names_are_refused_with_the_known_ones(name: str, wrong: dict):
    with pytest.raises(RobotError, match="elbow") as caught:
        load_robot(sample(name), **wrong)
    assert caught.value.possible


@READER
def test_junk_is_refused(name: str, tmp_path: Path):
    for suffix in READERS[name].suffixes:
        for content in (b"", *junk()):
            assert assert_read_or_refused(tmp_path / f"junk{suffix}", content) is not None, content[:20]


@READER
def test_other_formats_are_refused(name: str, tmp_path: Path):
    """One format under the ending of another, unless the reader of the former takes that ending, too."""
    for suffix in READERS[name].suffixes:
        for other in READERS:
            if suffix not in READERS[other].suffixes and {name, other} != {"urdf", "xacro"}:
                content = sample(other).read_bytes()
                assert assert_read_or_refused(tmp_path / f"arm{suffix}", content) is not None, (suffix, other)


@READER
def test_damage_is_read_or_refused(name: str, tmp_path: Path):
    path, content = tmp_path / sample(name).name, sample(name).read_bytes()
    for damaged in (*cut(content, 24), *changed(content, 80, seed=3)):
        assert_read_or_refused(path, damaged)

"""Bags as ROS leaves them: folders, parts, compression, more joints than the arm, several publishers and topics."""

import re
from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.hashes import sha256_of_file
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording_paths import sha256_of_recording
from armid.robot.robot import Frame, Joint, Link, Robot
from recordings import JOINT_STATE, joint_state, message, ros_types, write_bag, write_bag_folder

pytest.importorskip("rosbags")

NAMES = ("turn", "lift", "elbow")
N = 60
AT = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(N)
SECONDS = (AT - AT[0]) * 1e-9
Q = np.sin(np.outer(np.arange(N), [0.11, 0.17, 0.23]) + np.array([0.1, 0.9, 2.0]))
DQ = np.array([11.0, 17.0, 23.0]) * np.cos(np.outer(np.arange(N), [0.11, 0.17, 0.23]) + np.array([0.1, 0.9, 2.0]))
TAU = 2.0 * Q + DQ
FINGER = 0.02 + 0.01 * np.sin(0.3 * np.arange(N))

INTERPOLATION = 0.06
"""Of a unit sine between samples 3 · 0.23 rad of its phase apart: h²/8."""


def arm(names=NAMES) -> Robot:
    joints = tuple(
        Joint(name, "revolute", i - 1, [0.0, 0.0, 1.0], np.eye(4), [-3.0, 3.0]) for i, name in enumerate(names)
    )
    return Robot("arm", joints, tuple(Link(name) for name in names), Frame("tip", len(names) - 1, np.eye(4)))


def states(names=NAMES, take=(0, 1, 2), at=AT, **options):
    take = list(take)
    rows = np.searchsorted(AT, at)
    return [
        joint_state(t, names, Q[k, take], DQ[k, take], TAU[k, take], **options) for t, k in zip(at, rows, strict=True)
    ]


def read(path, robot=None, **reading):
    robot = robot or arm()
    how = LogFormat(**reading)
    return to_robot_convention(load_recording(path, how, robot), how, robot)


def found(read_, code):
    return [f for f in read_.findings if f.code == code]


def assert_all(recording):
    np.testing.assert_allclose(recording.time, SECONDS, rtol=0, atol=1e-12)
    for name, truth in (("q", Q), ("dq", DQ), ("effort", TAU)):
        np.testing.assert_array_equal(getattr(recording, name), truth)


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_compressed_file_alone_is_a_recording(tmp_path, suffix):
    folder = write_bag_folder(tmp_path / "bag", states(), compression="FILE", suffix=suffix)
    packed = next(folder.glob(f"*{suffix}.zstd"))
    alone = packed.rename(tmp_path / packed.name)
    assert_all(load_recording(alone))
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [alone.name]
    alone.write_bytes(alone.read_bytes()[:200])
    with pytest.raises(RecordingError, match="cannot be unpacked"):
        load_recording(alone)


def parts(folder: Path, pieces: int, suffix: str) -> Path:
    """A bag split into files, as `ros2 bag record --max-bag-duration` leaves it."""
    whole = write_bag_folder(folder / "split", states()[: N // pieces], suffix=suffix)
    yaml = (whole / "metadata.yaml").read_text()
    names = [next(whole.glob(f"*{suffix}")).name]
    for k in range(1, pieces):
        piece = states()[k * N // pieces : (k + 1) * N // pieces]
        other = write_bag_folder(folder / f"piece{k}", piece, suffix=suffix)
        name = names[0].replace(suffix, f"_{k}{suffix}")
        next(other.glob(f"*{suffix}")).rename(whole / name)
        names.append(name)
    listed = "\n".join(f"  - {name}" for name in names)
    listed = re.sub(r"relative_file_paths:\n\s*- [^\n]+", f"relative_file_paths:\n{listed}", yaml)
    assert names[-1] in listed
    (whole / "metadata.yaml").write_text(listed)
    return whole


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
@pytest.mark.parametrize("compression", [None, "FILE", "MESSAGE"])
def test_a_folder_is_a_recording(tmp_path, suffix, compression):
    path = write_bag_folder(tmp_path / "bag", states(), compression=compression, suffix=suffix)
    result = read(path)
    assert_all(result.recording)
    assert not result.findings and result.recording.source == str(path)
    (data,) = (file for file in path.iterdir() if file.name != "metadata.yaml")
    assert result.recording.sha256 == sha256_of_recording(path) == sha256_of_file(data)


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_split_bag_is_one_recording(tmp_path, suffix):
    path = parts(tmp_path, 3, suffix)
    assert_all(read(path).recording)
    digest = sha256_of_recording(path)
    (path / "metadata.yaml").unlink()
    assert_all(read(path).recording)  # its parts without their metadata
    assert sha256_of_recording(path) == digest
    last = sorted(path.glob(f"*{suffix}"))[-1]
    assert read(last).recording.samples == N // 3
    last.unlink()
    assert sha256_of_recording(path) != digest


def test_a_part_that_is_missing_is_named(tmp_path):
    path = parts(tmp_path, 2, ".mcap")
    last = sorted(path.glob("*.mcap"))[-1]
    last.unlink()
    with pytest.raises(RecordingError, match=last.name):
        read(path)


def test_bags_of_ros_1_in_a_folder_are_parts(tmp_path):
    first = write_bag(tmp_path, ".bag", {"/joint_states": [message(i) for i in range(12)]})
    first.rename(tmp_path / "run_0.bag")
    second = write_bag(tmp_path, ".bag", {"/joint_states": [message(i) for i in range(12, 25)]})
    second.rename(tmp_path / "run_1.bag")
    assert load_recording(tmp_path).samples == 25


def test_a_folder_without_a_bag_says_what_a_bag_has(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(
        RecordingError, match=r"is a folder without a bag.*metadata\.yaml; found notes\.txt"
    ) as caught:
        load_recording(tmp_path)
    assert ".db3 or .mcap" in caught.value.possible
    (tmp_path / "plan.json").write_text("{}")
    with pytest.raises(RecordingError) as caught:
        load_recording(tmp_path)
    assert "plan of armid excite" in caught.value.remedy


def test_names_decide_and_other_joints_are_left_out(tmp_path):
    order = (2, 3, 0, 1)
    names = [("turn", "lift", "elbow", "finger")[k] for k in order]
    nan = np.full(N, np.nan)
    columns = [np.column_stack([x, extra])[:, order] for x, extra in ((Q, FINGER), (DQ, nan), (TAU, nan))]
    messages = [joint_state(t, names, *(x[k] for x in columns)) for k, t in enumerate(AT)]
    result = read(write_bag_folder(tmp_path / "bag", messages))
    assert_all(result.recording)
    (extra,) = found(result, "joints-extra")
    assert extra.severity == "info" and "finger" in extra.evidence


def test_a_missing_joint_is_an_error_that_lists_what_is_there(tmp_path):
    path = write_bag_folder(tmp_path / "bag", states(("turn", "lift", "wrist")))
    with pytest.raises(RecordingError, match="has the joints elbow") as caught:
        read(path)
    assert "turn, lift, wrist" in caught.value.possible
    assert_all(read(path, joints={"wrist": "elbow"}).recording)


def test_a_joint_held_still_is_looked_at(tmp_path):
    whole = arm()
    path = write_bag_folder(tmp_path / "bag", states())
    (moved,) = found(read(path, whole.lock(["turn"])), "locked-joint")
    assert moved.severity == "warning" and moved.channel == "turn" and "from -1 to 0.9992" in moved.evidence
    still = [joint_state(t, NAMES, [0.7, *Q[k, 1:]], DQ[k], TAU[k]) for k, t in enumerate(AT)]
    path = write_bag_folder(tmp_path / "still", still)
    (elsewhere,) = found(read(path, whole.lock(["turn"])), "locked-joint")
    assert "--lock turn=0.7" in elsewhere.remedy and "lock = { turn = 0.7 } in [robot]" in elsewhere.remedy
    assert not found(read(path, whole.lock({"turn": 0.7})), "locked-joint")
    assert not found(read(path, whole.lock({"turn": 0.7})), "joints-extra")


def test_the_gripper_has_a_publisher_of_its_own(tmp_path):
    slow = AT[::5] + 1_700_000
    hand = [joint_state(t, ("finger",), FINGER[k : k + 1]) for k, t in zip(range(0, N, 5), slow, strict=True)]
    path = write_bag_folder(tmp_path / "bag", {"/joint_states": states() + hand})
    result = read(path)
    assert_all(result.recording)
    (extra,) = found(result, "joints-extra")
    assert "finger" in extra.evidence
    held = arm((*NAMES, "finger")).lock({"finger": 0.02})
    assert not found(read(path, held), "joints-extra")
    assert found(read(path, held), "locked-joint")


def test_an_arm_in_two_publishers_is_merged_by_name(tmp_path):
    together = states(NAMES[:2], (0, 1)) + states(NAMES[2:], (2,))
    result = read(write_bag_folder(tmp_path / "same", together))
    assert_all(result.recording)
    assert [f.severity for f in found(result, "joints-merged")] == ["info"]
    apart = states(NAMES[:2], (0, 1)) + [
        joint_state(t + 4_000_000, NAMES[2:], Q[k, 2:], DQ[k, 2:], TAU[k, 2:]) for k, t in enumerate(AT) if k % 3 == 0
    ]
    result = read(write_bag_folder(tmp_path / "apart", apart))
    (merged,) = found(result, "joints-merged")
    assert merged.severity == "warning" and "elbow (20 messages)" in merged.evidence
    assert result.recording.joint_names == NAMES
    when = (result.recording.time + 0.01) / 0.01  # the first row is where both publish, at the second stamp
    np.testing.assert_allclose(result.recording.q[:, 2], np.sin((when - 0.4) * 0.23 + 2.0), atol=INTERPOLATION)


def test_the_topic_with_the_arm_is_found(tmp_path):
    hand = [joint_state(t, ("finger",), FINGER[k : k + 1]) for k, t in enumerate(AT)]
    result = read(write_bag_folder(tmp_path / "bag", {"/arm/joint_states": states(), "/hand/joint_states": hand}))
    assert_all(result.recording)
    (chosen,) = found(result, "topic-chosen")
    assert chosen.channel == "/arm/joint_states" and "/hand/joint_states" in chosen.evidence


def test_what_was_measured_is_taken_before_commands_and_two_alike_are_a_question(tmp_path):
    commanded = [joint_state(t, NAMES, Q[k] + 0.1) for k, t in enumerate(AT)]
    path = write_bag_folder(tmp_path / "bag", {"/joint_states": states(), "/joint_commands": commanded})
    result = read(path)
    assert_all(result.recording)
    assert "/joint_commands" in found(result, "topic-chosen")[0].evidence
    path = write_bag_folder(tmp_path / "two", {"/left": states(), "/right": states()})
    with pytest.raises(RecordingError, match="2 topics with joint states") as caught:
        read(path)
    assert 'topic = "/left"' in caught.value.remedy
    assert_all(read(path, topic="/right").recording)


@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".bag"])
def test_without_stamps_times_are_those_of_reception(tmp_path, suffix):
    if suffix == ".bag":
        path = write_bag(tmp_path, suffix, {"/js": [message(i) | {"stamp": 0} for i in range(25)]})
        recording = load_recording(path)
        np.testing.assert_allclose(recording.time, 0.007 * np.arange(25), rtol=0, atol=1e-9)
        assert [f.code for f in recording.findings] == ["clock-received"]
        return
    result = read(write_bag_folder(tmp_path / "bag", states(stamped=False), suffix=suffix))
    late = 0.0005 * (np.arange(N) % 2)
    np.testing.assert_allclose(result.recording.time, SECONDS + late, rtol=0, atol=1e-9)
    (finding,) = found(result, "clock-received")
    assert finding.severity == "warning" and "9.5 to 10.5 ms" in finding.evidence


def controller_states():
    kinds = ros_types().types
    point = kinds["trajectory_msgs/msg/JointTrajectoryPoint"]
    still = kinds["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    none, kind = np.zeros(0), "control_msgs/msg/JointTrajectoryControllerState"
    for k, t in enumerate(AT):
        received, state = joint_state(t, NAMES, Q[k])
        points = {
            name: point(positions=x, velocities=none, accelerations=none, effort=none, time_from_start=still)
            for name, x in (("reference", Q[k] + 0.1), ("feedback", Q[k]), ("error", Q[k]), ("output", none))
        }
        empty = kinds["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
            transforms=[], velocities=[], accelerations=[], time_from_start=still
        )
        other = {f"multi_dof_{name}": empty for name in points}
        yield (
            received,
            kinds[kind](header=state.header, joint_names=list(NAMES), multi_dof_joint_names=[], **points, **other),
        )


def dynamic_states():
    kinds = ros_types().types
    value = kinds["control_msgs/msg/InterfaceValue"]
    for k, t in enumerate(AT):
        received, state = joint_state(t, NAMES, Q[k])
        each = [
            value(interface_names=["effort", "position", "velocity"], values=np.array([TAU[k, j], Q[k, j], DQ[k, j]]))
            for j in (1, 0, 2)
        ]
        grip = value(interface_names=["position"], values=np.array([FINGER[k]]))
        yield (
            received,
            kinds["control_msgs/msg/DynamicJointState"](
                header=state.header, joint_names=["lift", "turn", "elbow", "finger"], interface_values=[*each, grip]
            ),
        )


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_states_of_ros2_control(tmp_path, suffix):
    dynamic = read(write_bag_folder(tmp_path / "dynamic", list(dynamic_states()), suffix=suffix))
    assert_all(dynamic.recording)
    controller = read(write_bag_folder(tmp_path / "controller", list(controller_states()), suffix=suffix))
    np.testing.assert_array_equal(controller.recording.q, Q)  # what was measured, not what was asked for
    assert controller.recording.dq is None and controller.recording.effort is None
    both = {"/a": list(controller_states()), "/joint_states": states(), "/z": list(dynamic_states())}
    assert_all(read(write_bag_folder(tmp_path / "both", both, suffix=suffix)).recording)
    assert JOINT_STATE  # which goes before the others


def test_a_rate_goes_before_times_of_reception(tmp_path):
    result = read(write_bag_folder(tmp_path / "bag", states(stamped=False)), rate=100.0)
    assert result.recording.time is None and result.recording.rate == 100.0
    assert not found(result, "clock-received")

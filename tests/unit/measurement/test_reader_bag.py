"""ROS bags, written by rosbags and read by name and header time."""

import pytest

from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from recordings import NAMES, SECONDS, N, assert_same, message, refused, write_bag

BAGS = pytest.mark.parametrize("suffix", [".bag", ".db3", ".mcap"])


@BAGS
def test_joint_states_by_name_at_header_time(tmp_path, suffix):
    orders = [(0, 1, 2), (2, 0, 1)]
    path = write_bag(tmp_path, suffix, {"/joint_states": [message(i, order=orders[i % 2]) for i in range(N)]})
    recording = load_recording(path)
    assert recording.joint_names == NAMES
    assert_same(recording, t=SECONDS)


@BAGS
def test_a_bag_without_velocity_or_effort(tmp_path, suffix):
    messages = [message(i, velocity=False, effort=False) for i in range(N)]
    assert_same(
        load_recording(write_bag(tmp_path, suffix, {"/js": messages})),
        t=SECONDS,
        dq=None,
        tau=None,
    )


def test_a_field_that_comes_and_goes_is_refused(tmp_path):
    messages = [message(i, velocity=i > 3) for i in range(N)]
    refused("message 0 has 0 values of velocity for 3 joints", write_bag(tmp_path, ".mcap", {"/js": messages}))


@BAGS
def test_one_topic_of_joint_states_is_found_and_several_must_be_chosen_from(tmp_path, suffix):
    messages = [message(i) for i in range(N)]
    other = [message(i, order=(1, 0, 2)) for i in range(N)]
    path = write_bag(tmp_path, suffix, {"/left": messages, "/right": other, "/clock": []})
    assert "/left, /right" in refused("2 topics with joint states", path).possible
    assert load_recording(path, LogFormat(topic="/right")).joint_names == ("a2", "a1", "a3")
    refused("topic /arm is not in the bag", path, topic="/arm")
    refused("contains std_msgs/msg/Header", path, topic="/clock")


def test_a_bag_without_joint_states_lists_its_topics(tmp_path):
    error = refused(
        "has no topic with messages of type sensor_msgs/msg/JointState", write_bag(tmp_path, ".mcap", {"/clock": []})
    )
    assert "/clock (std_msgs/msg/Header)" in error.possible


def test_publishers_that_share_a_topic_are_told_apart(tmp_path):
    arm = [message(i) for i in range(N)]
    hand = [message(i, names=("f1", "f2", "f3")) for i in range(N)]
    mixed = [m for pair in zip(arm, hand, strict=True) for m in pair]
    path = write_bag(tmp_path, ".mcap", {"/joint_states": mixed})
    refused("2 publishers on /joint_states publish different joints.*a1, a2, a3.*f1, f2, f3", path)
    chosen = load_recording(path, LogFormat(joints={name: name for name in NAMES}))
    assert_same(chosen, t=SECONDS)
    both = load_recording(path, LogFormat(joints={"a1": "x", "f1": "y"}))
    assert set(both.joint_names) == {*NAMES, "f1"}  # the hand's other joints are nobody's


@BAGS
def test_a_truncated_bag_is_refused(tmp_path, suffix):
    path = write_bag(tmp_path, suffix, {"/js": [message(i) for i in range(N)]})
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    refused("cannot be read as a bag", cut)

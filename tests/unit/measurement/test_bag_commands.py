"""Commands in bags: references of controllers, and topics of commands beside measured joint states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.writing import save_recording
from recordings import joint_state, ros_types, write_bag_folder

NAMES = ("turn", "lift")
EPOCH = 1_700_000_000_000_000_000
STEP = 10_000_000
"""Time from one joint state to the next [ns]."""

N = 60
AT = EPOCH + STEP * np.arange(N)
GIVEN = EPOCH + 4_000_000 + 23_000_000 * np.arange(25)
"""Times of the commands [ns]: slower than the states, and never at the same time."""

rng = np.random.default_rng(7)
Q, EFFORT = rng.normal(size=(2, N, 2))
COMMAND = rng.normal(size=(len(GIVEN), 2))


def last(time: int) -> int:
    """Index of the last command at or before a time, by a search through all of them."""
    return max(k for k, given in enumerate(GIVEN) if given <= time)


def states(effort: NDArray[Any] | None = EFFORT) -> list[tuple[int, Any]]:
    return [joint_state(t, NAMES, Q[k], tau=None if effort is None else effort[k]) for k, t in enumerate(AT)]


def controller_states(
    times: NDArray[Any], command: NDArray[Any], measured: NDArray[Any] | None = None, names: tuple[str, ...] = NAMES
) -> list[tuple[int, Any]]:
    """Messages of a controller; a command that is NaN is an empty reference."""
    kinds = ros_types().types
    still = kinds["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    none = np.zeros(0)

    def point(position: NDArray[Any]) -> Any:
        return kinds["trajectory_msgs/msg/JointTrajectoryPoint"](position, none, none, none, still)

    empty = kinds["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]([], [], [], still)
    result: list[tuple[int, Any]] = []
    for k, t in enumerate(times):
        received, state = joint_state(t, names, command[k])
        reference = point(none if np.isnan(command[k]).any() else command[k])
        feedback = point(none if measured is None else measured[k])
        message = kinds["control_msgs/msg/JointTrajectoryControllerState"](
            state.header, list(names), reference, feedback, point(none), point(none), [], empty, empty, empty, empty
        )
        result.append((received, message))
    return result


def test_the_reference_of_a_controller_is_the_command(tmp_path: Path):
    command = Q + 0.1
    path = write_bag_folder(tmp_path / "bag", controller_states(AT, command, Q))
    found = load_recording(path)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.command, command)  # pyright: ignore[reportArgumentType]
    command[:5] = np.nan
    late = load_recording(write_bag_folder(tmp_path / "late", controller_states(AT, command, Q)))
    np.testing.assert_array_equal(late.command, command)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("effort", [EFFORT, None], ids=["effort", "position"])
@pytest.mark.parametrize("by_name", [False, True], ids=["controller", "name"])
def test_a_command_of_another_topic_is_held(tmp_path: Path, effort: NDArray[Any] | None, by_name: bool):
    """Joint states keep their values and times; each has the last command at or before it."""
    commands = controller_states(GIVEN, COMMAND)
    if by_name:
        commands = [joint_state(t, NAMES[::-1], COMMAND[k, ::-1]) for k, t in enumerate(GIVEN)]
    topics = {"/joint_states": states(effort), "/joint_commands" if by_name else "/arm/state": commands}
    alone = load_recording(write_bag_folder(tmp_path / "alone", states(effort)))
    path = write_bag_folder(tmp_path / "bag", topics)
    found = load_recording(path, LogFormat(topic="/joint_states"))
    early = int((AT < GIVEN[0]).sum())
    assert early == 1
    expected = np.array([COMMAND[last(t)] for t in AT[early:]])
    assert found.command is not None and found.time is not None and alone.time is not None
    np.testing.assert_array_equal(found.command[-len(expected) :], expected)
    if effort is None:
        assert found.samples == N - early
    else:
        np.testing.assert_array_equal(found.q, Q)
        np.testing.assert_array_equal(found.effort, EFFORT)  # pyright: ignore[reportArgumentType]
        np.testing.assert_array_equal(found.command[0], COMMAND[0])
    np.testing.assert_array_equal(found.time, alone.time[-found.samples :])
    finding = next(each for each in found.findings if each.code == "command-held")
    oldest = max(t - GIVEN[last(t)] for t in AT[early:]) / 1e6
    assert f"at most {oldest:.3g} ms old" in finding.evidence and "1 samples before" in finding.evidence


def test_controllers_of_single_joints_make_one_command(tmp_path: Path):
    one = controller_states(GIVEN, COMMAND[:, :1], names=NAMES[:1])
    other = controller_states(GIVEN + 1_000_000, COMMAND[:, 1:], names=NAMES[1:])
    topics = {"/joint_states": states(), "/a/state": one, "/b/state": other}
    found = load_recording(write_bag_folder(tmp_path / "bag", topics), LogFormat(topic="/joint_states"))
    assert found.command is not None
    np.testing.assert_array_equal(found.command[1:, 0], [COMMAND[last(t), 0] for t in AT[1:]])
    np.testing.assert_array_equal(found.command[1:, 1], [COMMAND[last(t - 1_000_000), 1] for t in AT[1:]])
    alone = load_recording(
        write_bag_folder(tmp_path / "one", {"/joint_states": states(), "/a/state": one}),
        LogFormat(topic="/joint_states"),
    )
    assert alone.command is None  # the other joint has none


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_both_forms_of_the_message_are_read(tmp_path: Path, suffix: str):
    """ROS 1 calls reference and feedback `desired` and `actual`."""
    given = Recording(time=np.arange(N) / 100.0, q=Q, command=Q + 0.3, joint_names=NAMES)
    found = load_recording(save_recording(given, tmp_path / f"log{suffix}"))
    assert found.joint_names == NAMES and found.effort is None
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.command, Q + 0.3)  # pyright: ignore[reportArgumentType]

"""The command of a recording follows its positions through every conversion, and changes nothing of the effort."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.dataclass_files import load, save
from armid.doctor.downsample import downsample
from armid.errors import RecordingError
from armid.measurement.convention_conversion import read_recording, to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recording
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording, select_rows
from armid.robot.robot import Frame, Joint, Link, Robot
from armid.study.recordings.data_split import cut_recording

ROUNDING = 1e-12
"""Two or three operations on numbers of the order of one."""

N = 400
TIME = np.arange(N) / 100.0
LAG = 0.02


def assert_equal(found: NDArray[Any] | None, expected: NDArray[Any] | None) -> None:
    """Asserts that two arrays are there and equal, bit by bit."""
    assert found is not None and expected is not None
    np.testing.assert_array_equal(found, expected)


def assert_close(found: NDArray[Any] | None, expected: NDArray[Any] | None, atol: float = ROUNDING) -> None:
    """Asserts that two arrays are there and equal within a tolerance."""
    assert found is not None and expected is not None
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)


def motion(time: Array) -> Array:
    """Positions of three joints [rad]."""
    return np.column_stack([0.4 * np.sin(1.1 * time), 0.3 * np.cos(1.7 * time), 0.5 * np.sin(0.8 * time + 1.0)])


Q = motion(TIME) + 1e-4 * np.random.default_rng(3).normal(size=(N, 3))
COMMAND = motion(TIME + LAG)
EFFORT = Q + np.random.default_rng(4).normal(size=(N, 3))


def measured(**changed: Any) -> Recording:
    """A recording whose positions follow the command with a lag."""
    return replace(Recording(time=TIME, q=Q, command=COMMAND, effort=EFFORT), **changed)


NAMES = ("base", "shoulder", "elbow")


@pytest.fixture
def robot() -> Robot:
    axis, limits = np.array([0.0, 0.0, 1.0]), np.array([-np.inf, np.inf])
    joints = [Joint(name, "revolute", k - 1, axis, np.eye(4), limits) for k, name in enumerate(NAMES)]
    return Robot("arm", tuple(joints), tuple(Link(name) for name in NAMES), Frame("tip", 2, np.eye(4)))


@pytest.mark.parametrize(
    "form",
    [
        LogFormat(),
        LogFormat(units="deg"),
        LogFormat(units=["deg", "rad", "deg"], position_sign=[1, -1, 1], joint_offset=[0.1, -0.2, 0.3]),
        LogFormat(transmission=[[50.0, 0, 0], [0, -80.0, 0], [0, 30.0, 40.0]], joint_offset=[0.0, 0.4, 0.0]),
        LogFormat(joints=["elbow", "base", "shoulder"]),
    ],
    ids=["plain", "degrees", "signs", "transmission", "order"],
)
def test_a_command_is_converted_as_a_position_is(form: LogFormat, robot: Robot):
    """A command that equals the position does so after every conversion, bit by bit."""
    given = measured()
    found = to_robot_convention(replace(given, command=Q), form, robot).recording
    assert_equal(found.command, found.q)
    changed = form.joints or form.units or form.transmission is not None
    assert np.array_equal(found.q, Q) == (not changed)


def test_extra_channels_are_left_out_of_the_command(robot: Robot):
    q, command = (np.column_stack([x, x[:, 0]]) for x in (Q, COMMAND))
    raw = Recording(time=TIME, q=q, command=command)
    found = to_robot_convention(raw, LogFormat(joints=[*robot.joint_names, ""]), robot).recording
    assert_equal(found.command, COMMAND)


@pytest.mark.parametrize("logged", ["both", "position", "command"])
def test_a_command_stays_beside_an_angle_that_wraps(logged: str, robot: Robot):
    """Whole turns are taken from both, also where position and command wrap at different times, or only one does."""
    q = np.column_stack([4.0 * TIME + 1e-3 * np.sin(7.0 * TIME), *motion(TIME).T[1:]])
    command = np.column_stack([4.0 * (TIME + LAG), *motion(TIME + LAG).T[1:]])

    def wrapped(x: Array) -> Array:
        return np.arctan2(np.sin(x), np.cos(x))

    raw = Recording(
        time=TIME,
        q=wrapped(q) if logged != "command" else q,
        command=wrapped(command) if logged != "position" else command,
    )
    found = to_robot_convention(raw, LogFormat(), robot).recording
    assert_close(found.q, q, atol=10 * ROUNDING)
    assert_close(found.command, command, atol=10 * ROUNDING)


def test_a_large_error_is_not_taken_for_a_turn(robot: Robot):
    """A joint that is held by something while its command goes on by more than half a turn keeps its command."""
    command = np.column_stack([np.where(TIME > 2.0, 4.0, 0.1 * TIME), *motion(TIME).T[1:]])
    raw = Recording(time=TIME, q=motion(TIME), command=command)
    assert_equal(to_robot_convention(raw, LogFormat(), robot).recording.command, command)


def test_rows_are_selected_with_their_command(robot: Robot):
    given = measured()
    keep = np.arange(N) % 3 > 0
    assert_equal(select_rows(given, keep).command, COMMAND[keep])
    assert_equal(cut_recording(given, (0.25, 0.75)).command, COMMAND[100:300])
    tied = replace(given, time=np.maximum.accumulate(np.where(np.arange(N) == 50, TIME[49], TIME)))
    found = to_robot_convention(tied, LogFormat(), robot).recording
    assert_equal(found.command, np.delete(COMMAND, 50, axis=0))
    few = downsample(replace(given, consecutive=False, dq=Q, ddq=Q))
    assert few.runs[0].torque.shape == (N, 3)


def test_a_recording_with_a_command_is_stored_and_shown(tmp_path: Path):
    given = measured()
    again = load(Recording, save(given, tmp_path / "recording.npz"))
    assert_equal(again.command, COMMAND)
    assert given.summary().columns == ("joint", "q", "effort", "command")
    with pytest.raises(RecordingError, match=r"command has shape \(400, 2\)"):
        measured(command=np.zeros((N, 2)))


def spoilt(command: Array) -> Array:
    """A command with everything that would be refused or masked in a position."""
    command = command.copy()
    command[40] = 0.0
    command[41:44, 1] = 300.0
    command[90, 2] = np.nan
    return command


@pytest.mark.parametrize("form", [LogFormat(), LogFormat(exclude=[[0.85, 0.95]]), LogFormat(delay=0.004)])
def test_a_command_changes_nothing_beside_an_effort(form: LogFormat, robot: Robot):
    """Rows, masks and observations are the same bits without a command, with a good one and with a bad one."""
    rows = np.r_[0:200, 199, 200:N]  # one of them repeats the row before
    q, effort = (x[rows] for x in (Q, EFFORT))
    base = Recording(time=np.r_[TIME, TIME[-1] + 0.01], q=q, effort=effort)
    good = motion(np.arange(N + 1) / 100.0 + LAG)
    bad = spoilt(good)
    found = []
    for command in (None, good, bad, np.nan_to_num(bad)):
        converted = to_robot_convention(replace(base, command=command), form, robot)
        assert any(each.code == "command-incomplete" for each in converted.findings) == (command is bad)
        assert (converted.recording.command is None) == (command is None or command is bad)
        found.append(converted.recording)
    first, *others = found
    assert first.samples == N  # the repeated row is dropped from all of them
    runs = process_recording(first, ProcessingOptions())[0]
    for other in others:
        for name in ("time", "q", "effort", "valid"):
            assert_equal(getattr(other, name), getattr(first, name))
        for run, same in zip(process_recording(other, ProcessingOptions())[0], runs, strict=True):
            for a, b in ((run.motion.q, same.motion.q), (run.torque, same.torque), (run.mask, same.mask)):
                assert_equal(a, b)


def test_a_spike_of_a_command_is_interpolated_and_masked_for_its_joint(robot: Robot):
    given = measured(effort=None)
    command = np.array(COMMAND)
    command[200, 1] += 300.0
    converted = to_robot_convention(replace(given, command=command), LogFormat(), robot)
    found = converted.recording
    assert_close(found.command, COMMAND, atol=1e-4)  # (1.7 rad/s · 0.01 s)² · 0.3 rad / 8
    assert [tuple(each) for each in np.argwhere(~found.valid)] == [(200, 1)]
    assert "commanded position jumps away" in next(f.evidence for f in converted.findings if f.code == "spikes")


def test_a_command_without_numbers_is_refused_where_nothing_stands_in_its_place(robot: Robot):
    given = measured(effort=None)
    command = np.array(COMMAND)
    command[:30] = np.nan
    with pytest.raises(RecordingError, match=r"command of .* is nan in row 1 ") as caught:
        to_robot_convention(replace(given, command=command), LogFormat(), robot)
    assert "exclude" in str(caught.value.remedy)
    found = to_robot_convention(replace(given, command=command), LogFormat(exclude=[[0.0, 0.295]]), robot).recording
    assert_equal(found.command, COMMAND[30:])


def test_a_joint_that_moves_without_a_command_is_reported(robot: Robot):
    command = np.array(COMMAND)
    command[:, 2] = 0.7
    codes = [
        [f.channel for f in to_robot_convention(each, LogFormat(), robot).findings if f.code == "command-still"]
        for each in (measured(command=command, effort=None), measured(command=command))
    ]
    assert codes == [[robot.joint_names[2]], []]


def table(path: Path, columns: dict[str, Array]) -> Path:
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def columns_of(pattern: str, values: Array, first: int = 1) -> dict[str, Array]:
    return {pattern.format(k + first): x for k, x in enumerate(values.T)}


@pytest.mark.parametrize(
    ("pattern", "first"),
    [
        ("command{}", 1),
        ("cmd{}", 1),
        ("q_cmd{}", 1),
        ("action{}", 1),
        ("target_q_{}", 0),
        ("q_des{}", 1),
        ("reference_{}", 0),
        ("goal_position_{}", 1),
        ("joint_{}_setpoint", 1),
        ("action[{}]", 0),
    ],
)
@pytest.mark.parametrize("positions", ["q{}", "actual_q_{}"])
def test_commanded_columns_beside_measured_ones_are_the_command(
    pattern: str, first: int, positions: str, tmp_path: Path
):
    columns = {"t": TIME} | columns_of(positions, Q, first if "_" in positions else 1)
    columns |= columns_of(pattern, COMMAND, first)
    found = load_recording(table(tmp_path / "run.csv", columns))
    assert_close(found.command, COMMAND)
    assert_close(found.q, Q)
    assert found.effort is None
    both = load_recording(table(tmp_path / "both.csv", columns | columns_of("tau{}", EFFORT)))
    assert_close(both.command, COMMAND)
    assert_close(both.effort, EFFORT)


def test_commanded_columns_with_the_names_of_joints_are_the_command(tmp_path: Path, robot: Robot):
    order = [2, 0, 1]
    columns = {"t": TIME} | {f"{robot.joint_names[k]}_pos": Q[:, k] for k in order}
    columns |= {f"{robot.joint_names[k]}_target": COMMAND[:, k] for k in order[::-1]}
    found = read_recording(table(tmp_path / "run.csv", columns), robot)
    assert_close(found.command, COMMAND)
    assert_close(found.q, Q)


def test_commanded_columns_stay_positions_where_none_were_measured(tmp_path: Path):
    columns = {"t": TIME} | columns_of("target_q_{}", COMMAND, 0) | columns_of("tau{}", EFFORT)
    found = load_recording(table(tmp_path / "run.csv", columns))
    assert_close(found.q, COMMAND)
    assert found.command is None and found.findings[0].severity == "warning"


def test_two_sets_that_may_be_the_command_are_both_left_and_named(tmp_path: Path):
    columns = {"t": TIME} | columns_of("q{}", Q) | columns_of("q_des{}", COMMAND)
    path = table(tmp_path / "run.csv", columns | columns_of("q_ref{}", COMMAND + 0.1))
    found = load_recording(path)
    finding = next(each for each in found.findings if each.code == "command-possible")
    assert found.command is None and "q_des1, q_des2, q_des3; q_ref1, q_ref2, q_ref3" in finding.evidence
    stated = load_recording(path, LogFormat(columns={"command": "q_ref{}"}))
    assert_close(stated.command, COMMAND + 0.1)


def test_a_unit_in_the_name_of_a_command_is_used(tmp_path: Path, robot: Robot):
    columns = {"t": TIME} | columns_of("q{}", Q) | columns_of("cmd{}_deg", np.degrees(COMMAND))
    found = read_recording(table(tmp_path / "run.csv", columns), robot)
    assert_close(found.command, COMMAND)


@pytest.mark.parametrize("other", [{"command": "go"}, {"command": "1"}, {"command1": "on", "command2": "off"}])
def test_other_columns_of_these_names_are_not_a_command(other: dict[str, str], tmp_path: Path):
    """Words, a number for the whole arm and other numbers of columns are read as before: not at all."""
    header = ["t", "q1", "q2", "q3", *other]
    lines = [",".join([*map(repr, map(float, row)), *other.values()]) for row in np.column_stack([TIME, Q])]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([",".join(header), *lines]))
    found = load_recording(path)
    assert found.command is None and found.n == 3


def test_a_stated_command_with_another_number_of_columns_is_refused(tmp_path: Path):
    columns = {"t": TIME} | columns_of("q{}", Q) | columns_of("u{}", Q[:, :2])
    path = table(tmp_path / "run.csv", columns)
    with pytest.raises(RecordingError, match=r"3 channels of positions \(q\), but 2 of the command"):
        load_recording(path, LogFormat(columns={"command": "u{}"}))
    assert load_recording(path, LogFormat(columns={"command": ""})).command is None

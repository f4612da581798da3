"""Columns that are taken, by pattern, list, preset or usual name."""

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.columns.missing_channels import absent_columns
from armid.measurement.log_format import PRESETS, LogFormat
from armid.measurement.readers import load_recording
from armid.robot import load_robot
from labs import write_arm
from recordings import DDQ, DQ, RNG, TABLE, TAU, N, Q, T, assert_same, refused, write_csv


def test_columns_by_pattern_by_list_and_left_out(tmp_path):
    table = (
        {"zeit": T} | {f"qm{i + 1}": Q[:, i] for i in range(3)} | {f"f_{n}": TAU[:, i] for i, n in enumerate("xyz")}
    )
    path = write_csv(tmp_path / "run.csv", table)
    chosen = load_recording(path, LogFormat(columns={"time": "zeit", "q": "qm{}", "effort": ["f_z", "f_x", "f_y"]}))
    np.testing.assert_array_equal(chosen.q, Q)
    np.testing.assert_array_equal(chosen.effort, TAU[:, [2, 0, 1]])
    np.testing.assert_array_equal(chosen.time, T)
    plain = load_recording(write_csv(tmp_path / "plain.csv"), LogFormat(columns={"time": "", "dq": ""}, rate=100))
    assert plain.time is None and plain.dq is None and plain.rate == 100.0


def test_columns_beyond_nine_keep_their_order(tmp_path):
    names = [f"q{i}" for i in RNG.permutation(np.arange(1, 13))]
    path = write_csv(tmp_path / "run.csv", {name: np.full(3, float(name[1:])) for name in names})
    np.testing.assert_array_equal(load_recording(path).q[0], np.arange(1, 13))


def test_an_unknown_column_is_answered_with_what_is_there(tmp_path):
    path = write_csv(tmp_path / "run.csv")
    error = refused("No column is called 'pos{}' for q", path, columns={"q": "pos{}"})
    assert "t, q1, q2, q3, dq1" in error.possible
    refused("No column is called 'b'", path, columns={"effort": ["tau1", "b", "tau3"]})
    refused("No column holds positions", write_csv(tmp_path / "other.csv", {"x": T, "y": T}))
    refused("No column is called 'timestamp' for time", path, preset="ur-rtde")


def test_a_gap_in_the_numbers_is_refused(tmp_path):
    gap = {name: column for name, column in TABLE.items() if name != "tau2"}
    refused("must start at 1 and have no gap; found tau1, tau3; missing: tau2", write_csv(tmp_path / "gap.csv", gap))
    zero = {name.replace("3", "0"): column for name, column in TABLE.items()}
    path = write_csv(tmp_path / "zero.csv", zero)
    guessed = load_recording(path)
    np.testing.assert_array_equal(guessed.q, Q[:, [2, 0, 1]])
    assert [f.code for f in guessed.findings] == ["columns-guessed"]
    columns = {"q": "q{0}", "dq": "dq{0}", "effort": "tau{0}"}
    np.testing.assert_array_equal(load_recording(path, LogFormat(columns=columns)).q, Q[:, [2, 0, 1]])


def test_a_missing_channel_is_refused(tmp_path):
    short = {name: column for name, column in TABLE.items() if name != "tau3"}
    refused(
        r"3 columns of q \(q1 … q3\), but 2 columns of effort \(tau1 … tau2\) \(missing columns of effort: tau3\)",
        write_csv(tmp_path / "short.csv", short),
    )


@pytest.mark.parametrize(("style", "base"), [("tau", 1), ("tau_", 0), ("actual_current_", 0)])
@pytest.mark.parametrize("missing", [0, 1, 2])
def test_a_missing_column_of_effort_is_named_with_its_joint(tmp_path, style: str, base: int, missing: int):
    """Usual names with a gap or without the last column are refused; other names are told as possible effort."""
    robot = load_robot(write_arm(tmp_path))
    table = {"t": T} | {f"q{'_' * (not base)}{k + base}": Q[:, k] for k in range(3)}
    table |= {f"{style}{k + base}": TAU[:, k] for k in range(3) if k != missing}
    path, name = write_csv(tmp_path / "short.csv", table), f"{style}{missing + base} ({robot.joint_names[missing]})"
    ambiguous = base == missing == 0  # or the efforts count from 1 and the last one is missing
    try:
        (told,) = [each for each in load_recording(path, robot=robot).findings if each.code == "effort-possible"]
        said, remedy = told.evidence, told.remedy
    except RecordingError as error:
        said, remedy = str(error), error.remedy
    assert (name in said and "lock" in remedy) != ambiguous


@pytest.mark.parametrize(
    ("present", "base", "missing"),
    [
        ([1, 2, 3, 4, 5], 0, {}),
        ([1, 2, 4, 5], 0, {}),
        ([0, 1, 2, 3, 4], 0, {5: "tau_5"}),
        ([0, 2, 3, 4, 5], 0, {1: "tau_1"}),
        ([1, 2, 3, 4, 5], 1, {5: "tau_6"}),
        ([2, 3, 4, 5, 6], 1, {0: "tau_1"}),
    ],
)
def test_a_missing_column_is_named_only_if_one_numbering_fits(present: list[int], base: int, missing: dict[int, str]):
    """Efforts 1 … 5 beside positions 0 … 5 lack the first column, or the sixth if they count from 1."""
    assert absent_columns([f"tau_{k}" for k in present], [f"q{k + base}" for k in range(6)]) == missing


def test_currents_are_known_by_their_names(tmp_path):
    table = {name.replace("tau", "i"): column for name, column in TABLE.items()}
    recording = load_recording(write_csv(tmp_path / "run.csv", table))
    assert recording.effort_is_current
    np.testing.assert_array_equal(recording.effort, TAU)
    assert not load_recording(write_csv(tmp_path / "torque.csv")).effort_is_current
    both = write_csv(tmp_path / "both.csv", TABLE | {f"i{i + 1}": DDQ[:, i] for i in range(3)})
    np.testing.assert_array_equal(load_recording(both).effort, TAU)
    refused("not clear to which of them `drive_gain` applies", both, drive_gain=[1.0, 2.0, 3.0])
    named = load_recording(both, LogFormat(drive_gain=[1.0, 2.0, 3.0], columns={"effort": "i{}"}))
    np.testing.assert_array_equal(named.effort, DDQ)
    assert named.effort_is_current


def test_a_log_of_the_rtde_recorder(tmp_path):
    table = {"timestamp": T} | {
        f"{name}_{i}": x[:, i]
        for name, x in (("target_q", DDQ), ("actual_q", Q), ("actual_qd", DQ), ("actual_current", TAU))
        for i in range(3)
    }
    path = write_csv(tmp_path / "robot_data.csv", table, delimiter=" ")
    recording = load_recording(path, LogFormat(preset="ur-rtde"))
    assert_same(recording)
    assert recording.effort_is_current
    model = load_recording(path, LogFormat(preset="ur-rtde", columns={"effort": "target_q_{0}"}))
    np.testing.assert_array_equal(model.effort, DDQ)
    assert not model.effort_is_current


def test_a_log_of_pyfri(tmp_path):
    nanoseconds = 999_000_000 + 5_000_000 * np.arange(N)
    table = {"index": np.arange(N), "tsec": 1_700_000_000 + nanoseconds // 10**9, "tnsec": nanoseconds % 10**9}
    table |= {f"{name}{i + 1}": x[:, i] for name, x in (("mp", Q), ("ip", DDQ), ("mt", TAU)) for i in range(3)}
    recording = load_recording(write_csv(tmp_path / "fri.csv", table), LogFormat(preset="kuka-fri"))
    assert recording.dq is None
    np.testing.assert_array_equal(recording.q, Q)
    np.testing.assert_array_equal(recording.effort, TAU)
    # A double holds 1.7e9 s to 2e-7 s only; the clock must be better than that.
    np.testing.assert_allclose(np.diff(recording.time), 0.005, rtol=0, atol=1e-12)


def test_a_log_of_libfranka_counts_milliseconds(tmp_path):
    table = {"time": np.arange(N), "success_rate": np.ones(N)} | {
        f"state.{name}[{i}]": x[:, i]
        for name, x in (("q", Q), ("q_d", DDQ), ("dq", DQ), ("tau_J", TAU), ("tau_ext_hat_filtered", DDQ))
        for i in range(3)
    }
    recording = load_recording(write_csv(tmp_path / "franka.csv", table), LogFormat(preset="libfranka"))
    assert_same(recording, t=np.arange(N) * 1e-3)


def test_presets_name_at_least_time_position_and_effort():
    for preset in PRESETS.values():
        assert {"time", "q", "effort"} <= set(preset.columns)

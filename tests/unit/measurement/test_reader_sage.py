"""Folders of SAGE and lists in the fields of tables, written here and read back, and a published folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.errors import RecordingError
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording

N, M = 80, 31
NAMES = ("Rotation", "Pitch", "Jaw")

rng = np.random.default_rng(11)
STAMPS = np.cumsum(rng.uniform(18_000.0, 22_000.0, N))
"""Times of the states [µs]."""

GIVEN = STAMPS[2] + 1_000.0 + np.cumsum(rng.uniform(30_000.0, 60_000.0, M))
Q, DQ = rng.normal(size=(2, N, 3))
LOAD = np.abs(rng.normal(size=(N, 3)))
COMMAND = rng.normal(size=(M, 3))

MICROSECOND = 1e-6


def cell(values: NDArray[np.float64]) -> str:
    return '"' + str(values.tolist()) + '"'


def write(folder: Path, load: NDArray[np.float64] = LOAD, events: str = "") -> Path:
    folder.mkdir()
    rows = zip(STAMPS.tolist(), Q, DQ, load, strict=True)
    states = [f"STATE_MOTOR,{t!r},{cell(q)},{cell(dq)},{cell(tau)}" for t, q, dq, tau in rows]
    (folder / "state_motor.csv").write_text(
        "\n".join(["type,timestamp,positions,velocities,torques", *states]) + "\n"
    )
    commands = [f"CONTROL,{t!r},{cell(c)}" for t, c in zip(GIVEN.tolist(), COMMAND, strict=True)]
    (folder / "control.csv").write_text("\n".join(["type,timestamp,positions", *commands]) + "\n")
    (folder / "joint_list.txt").write_text("\n".join(NAMES) + "\n")
    if events:
        (folder / "event.csv").write_text(f"type,timestamp,event\n{events}")
    return folder


def expected(rows: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The last command at or before each row, by a search through all commands."""
    return np.array([COMMAND[max(k for k in range(M) if GIVEN[k] <= t)] for t in STAMPS[rows]])


def assert_rows(found: Recording, rows: NDArray[np.bool_]) -> None:
    assert found.time is not None and found.command is not None and found.dq is not None
    np.testing.assert_array_equal(found.time, STAMPS[rows] * MICROSECOND)
    np.testing.assert_array_equal(found.q, Q[rows])
    np.testing.assert_array_equal(found.dq, DQ[rows])


def test_each_state_has_the_last_command(tmp_path: Path):
    folder = write(tmp_path / "run")
    found = load_recording(folder)
    rows = STAMPS >= GIVEN[0]
    assert 0 < rows.sum() < N
    assert_rows(found, rows)
    np.testing.assert_array_equal(found.command, expected(rows))  # pyright: ignore[reportArgumentType]
    assert found.joint_names == NAMES and found.effort is None
    assert [each.code for each in found.findings] == ["effort-possible", "command-held"]
    shutil.copytree(folder, tmp_path / "copy")
    assert load_recording(tmp_path / "copy").sha256 == found.sha256
    (folder / "control.csv").write_text((folder / "control.csv").read_text().replace("CONTROL", "CONTROLS"))
    assert load_recording(folder).sha256 != found.sha256


def test_a_torque_with_a_sign_is_the_effort_and_keeps_all_rows(tmp_path: Path):
    torque = LOAD * np.sign(Q)
    found = load_recording(write(tmp_path / "run", load=torque))
    assert_rows(found, np.ones(N, dtype=np.bool_))
    np.testing.assert_array_equal(found.effort, torque)  # pyright: ignore[reportArgumentType]
    rows = STAMPS >= GIVEN[0]
    assert found.command is not None
    np.testing.assert_array_equal(found.command[rows], expected(rows))


def test_columns_of_the_log_format_are_used_or_left_out(tmp_path: Path):
    folder = write(tmp_path / "run")
    named = load_recording(folder, LogFormat(columns={"effort": "torques", "dq": "", "command": ""}))
    np.testing.assert_array_equal(named.effort, LOAD)  # pyright: ignore[reportArgumentType]
    assert named.dq is None and named.command is None and named.samples == N
    with pytest.raises(RecordingError, match="has no column 'tau'") as caught:
        load_recording(folder, LogFormat(columns={"effort": "tau"}))
    assert "torques" in caught.value.possible


def test_states_without_drives_are_left_out(tmp_path: Path):
    on, off = STAMPS[20], STAMPS[60]
    events = f"EVENT,{on},CONTROL_MODE_ENABLE\nEVENT,{on},MOTION_START\nEVENT,{off},DISABLE\n"
    found = load_recording(write(tmp_path / "run", events=events))
    assert_rows(found, (STAMPS >= on) & (STAMPS <= off))
    assert "39 states" in next(each.evidence for each in found.findings if each.code == "switched-off")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("joint_list.txt", "a\nb\n", "lists 2 joints"),
        ("control.csv", 'type,timestamp,positions\nC,1.0,"[1.0, 2.0]"\n', "commands for 2 joints"),
        ("control.csv", "type,timestamp\nC,1.0\n", "has no column 'positions'"),
        ("state_motor.csv", 'timestamp,positions\n1.0,"[1.0, 2.0]"\n2.0,"[1.0]"\n', "line 3: positions has 1 number"),
        (
            "state_motor.csv",
            'timestamp,positions\n1.0,"[1.0, 2.0]"\n2.0,"[1.0, x]"\n',
            "line 3: positions is '1.0, x'",
        ),
    ],
)
def test_a_damaged_folder_is_refused(name: str, text: str, words: str, tmp_path: Path):
    folder = write(tmp_path / "run")
    (folder / name).write_text(text)
    with pytest.raises(RecordingError, match=words):
        load_recording(folder)


@pytest.mark.parametrize("brackets", ["[{}]", " [ {} ] "])
@pytest.mark.parametrize("between", [", ", "  "])
def test_lists_in_the_fields_of_a_table(brackets: str, between: str, tmp_path: Path):
    def text(values: NDArray[np.float64]) -> str:
        return '"' + brackets.format(between.join(map(repr, values.tolist()))) + '"'

    lines = [f"{t!r},{text(q)},{text(c)}" for t, q, c in zip(STAMPS.tolist(), Q, Q[::-1], strict=True)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["time_us,q,command", *lines]))
    found = load_recording(path)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.command, Q[::-1])  # pyright: ignore[reportArgumentType]
    assert found.time is not None
    np.testing.assert_allclose(found.time, STAMPS * MICROSECOND, rtol=1e-15)

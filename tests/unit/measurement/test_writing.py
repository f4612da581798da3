"""Written files are read back: every format, every bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import MissingExtraError, OutputError
from armid.measurement.catalogue import READERS, recording_suffixes
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.writing import WRITERS, save_recording

CLOCK = 1e-9
"""Stamps of a ROS message count nanoseconds [s]."""

BAGS = (".bag", ".db3", ".mcap")

NAMED = (".npz", ".mat", *BAGS)
"""Formats that keep the names of the joints."""


def recording() -> Recording:
    rng = np.random.default_rng(0)
    q, dq, effort = rng.normal(size=(3, 50, 3))
    return Recording(time=np.arange(50) / 100.0, q=q, dq=dq, effort=effort, joint_names=("a", "b", "c"))


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_recording_comes_back(tmp_path: Path, suffix: str):
    given = recording()
    found = load_recording(save_recording(given, tmp_path / f"log{suffix}"))
    for name in ("q", "dq", "effort"):
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    np.testing.assert_allclose(found.time, given.time, atol=CLOCK if suffix in BAGS else 0.0)
    assert found.joint_names == (given.joint_names if suffix in NAMED else ())
    assert found.sha256 and [path.name for path in tmp_path.iterdir()] == [f"log{suffix}"]


@pytest.mark.parametrize("with_effort", [True, False])
@pytest.mark.parametrize("suffix", WRITERS)
def test_a_command_comes_back(tmp_path: Path, suffix: str, with_effort: bool):
    given = recording()
    given = replace(given, command=given.q + 0.25, effort=given.effort if with_effort else None)
    found = load_recording(save_recording(given, tmp_path / f"log{suffix}"))
    for name in ("q", "dq", "command", *(["effort"] if with_effort else [])):
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name))
    assert (found.effort is not None) == with_effort


@pytest.mark.parametrize("suffix", WRITERS)
def test_without_clock_and_velocity(tmp_path: Path, suffix: str):
    given = replace(recording(), time=None, dq=None, rate=100.0)
    found = load_recording(save_recording(given, tmp_path / f"log{suffix}"), LogFormat(rate=100.0))
    assert found.time is None and found.dq is None
    np.testing.assert_array_equal(found.effort, given.effort)  # pyright: ignore[reportArgumentType]


def test_every_format_that_programs_record_can_be_written():
    by_others = {"excel", "hdf5", "lerobot", "sage"}  # made by people, or by programs that record whole folders
    assert WRITERS.keys() <= set(recording_suffixes())
    assert {name for name, each in READERS.items() if not WRITERS.keys() & set(each.suffixes)} == by_others


def test_other_formats_are_refused(tmp_path: Path):
    with pytest.raises(OutputError, match=r"log\.xls") as caught:
        save_recording(recording(), tmp_path / "log.xls")
    assert ".csv" in caught.value.possible


@pytest.mark.parametrize(("suffix", "package"), [(".parquet", "pyarrow"), (".mcap", "rosbags.rosbag2")])
def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, package: str):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MissingExtraError, match="io"):
        save_recording(recording(), tmp_path / f"log{suffix}")

"""Duties of every reader of recordings. A new reader adds a writer of a small file for each of its endings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from damage import cut, is_helpful, junk

from armid.errors import ArmidError, MissingExtraError
from armid.hashes import sha256_of_file
from armid.measurement.catalogue import READERS, recording_suffixes
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from recordings import (
    DQ,
    SECONDS,
    TABLE,
    TAU,
    N,
    Q,
    T,
    assert_same,
    message,
    write_bag,
    write_csv,
    write_parquet,
    write_workbook,
)


def write_npz(path: Path) -> Path:
    np.savez(path, **TABLE)
    return path


def write_mat(path: Path) -> Path:
    scipy.io.savemat(path, TABLE)
    return path


def write_hdf5(path: Path) -> Path:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in (("t", T), ("q", Q), ("dq", DQ), ("tau", TAU)):
            file[name] = values
    return path


def bag(suffix: str) -> Callable[[Path], Path]:
    return lambda folder: write_bag(folder, suffix, {"/joint_states": [message(i) for i in range(N)]})


WRITERS: dict[str, Callable[[Path], Path]] = {
    ".csv": lambda folder: write_csv(folder / "run.csv"),
    ".tsv": lambda folder: write_csv(folder / "run.tsv", delimiter="\t"),
    ".txt": lambda folder: write_csv(folder / "run.txt", delimiter=" "),
    ".dat": lambda folder: write_csv(folder / "run.dat", delimiter=";"),
    ".asc": lambda folder: write_csv(folder / "run.asc", delimiter="\t"),
    ".log": lambda folder: write_csv(folder / "run.log"),
    ".xlsx": lambda folder: write_workbook(folder / "run.xlsx"),
    ".xlsm": lambda folder: write_workbook(folder / "run.xlsm"),
    ".parquet": lambda folder: write_parquet(folder / "run.parquet"),
    ".pq": lambda folder: write_parquet(folder / "run.pq"),
    ".npz": lambda folder: write_npz(folder / "run.npz"),
    ".mat": lambda folder: write_mat(folder / "run.mat"),
    ".hdf5": lambda folder: write_hdf5(folder / "run.hdf5"),
    ".h5": lambda folder: write_hdf5(folder / "run.h5"),
    ".bag": bag(".bag"),
    ".db3": bag(".db3"),
    ".mcap": bag(".mcap"),
}
"""Writers of the same recording, by ending."""

BAGS = (".bag", ".db3", ".mcap")
"""Formats whose clock is absolute, so that a reader lets it begin at zero."""

OPTIONAL = ("h5py", "pyarrow", "python_calamine", "rosbags")
"""Packages that come with extras."""

OWNERS = {suffix: each for each in READERS.values() for suffix in each.suffixes}
SUFFIX = pytest.mark.parametrize("suffix", OWNERS)


def assert_read_or_refused(path: Path, content: bytes) -> ArmidError | None:
    """A recording, or an error that says what to do; anything else fails."""
    path.write_bytes(content)
    try:
        assert isinstance(load_recording(path), Recording)
    except ArmidError as error:
        assert is_helpful(error), error
        return error
    return None


def test_an_ending_has_one_reader():
    suffixes = recording_suffixes()
    assert len(suffixes) == len(set(suffixes)) and all(s == s.lower() and s.startswith(".") for s in suffixes)
    assert set(suffixes) == set(WRITERS)


@SUFFIX
def test_every_format_says_the_same_recording(suffix: str, tmp_path: Path):
    path = WRITERS[suffix](tmp_path)
    before = path.read_bytes()
    first, second = load_recording(path), load_recording(path)
    for recording in (first, second):
        assert_same(recording, t=SECONDS if suffix in BAGS else T)
        assert recording.valid.all() and recording.source == str(path)
        assert recording.sha256 == sha256_of_file(path)
    assert path.read_bytes() == before


@SUFFIX
def test_junk_is_refused(suffix: str, tmp_path: Path):
    for content in (b"", *junk()):
        assert assert_read_or_refused(tmp_path / f"junk{suffix}", content) is not None, content[:20]


@SUFFIX
def test_other_formats_are_refused(suffix: str, tmp_path: Path):
    for other, reader in OWNERS.items():
        if reader is not OWNERS[suffix]:
            (tmp_path / other[1:]).mkdir()
            content = WRITERS[other](tmp_path / other[1:]).read_bytes()
            assert assert_read_or_refused(tmp_path / f"run{suffix}", content) is not None, other


@SUFFIX
def test_a_file_cut_short_is_read_or_refused(suffix: str, tmp_path: Path):
    content = WRITERS[suffix](tmp_path).read_bytes()
    for part in cut(content, 12):
        assert_read_or_refused(tmp_path / f"cut{suffix}", part)


@SUFFIX
def test_a_missing_package_is_named_with_its_extra(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Without the optional packages a format is read as ever, or the error says which extra to install."""
    path = WRITERS[suffix](tmp_path)
    for package in OPTIONAL:
        monkeypatch.setitem(__import__("sys").modules, package, None)
    try:
        load_recording(path)
    except MissingExtraError as error:
        extra = getattr(OWNERS[suffix].reader, "EXTRA", "")
        assert extra and f"armid[{extra}]" in error.remedy

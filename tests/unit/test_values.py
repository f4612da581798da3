"""Checked arrays, values on disk, and files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import stat
from dataclasses import dataclass

import numpy as np
import pytest

from armid import atomic_file
from armid.atomic_file import replace_file
from armid.checked_array import array
from armid.dataclass_files import load, save
from armid.errors import ArmidError, OutputError
from armid.estimation.estimate_record import InputDigest
from armid.hashes import digest, sha256_of_file
from armid.information.information import FactorOrigin
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.motion import Motion

# Arrays --------------------------------------------------------------------------------------------------------


def test_an_array_is_a_read_only_copy():
    mine = np.array([[1, 2], [3, 4]])
    checked = array(mine, (2, None), "x")
    mine[0, 0] = 9
    assert checked.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert checked.dtype == np.float64
    assert checked.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        checked[0, 0] = 5.0


@pytest.mark.parametrize(
    ("value", "shape", "problem"),
    [
        ([1.0, 2.0], (3,), r"x must have shape \(3\); found \(2,\)"),
        ([1.0, 2.0], (None, 2), r"x must have shape \(any, 2\)"),
        ([[1.0], [2.0, 3.0]], (None, None), "x must be an array of numbers"),
        (["one"], (1,), "x must be an array of numbers; found .'one'"),
        (None, (1,), "x must"),
        ([1.0, float("nan"), 2.0], (3,), r"x must be finite; found nan at index \(1,\)"),
        ([[1.0, float("inf")]], (1, 2), r"found inf at index \(0, 1\)"),
    ],
)
def test_what_does_not_fit_is_refused(value, shape, problem):
    with pytest.raises(ArmidError, match=problem):
        array(value, shape, "x")


def test_infinity_where_it_is_allowed():
    assert array([np.inf, np.nan], (2,), "x", finite=False)[0] == np.inf


# Save and load -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Inner:
    name: str
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class Outer:
    parts: tuple[Inner, ...]
    table: dict[str, np.ndarray]
    pair: tuple[int, str]
    maybe: Inner | None
    nothing: Inner | None
    limit: float
    flags: np.ndarray


def test_nested_values_come_back(tmp_path):
    inner = Inner("α", np.arange(6.0).reshape(2, 3))
    value = Outer((inner, inner), {"a": np.ones(2)}, (3, "x"), inner, None, float("inf"), np.array([True, False]))
    loaded = load(Outer, save(value, tmp_path / "value.npz"))
    assert [part.name for part in loaded.parts] == ["α", "α"]
    assert np.array_equal(loaded.parts[1].weights, inner.weights)
    assert np.array_equal(loaded.table["a"], np.ones(2))
    assert (loaded.pair, loaded.nothing, loaded.limit) == ((3, "x"), None, np.inf)
    assert isinstance(loaded.maybe, Inner)
    assert loaded.flags.dtype == np.bool_


def test_observations_come_back(tmp_path):
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(10) / 100.0, *rng.normal(size=(3, 10, 2)))
    run = ObservedRun(motion, rng.normal(size=(10, 2)), 100.0, 3, 1, rng.random((3, 2)) < 0.5, np.array([0, 0, 1]))
    observations = Observations((run,), Band("butterworth", 5.0, 4, "pad", columns=False))
    loaded = load(Observations, save(observations, tmp_path / "observations.npz"))
    assert loaded.band == observations.band
    for name in ("time", "q", "dq", "ddq"):
        assert np.array_equal(getattr(loaded.runs[0].motion, name), getattr(motion, name))
    for name in ("torque", "mask", "block"):
        assert np.array_equal(getattr(loaded.runs[0], name), getattr(run, name))
    assert (loaded.runs[0].rate, loaded.runs[0].step, loaded.runs[0].offset) == (100.0, 3, 1)


@pytest.mark.parametrize("weights", [np.zeros(2, [("a", "f8")]), np.zeros(2, "M8[s]"), np.zeros(2, "V8")])
def test_arrays_without_numbers_are_refused(tmp_path, weights):
    path = save(Inner("α", weights), tmp_path / "value.npz")
    with pytest.raises(ArmidError, match=r"value\.npz cannot be read as a Inner.*stands in place of numbers"):
        load(Inner, path)


def test_another_type_is_refused(tmp_path):
    path = save(Band(), tmp_path / "band.npz")
    with pytest.raises(ArmidError, match="contains a value of type Band, but a Motion is needed"):
        load(Motion, path)


def test_files_that_hold_no_value(tmp_path):
    path = tmp_path / "x.npz"
    with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
        load(Band, path)
    for content in (b"", b"nothing of the kind"):
        path.write_bytes(content)
        with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
            load(Band, path)
    with open(path, "wb") as stream:
        np.save(stream, np.ones(3))
    with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
        load(Band, path)
    np.savez(path, x=np.ones(3))
    with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
        load(Band, path)
    whole = save(Band(), path).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
        load(Band, path)


def test_nothing_is_unpickled(tmp_path):
    """An object array in the file would run whatever it likes when loaded."""

    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    header = np.frombuffer(json.dumps({"type": "Band", "value": {"family": {"array": "trap"}}}).encode(), np.uint8)
    path = tmp_path / "trap.npz"
    np.savez(path, **{"value.json": header, "trap": np.array([Trap()], dtype=object)})
    with pytest.raises(ArmidError, match="cannot be read as a value saved by armid"):
        load(Band, path)
    assert not (tmp_path / "sprung").exists()


# Files whole or not at all ---------------------------------------------------------------------------------------


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_whole(tmp_path):
    path = replace_file(tmp_path / "deep" / "er" / "x.json", "old")
    replace_file(path, b"new")
    assert path.read_text() == "new"
    assert names(path.parent) == ["x.json"]


def test_permissions_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        path = replace_file(tmp_path / "x", "text")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.parametrize("broken", ["fsync", "replace"])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, broken):
    path = replace_file(tmp_path / "x.json", "old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic_file.os, broken, full)
    with pytest.raises(OutputError, match="No space left on device") as caught:
        replace_file(path, "new")
    assert "free space" in caught.value.remedy
    assert path.read_text() == "old"
    assert names(tmp_path) == ["x.json"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_write_to_a_full_device(tmp_path, monkeypatch):
    """The first flush fails, as on a disk that is really full."""
    path = replace_file(tmp_path / "x.json", "old")
    fdopen = os.fdopen

    def onto_full(handle, mode):
        os.close(handle)
        return fdopen(os.open("/dev/full", os.O_WRONLY), mode)

    monkeypatch.setattr(atomic_file.os, "fdopen", onto_full)
    with pytest.raises(OutputError, match="could not be written"):
        replace_file(path, "new" * 100_000)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["x.json"]


def test_targets_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "x", tmp_path / "folder"):
        with pytest.raises(OutputError, match="could not be written"):
            replace_file(path, "text")
    assert names(tmp_path) == ["file", "folder"]
    assert names(tmp_path / "folder") == []
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="could not be written"):
            replace_file(tmp_path / "x", "text")
    finally:
        tmp_path.chmod(0o700)
    assert names(tmp_path) == []


# Digests -------------------------------------------------------------------------------------------------------


def test_digests(tmp_path):
    path = replace_file(tmp_path / "x", b"abc")
    assert sha256_of_file(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert digest("a", "bc") != digest("ab", "c")
    assert digest(np.arange(4.0)) == digest([0.0, 1.0, 2.0, 3.0])
    assert digest(np.arange(4.0)) != digest(np.arange(4.0)[::-1])
    assert digest(np.arange(8.0)[::2]) == digest([0.0, 2.0, 4.0, 6.0])


@dataclass(frozen=True, slots=True)
class Inputs:
    first: tuple[InputDigest, ...]
    made_by: FactorOrigin


def test_a_text_value_is_kept_as_its_text(tmp_path):
    inputs = Inputs((InputDigest("earlier run", "1f"), InputDigest("robot", "2e")), FactorOrigin("native", "qr"))
    path = save(inputs, tmp_path / "inputs.npz")
    with np.load(path) as archive:
        header = json.loads(bytes(archive["value.json"]))
    assert header["value"] == {"first": ["earlier run 1f", "robot 2e"], "made_by": "native qr"}
    assert load(Inputs, path) == inputs

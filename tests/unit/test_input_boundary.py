"""Every failure on a file from outside is one kind of error, and sizes are limited."""

from __future__ import annotations

import gzip
import json
import os
import re
from collections.abc import Callable
from contextvars import copy_context
from pathlib import Path

import numpy as np
import pytest

from armid.dataclass_files import load, save
from armid.errors import ArmidError, RecordingError, RobotError
from armid.excitation.fourier import Excitation, load_plan
from armid.input_boundary import LIMITS, allow, boundary, limit, naming, parsed_limits, read_json, read_toml, within
from armid.measurement.readers import load_recording
from armid.robot import load_robot
from armid.study.config import load_study
from armid.study.fleet.fleet_file import load_fleet_file

DEEP = "[" * 100_000


class PanicException(BaseException):
    """Named like what libraries in Rust raise."""


@pytest.mark.parametrize(
    "fault",
    [ValueError("odd"), KeyError("q"), RecursionError(), MemoryError(), OSError(5, "broken"), PanicException("rust")],
)
def test_a_failure_of_a_library_names_file_and_remedy(fault: BaseException):
    with (
        pytest.raises(RecordingError, match=r"log\.x cannot be read as a bag") as caught,
        boundary("a bag", "log.x", RecordingError),
    ):
        raise fault
    assert caught.value.remedy and caught.value.__cause__ is fault


@pytest.mark.parametrize("passing", [RobotError("own"), KeyboardInterrupt(), SystemExit(3)])
def test_own_errors_and_interruptions_pass(passing: BaseException):
    with pytest.raises(type(passing)) as caught, boundary("a bag", "log.x"):
        raise passing
    assert caught.value is passing


def test_own_errors_about_values_are_given_the_name_of_the_file():
    with pytest.raises(RobotError, match=r"^a/b\.toml: own\n") as caught, naming("a/b.toml"):
        raise RobotError("own", possible="this", remedy="that")
    assert (caught.value.possible, caught.value.remedy) == ("this", "that")
    with pytest.raises(RobotError, match=r"^The file a/b\.toml has none"), naming("a/b.toml"):
        raise RobotError("The file a/b.toml has none.")


@pytest.mark.parametrize(
    ("name", "text", "read"),
    [
        ("study.toml", "[robots]\n", load_study),
        ("FLEET.toml", "[robot]\n[[unit]]\nname = 3\n", load_fleet_file),
        ("plan.json", json.dumps({"base_frequency": 1, "a": [], "b": 1, "offset": [0], "robot": "a"}), load_plan),
    ],
)
def test_errors_about_wrong_values_name_the_file(
    tmp_path: Path, name: str, text: str, read: Callable[[Path], object]
):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ArmidError, match=re.escape(str(path))):
        read(path)


@pytest.mark.parametrize("text", ["", "[]", "1", "{", DEEP, '{"a": ' * 50_000, "\x00", "NaN"])
def test_what_is_no_record_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(ArmidError, match=r"a\.json cannot be read as a plan"):
        read_json(path, "a plan")


@pytest.mark.parametrize("text", ["a", "a = " + DEEP, "a = 1\na = 2", "a = \x00"])
def test_what_is_no_table_is_refused(tmp_path: Path, text: str):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ArmidError, match=r"a\.toml is not valid TOML"):
        read_toml(path, "a study")


@pytest.mark.parametrize("levels", [100, 400])
def test_records_of_many_levels_are_refused(tmp_path: Path, levels: int):
    """Fewer than those at which a parser gives up; what copies a record later needs several calls for each level."""
    record, table = tmp_path / "a.json", tmp_path / "a.toml"
    record.write_text('{"a": ' * levels + "1" + "}" * levels)
    table.write_text(f"a = {'[' * levels}{']' * levels}")
    for path, read in ((record, read_json), (table, read_toml)):
        if levels <= LIMITS["nesting"].most:
            assert "a" in read(path, "a record")
        else:
            with pytest.raises(ArmidError, match=rf"{path.name} has 40[01] levels of nested"):
                read(path, "a record")


def test_other_files_are_refused(tmp_path: Path):
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    os.mkfifo(tmp_path / "pipe.json")
    for name in ("none.json", "bytes.json", "pipe.json", "."):
        with pytest.raises(ArmidError, match="cannot be read as a plan"):
            read_json(tmp_path / name, "a plan")


def test_a_limit_can_be_raised(monkeypatch: pytest.MonkeyPatch):
    def raised() -> None:
        with pytest.raises(ArmidError, match="the limit is 500") as caught:
            within("joints", 600, "arm.urdf")
        assert "ARMID_ALLOW=joints=606" in caught.value.remedy and "--allow joints=606" in caught.value.remedy
        allow({"joints": 606})
        within("joints", 600, "arm.urdf")

    copy_context().run(raised)
    assert limit("joints") == LIMITS["joints"].most
    monkeypatch.setenv("ARMID_ALLOW", "joints=1e4,links=7")
    assert (limit("joints"), limit("links")) == (1e4, 7.0)


@pytest.mark.parametrize("text", ["joints", "joints=x", "joints=1=2"])
def test_a_limit_in_another_form_is_refused(text: str):
    with pytest.raises(ArmidError, match="is not a limit"):
        parsed_limits(text)


@pytest.mark.parametrize("limits", [{"joint": 3.0}, {"joints": 0.0}, {"joints": float("nan")}])
def test_a_limit_that_does_not_exist_or_is_not_positive_is_refused(limits: dict[str, float]):
    with pytest.raises(ArmidError):
        copy_context().run(allow, limits)


def test_nan_exceeds_every_limit():
    with pytest.raises(ArmidError, match="has nan samples"):
        within("samples", float("nan"), "log")


def test_archives_that_unpack_to_much_are_refused(tmp_path: Path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(b"t,q1,tau1\n" + b"1,2,3\n" * 12_000_000, 9))
    with pytest.raises(RecordingError, match="times the size of the file after unpacking"):
        load_recording(path)


def test_an_array_that_claims_to_be_large_is_refused(tmp_path: Path):
    path = tmp_path / "log.npz"
    np.savez(path, t=np.arange(5.0), q1=np.arange(5.0))
    path.write_bytes(path.read_bytes().replace(b"(5,), }      ", b"(80000000000,), }"[:13].ljust(13)))
    data = tmp_path / "big.npz"
    np.savez_compressed(data, t=np.zeros(20_000_000))
    for each in (path, data):
        with pytest.raises(RecordingError):
            load_recording(each)


def test_a_value_with_parts_of_other_types_is_refused(tmp_path: Path):
    plan = Excitation(1.0, np.ones((1, 2)), np.ones((1, 2)), np.zeros(1), "arm")
    path = save(plan, tmp_path / "plan.npz")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    clean = json.loads(bytes(arrays["value.json"]))
    for key in clean["value"]:
        for wrong in (None, [], {}, "x", True, {"array": "none"}, [[1.0]]):
            if type(wrong) is type(clean["value"][key]) and not isinstance(wrong, dict):
                continue
            record = {**clean, "value": {**clean["value"], key: wrong}}
            arrays["value.json"] = np.frombuffer(json.dumps(record).encode(), np.uint8)
            np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
            with pytest.raises(ArmidError):
                load(Excitation, path)


def test_a_deep_description_is_refused(tmp_path: Path):
    for name in ("arm.urdf", "arm.mjcf", "arm.xacro"):
        path = tmp_path / name
        path.write_text(
            '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">' + "<a>" * 9000 + "</a>" * 9000 + "</robot>"
        )
        with pytest.raises(RobotError, match="levels of nested elements"):
            load_robot(path)


def test_a_long_motion_is_refused():
    plan = Excitation(1e-9, np.ones((1, 2)), np.ones((1, 2)), np.zeros(1), "arm")
    with pytest.raises(ArmidError, match="samples of a planned motion"):
        plan.sample(100.0)

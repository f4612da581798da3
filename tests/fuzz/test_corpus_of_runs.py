"""Damaged files of a run that once ended in a traceback; each is read or refused by one error."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.cli.main import main
from armid.hashes import sha256_of_file
from labs import small_recording, write_arm, write_recording

Change = Callable[[Any], object]


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with an arm, two recordings and a run on the first."""
    folder = tmp_path_factory.mktemp("run")
    write_arm(folder)
    for k, name in ((1, "log.npz"), (2, "other.npz")):
        write_recording(small_recording(k, repetitions=1), folder / name)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit):
        patch.chdir(folder)
        main(["identify", "small.urdf", "log.npz", "--no-report", "--out", "run"])
    return folder


def set_to(value: object, *place: str | int) -> Change:
    """Change of one value of a record."""

    def change(record: Any) -> object:
        for name in place[:-1]:
            record = record[name]
        return record.__setitem__(place[-1], value)

    return change


def deep(levels: int) -> object:
    """Tables in tables."""
    value: object = {}
    for _ in range(levels):
        value = {"a": value}
    return value


def change_archive(path: Path, change: Change) -> None:
    """Changes the header of a saved value."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(bytes(arrays["value.json"]))
    change(header["value"])
    arrays["value.json"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
    model = json.loads(path.with_name("model.json").read_text())
    model["sha256"][path.name] = sha256_of_file(path)
    path.with_name("model.json").write_text(json.dumps(model))


def change_record(path: Path, change: Change) -> None:
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


FAULTS: dict[str, tuple[str, Change]] = {
    "no options": ("study.json", set_to(None, "estimation", "options")),
    "a number for options": ("study.json", set_to(3.0, "estimation", "options")),
    "a number for the options of a method": ("study.json", set_to(3.0, "estimation", "options", "wls")),
    "a number for the shapes of terms": ("study.json", set_to(3.0, "model", "shapes")),
    "deep options": ("study.json", set_to(deep(900), "estimation", "options", "wls")),
    "exchanged limits": ("robot.npz", set_to([2.0, -2.0], "joints", 1, "position_limits")),
    "no number for a speed": ("robot.npz", set_to(float("nan"), "joints", 0, "velocity_limit")),
    "an unknown standard parameter": ("estimate.npz", set_to("nan", "base", "standard_names", 0)),
    "an unknown parameter": ("estimate.npz", set_to("nan", "fit", "names", 0)),
    "speeds of one joint": ("estimate.npz", set_to({"array": "array_0"}, "speeds")),
    "no digests of recordings": ("estimate.npz", set_to([], "made_from")),
    "a unit for too few parameters": ("estimate.npz", set_to(["kg"], "base", "standard_units")),
    "an unknown column": ("estimate.npz", set_to([99] * 3, "base", "kept")),
}
"""File of the run and change of its record, by what is wrong with it. Digests fit the changed archives."""

COMMANDS = (
    ("report", "run"),
    ("monitor", "run", "other.npz"),
    ("recalibrate", "run", "other.npz", "--out", "again"),
    ("certify", "run"),
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_once_broke_is_read_or_refused(
    fault: str,
    command: tuple[str, ...],
    identified: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    shutil.copytree(identified, tmp_path / "in")
    monkeypatch.chdir(tmp_path / "in")
    name, change = FAULTS[fault]
    path = Path("run") / name
    (change_archive if path.suffix == ".npz" else change_record)(path, change)
    with pytest.raises(SystemExit) as ended:
        main(list(command))
    err = capsys.readouterr().err
    assert ended.value.code in (0, 1, 2, None), err
    if ended.value.code == 2:
        assert err.startswith("error run") and "hint:" in err, err

"""Damaged files of a run that once ended in a traceback; each is read or refused by one error."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from armid.cli.main import main
from labs import small_recording, write_arm, write_recording

Change = Callable[[dict[str, Any]], object]


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


def set_to(value: object, *place: str) -> Change:
    """Change of one value of a record."""

    def change(record: dict[str, Any]) -> object:
        for name in place[:-1]:
            record = record[name]
        return record.update({place[-1]: value})

    return change


FAULTS: dict[str, tuple[str, Change]] = {
    "no options": ("study.json", set_to(None, "estimation", "options")),
    "a number for options": ("study.json", set_to(3.0, "estimation", "options")),
    "a number for the options of a method": ("study.json", set_to(3.0, "estimation", "options", "wls")),
    "a number for the shapes of terms": ("study.json", set_to(3.0, "model", "shapes")),
}
"""File of the run and change of its record, by what is wrong with it."""

COMMANDS = (
    ("report", "run"),
    ("monitor", "run", "other.npz"),
    ("recalibrate", "run", "other.npz", "--out", "again"),
    ("payload", "run", "other.npz"),
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
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    with pytest.raises(SystemExit) as ended:
        main(list(command))
    err = capsys.readouterr().err
    assert ended.value.code in (0, 1, 2, None), err
    if ended.value.code == 2:
        assert err.startswith("error run") and "hint:" in err, err

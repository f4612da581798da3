"""Names of files that systems refuse or that tools rarely meet, in every place where a command takes a path."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from armid.cli.main import main
from labs import small_recording, write_arm, write_recording

LONG = "x" * 300
"""Name that no usual file system accepts."""

BYTES = os.fsdecode(b"caf\xe9")
"""Name that is not UTF-8."""

COMMANDS: tuple[tuple[str, ...], ...] = (
    ("base", "{}.urdf"),
    ("base", "{}.toml"),
    ("doctor", "{}.toml"),
    ("doctor", "small.urdf", "{}.csv"),
    ("doctor", "small.urdf", "{}"),
    ("identify", "{}.toml"),
    ("identify", "small.urdf", "{}.mat"),
    ("predict", "{}", "log.csv"),
    ("validate", "{}", "log.csv"),
    ("report", "{}"),
    ("preview", "small.urdf", "{}.json"),
    ("preview", "small.urdf", "log.csv", "--environment", "{}.toml"),
    ("preview", "small.urdf", "--out", "{}/page.html"),
    ("simulate", "small.urdf", "{}.json"),
    ("simulate", "small.urdf", "thesis-a1", "--options", "{}.toml"),
    ("payload", "{}", "--to", "ur"),
    ("certify", "{}"),
    ("export", "{}", "--to", "urdf"),
)
"""Commands with a place for a name."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_arm(tmp_path)
    write_recording(small_recording(1), tmp_path / "log.csv")
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_name_that_cannot_be_opened_is_refused(
    command: tuple[str, ...], folder: Path, capsys: pytest.CaptureFixture[str]
):
    for suffix in ("", ".urdf", ".toml", ".csv", ".mat", ".json"):
        os.symlink(f"loop{suffix}", folder / f"loop{suffix}")
    for name in (LONG, "loop", BYTES, "line\nbreak", "", "/dev/null/x", "/dev/null", "a\tb", "[bold]x[/bold]"):
        with pytest.raises(SystemExit) as ended:
            main([part.replace("{}", name) for part in command])
        err = capsys.readouterr().err
        if "--out" not in command:  # a folder for output may be made
            assert ended.value.code == 2 and err.strip(), (name, ended.value.code, err)
        assert ended.value.code in (0, 2), (name, err)


def test_files_with_odd_names_are_read(folder: Path):
    for name in ("line\nbreak", "[bold]x", "a b;c", "ü", BYTES):
        shutil.copy(folder / "small.urdf", folder / f"{name}.urdf")
        shutil.copy(folder / "log.csv", folder / f"{name}.csv")
        with pytest.raises(SystemExit) as ended:
            main(["doctor", f"{name}.urdf", f"{name}.csv"])
        assert ended.value.code in (0, 1, None)

"""Folders for results that cannot be made are refused before any work."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from armid.errors import OutputError
from armid.study.plans.design_writing import refuse_plan_folder
from armid.study.storage.atomic_folder import whole_folder


def test_a_file_system_that_takes_no_folder_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Permission bits say nothing about it: a mounted folder may be read-only, and root may write anywhere."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    refuse_plan_folder(tmp_path / "plan")
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(tempfile, "mkdtemp", refused)
    with pytest.raises(OutputError, match="is not writable"):
        refuse_plan_folder(tmp_path / "plan")


@pytest.mark.parametrize("where", ["study.toml", "missing/../study.toml", "missing/further/../../study.toml"])
def test_a_file_is_never_replaced_by_a_folder(tmp_path: Path, where: str):
    """`missing/..` exists for no file system as long as `missing` does not; the file behind it does."""
    study = tmp_path / "study.toml"
    study.write_text("[study]", encoding="utf-8")
    with pytest.raises(OutputError, match="this is a file"), whole_folder(tmp_path / where, "plan.json", "plan"):
        pass
    assert study.read_text(encoding="utf-8") == "[study]" and list(tmp_path.iterdir()) == [study]

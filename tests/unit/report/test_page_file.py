"""Files that a page may replace."""

from __future__ import annotations

from pathlib import Path

import pytest

from armid.errors import OutputError
from armid.report.page_file import write_html

PAGE = "<!DOCTYPE html>\n<title>page</title>"


@pytest.mark.parametrize("before", [None, "", PAGE, PAGE.lower()])
def test_a_page_replaces_a_page(tmp_path: Path, before: str | None):
    path = tmp_path / "page.html"
    if before is not None:
        path.write_text(before, encoding="utf-8")
    assert write_html(path, PAGE) == path and path.read_text(encoding="utf-8") == PAGE


@pytest.mark.parametrize("before", ["my notes", "t,q1,tau1\n0,0,0\n"])
def test_another_file_is_kept(tmp_path: Path, before: str):
    path = tmp_path / "notes.txt"
    path.write_text(before, encoding="utf-8")
    with pytest.raises(OutputError, match="not an HTML page"):
        write_html(path, PAGE)
    assert path.read_text(encoding="utf-8") == before


def test_a_folder_is_told(tmp_path: Path):
    with pytest.raises(OutputError, match="a folder"):
        write_html(tmp_path, PAGE)

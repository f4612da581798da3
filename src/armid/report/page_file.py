"""Writer of pages; an existing file is replaced only if it is an HTML page."""

from __future__ import annotations

from pathlib import Path

from armid.atomic_file import replace_file
from armid.errors import OutputError

HEAD = 256
"""Number of bytes at the beginning of a file in which the declaration of an HTML page is expected."""


def write_html(path: Path | str, html: str) -> Path:
    """Writes a page completely or not at all; an existing file is replaced only if it is an HTML page, too.

    Args:
        path: The file.
        html: The page.

    Raises:
        OutputError: The file is a folder or not an HTML page, or cannot be written.
    """
    path = Path(path)
    if path.exists() and not _is_page(path):
        what = "a folder" if path.is_dir() else "a file that is not an HTML page"
        raise OutputError(
            f"The page cannot be written to {path}, because this is {what}.",
            remedy="choose another file with --out, for instance page.html.",
        )
    return replace_file(path, html)


def _is_page(path: Path) -> bool:
    """True if a file begins like an HTML page, or is empty."""
    if not path.is_file():
        return False
    with open(path, "rb") as stream:
        head = stream.read(HEAD)
    return not head or b"<!doctype html" in head.lower()

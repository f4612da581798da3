"""Names of what a command has already written, for the message when it is interrupted."""

from __future__ import annotations

from pathlib import Path

_names: list[str] = []


def forget_written() -> None:
    """Begins a new command."""
    _names.clear()


def add_written(path: Path | str) -> None:
    """Adds a folder or file that is complete and in its place."""
    if not any(part.startswith(".armid-") for part in Path(path).parts) and str(path) not in _names:
        _names.append(str(path))


def written() -> tuple[str, ...]:
    """Folders and files that were written since `forget_written`."""
    return tuple(_names)

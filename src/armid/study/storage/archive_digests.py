"""Check of the digest (sha256) of an archive in a folder of results."""

from __future__ import annotations

from pathlib import Path

from armid.errors import ArmidError
from armid.hashes import sha256_of_file


def refuse_changed_archive(path: Path, digest: str, record: str, again: str) -> None:
    """Raises an error if an archive differs from the one that was written.

    Args:
        path: The archive; a missing one is left to its reader.
        digest: Digest of what was written.
        record: Name of the file in which the digest is.
        again: How the folder is made again.

    Raises:
        ArmidError: The archive differs.
    """
    if path.is_file() and sha256_of_file(path) != digest:
        raise ArmidError(
            f"{path} was changed or damaged after armid wrote it: its SHA-256 is not that in {record}.",
            remedy=f"restore the folder from a copy, or {again}",
        )

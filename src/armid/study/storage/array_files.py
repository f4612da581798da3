"""Files that contain arrays; the suffix of the name, `.csv` or `.npz`, determines the format."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armid.atomic_file import replace_file
from armid.checked_array import Array
from armid.errors import ArmidError


def is_archive(path: Path | str, what: str) -> bool:
    """True if the name of a file has the suffix `.npz`, false if it has the suffix `.csv`.

    Args:
        path: The file.
        what: Content of the file, as the subject of the error message, for instance "The torque".

    Raises:
        ArmidError: The name has another suffix.
    """
    suffix = Path(path).suffix
    if suffix == ".npz":
        return True
    if suffix == ".csv":
        return False
    raise ArmidError(
        f"{what} cannot be written to {path}, because its suffix is neither .csv nor .npz.",
        remedy="give a file with one of these suffixes.",
    )


def write_archive(path: Path | str, arrays: Mapping[str, Array]) -> Path:
    """Writes named arrays to an NPZ file, completely or not at all."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    return replace_file(Path(path), buffer.getvalue())


def write_table(path: Path | str, columns: Mapping[str, Array], digits: int = 17) -> Path:
    """Writes named columns, each of shape (N,), to a CSV file with a header, completely or not at all.

    Args:
        path: The file.
        columns: The columns, by name.
        digits: Number of significant digits; with 17, reading the file gives exactly the same numbers.
    """
    text, rows = io.StringIO(), np.column_stack(list(columns.values()))
    np.savetxt(text, rows, delimiter=",", header=",".join(columns), comments="", fmt=f"%.{digits}g")
    return replace_file(Path(path), text.getvalue())


def by_joint(name: str, values: Array) -> dict[str, Array]:
    """Splits values (N, n) into a column (N,) for each joint, called `name` and the number of the joint, from 1."""
    return {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}

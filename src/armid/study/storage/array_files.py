"""Files of arrays, CSV or NPZ; the suffix decides."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armid.atomic_file import replace_file
from armid.checked_array import Array
from armid.errors import ArmidError


def is_archive(path: Path | str, what: str) -> bool:
    """True for a name with the suffix `.npz`, false for `.csv`.

    Args:
        path: The file.
        what: Content, as the subject of the error message.

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
    """Writes arrays by their names as NPZ, completely or not at all."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    return replace_file(Path(path), buffer.getvalue())


def write_table(path: Path | str, columns: Mapping[str, Array], digits: int = 17) -> Path:
    """Writes columns (N,) by their names as CSV with a header, completely or not at all.

    Args:
        path: The file.
        columns: The columns.
        digits: Significant digits; 17 give back the same number.
    """
    text, rows = io.StringIO(), np.column_stack(list(columns.values()))
    np.savetxt(text, rows, delimiter=",", header=",".join(columns), comments="", fmt=f"%.{digits}g")
    return replace_file(Path(path), text.getvalue())


def by_joint(name: str, values: Array) -> dict[str, Array]:
    """Columns of values (N, n) of each joint, whose names end in the number of the joint, from 1."""
    return {f"{name}{j + 1}": values[:, j] for j in range(values.shape[1])}

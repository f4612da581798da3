"""Meshes small enough for a page: corners that lie close together made one, places in steps of two bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.report.plots.encoding import packed
from armid.values import Array

__all__ = ["MOST_TRIANGLES", "mesh_record", "simplified"]

MOST_TRIANGLES = 80_000
"""Triangles of all meshes of a page together: about a megabyte, and no work for a phone."""

CELLS = (512, 384, 256, 192, 128, 96, 64, 48, 32, 24, 16, 8, 4)
"""Cells along the longest edge of a mesh that are tried one after the other."""

STEPS = 65535
"""Steps in which places of a mesh are written along each edge of its box."""


def simplified(corners: Array, triangles: NDArray[np.intp], most: int) -> tuple[Array, NDArray[np.intp]]:
    """A mesh of at most so many triangles, by clustering of corners.

    Corners in one cell of a grid become their mean; triangles that lose an edge go, and so do doubles.

    Args:
        corners: Shape (v, 3) [m].
        triangles: Indices of three corners each, shape (t, 3).
        most: Triangles that are allowed.
    """
    corners, triangles = _merged(corners, triangles, np.unique(corners, axis=0, return_inverse=True)[1])
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max())
    for cells in CELLS:
        if len(triangles) <= most:
            break
        place = np.floor((corners - low) / (size / cells)).astype(np.intp)
        label = np.unique(place, axis=0, return_inverse=True)[1]
        corners, triangles = _merged(corners, triangles, label)
    return corners, triangles


def _merged(corners: Array, triangles: NDArray[np.intp], label: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """A mesh whose corners of one label are one."""
    label = label.reshape(-1)
    count = np.bincount(label)
    mean = np.column_stack([np.bincount(label, x) / count for x in corners.T])
    moved = label[triangles]
    a, b, c = moved.T
    moved = moved[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(moved, axis=1), axis=0, return_index=True)
    return mean, moved[np.sort(first)]


def mesh_record(corners: Array, triangles: NDArray[np.intp]) -> dict[str, Any]:
    """A mesh for the page's script: places in two bytes each, steps of 15 micrometres on a metre."""
    low = corners.min(axis=0)
    step = np.maximum(np.ptp(corners, axis=0), 1e-9) / STEPS
    kind = "u2" if len(corners) <= STEPS else "u4"
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "places": packed(np.round((corners - low) / step), "u2"),
        "index": packed(triangles, kind),
    }

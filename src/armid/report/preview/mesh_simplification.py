"""Simplification of meshes for a page, by clustering of vertices and by coordinates of two bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.report.plots.encoding import packed

MAX_TRIANGLES = 80_000
"""Largest number of triangles of all meshes of a page: about one megabyte, which a phone can draw."""

CELLS = (512, 384, 256, 192, 128, 96, 64, 48, 32, 24, 16, 8, 4)
"""Numbers of cells along the longest edge of a mesh, tried in this order until the mesh is small enough."""

STEPS = 65535
"""Number of quantisation steps of a coordinate along each edge of the bounding box of a mesh."""


def simplified(corners: Array, triangles: NDArray[np.intp], most: int) -> tuple[Array, NDArray[np.intp]]:
    """Mesh with at most `most` triangles, by clustering of vertices.

    Vertices in one cell of a grid are replaced by their mean; degenerate and duplicate triangles are removed.

    Args:
        corners: Positions of the v corners, shape (v, 3) [m].
        triangles: Indices of the three corners of each of the t triangles, shape (t, 3).
        most: Largest number of triangles.
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
    """Mesh in which vertices with the same label are merged."""
    label = label.reshape(-1)
    count = np.bincount(label)
    mean = np.column_stack([np.bincount(label, x) / count for x in corners.T])
    moved = label[triangles]
    a, b, c = moved.T
    moved = moved[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(moved, axis=1), axis=0, return_index=True)
    return mean, moved[np.sort(first)]


def mesh_record(corners: Array, triangles: NDArray[np.intp]) -> dict[str, Any]:
    """JSON object of a mesh for the script of the page, with two bytes per coordinate (15 µm for a mesh of 1 m)."""
    low = corners.min(axis=0)
    step = np.maximum(np.ptp(corners, axis=0), 1e-9) / STEPS
    kind = "u2" if len(corners) <= STEPS else "u4"
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "places": packed(np.round((corners - low) / step), "u2"),
        "index": packed(triangles, kind),
    }

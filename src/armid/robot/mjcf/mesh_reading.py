"""Mesh files as MuJoCo reads them: STL (binary), OBJ and MSH. Only vertices and triangles are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import RobotError

Faces = NDArray[np.intp]
"""Indices of the vertices of each triangle, shape (F, 3), counterclockwise from outside."""

FORMATS = (".stl", ".obj", ".msh")
"""Suffixes of the formats that are read."""


class UncomputableError(RobotError):
    """Inertia that cannot be computed from the geometry in a description; the text states the reason."""


def read_mesh(path: Path, suffix: str) -> tuple[Array, Faces]:
    """Vertices (V, 3) and triangles (F, 3) of a mesh file.

    Args:
        path: Path of the file.
        suffix: Suffix of the format in which the file is read.

    Raises:
        UncomputableError: The file does not exist, has another format, or is damaged.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        why = "does not exist" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror})"
        raise UncomputableError(f"the mesh file {path} {why}") from error
    try:
        reader = {".stl": _stl, ".obj": _obj, ".msh": _msh}[suffix.lower()]
    except KeyError:
        raise UncomputableError(f"the format of the mesh file {path} is none of {', '.join(FORMATS)}") from None
    try:
        vertices, faces = reader(data)
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        raise UncomputableError(f"the mesh file {path} is damaged, or not of the format {suffix}: {error}") from error
    if len(faces) and not (0 <= faces.min() and faces.max() < len(vertices)):
        raise UncomputableError(f"the mesh file {path} is damaged: a triangle names a vertex that does not exist")
    if not np.isfinite(vertices).all():
        raise UncomputableError(f"the mesh file {path} is damaged: a coordinate is not finite")
    return vertices, faces


def _stl(data: bytes) -> tuple[Array, Faces]:
    """Reads a binary STL: 80 bytes of header, the number of triangles, and 50 bytes for each triangle."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) != 84 + 50 * count or not count:
        raise ValueError("the length of the file is not that of a binary STL; MuJoCo reads no other kind of STL")
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data, triangle, count, 84)["corners"].reshape(-1, 3)
    return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)


def _obj(data: bytes) -> tuple[Array, Faces]:
    """Reads an OBJ file: all vertices, and the faces of the first group, cut into triangles from the first corner."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    grouped = False
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] in ("o", "g"):
            grouped = grouped or bool(faces)
        elif words[0] == "f" and not grouped:
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            corners = [k - 1 if k > 0 else len(vertices) + k for k in numbers]
            faces += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(faces, dtype=np.intp).reshape(-1, 3)


def _msh(data: bytes) -> tuple[Array, Faces]:
    """Reads the format of MuJoCo: four numbers, then vertices, normals and texture coordinates, then faces."""
    vertices, normals, textures, faces = (int(x) for x in np.frombuffer(data, "<i4", 4))
    behind = 16 + 12 * (vertices + normals) + 8 * textures
    if min(vertices, normals, textures, faces) < 0 or len(data) != behind + 12 * faces:
        raise ValueError("the length of the file does not agree with the header")
    points = np.frombuffer(data, "<f4", 3 * vertices, 16).reshape(-1, 3).astype(np.float64)
    return points, np.frombuffer(data, "<i4", 3 * faces, behind).reshape(-1, 3).astype(np.intp)

"""Meshes that tests generate, and their files: an L-shaped prism, which is not convex, and its parts."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

PROFILE = np.array([(0, 0), (0.3, 0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.25), (0, 0.25)])
HEIGHT = 0.07


def prism() -> tuple[np.ndarray, np.ndarray]:
    """Vertices (12, 3) [m] and outward triangles (20, 3) of an L-shaped prism."""
    n = len(PROFILE)
    vertices = np.vstack([np.c_[PROFILE, np.zeros(n)], np.c_[PROFILE, np.full(n, HEIGHT)]])
    cap = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(a, c, b) for a, b, c in cap] + [(a + n, b + n, c + n) for a, b, c in cap]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, j + n), (i, j + n, i + n)]
    return vertices, np.array(faces)


def write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Writes a mesh in the format of the suffix: STL, OBJ or MSH."""
    if path.suffix == ".obj":
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        path.write_text("\n".join([*lines, *(f"f {a} {b}//1 {c}" for a, b, c in (faces + 1).tolist())]))
    elif path.suffix == ".msh":
        head = struct.pack("<4i", len(vertices), 0, 0, len(faces))
        path.write_bytes(head + vertices.astype("<f4").tobytes() + faces.astype("<i4").tobytes())
    else:
        corners = vertices[faces].astype("<f4").reshape(len(faces), -1)
        rows = (bytes(12) + each.tobytes() + bytes(2) for each in corners)
        path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(rows))
    return path

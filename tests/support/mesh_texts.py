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
    """Writes a mesh in the format of the suffix: STL, OBJ, DAE or MSH."""
    if path.suffix == ".dae":
        path.write_text(collada(vertices, faces))
    elif path.suffix == ".obj":
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


def collada(vertices: np.ndarray, faces: np.ndarray, asset: str = "") -> str:
    """Text of a Collada file with a mesh in its own unit, and with the contents of its element `asset`."""
    numbers = " ".join(f"{x!r}" for x in vertices.ravel().tolist())
    corners = " ".join(map(str, faces.ravel().tolist()))
    return (
        '<?xml version="1.0"?><COLLADA version="1.4.1">'
        f'<asset>{asset}</asset><library_geometries><geometry id="g"><mesh>'
        f'<source id="s"><float_array id="a" count="{vertices.size}">{numbers}</float_array><technique_common>'
        f'<accessor source="#a" count="{len(vertices)}" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>'
        f'<triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p>'
        '</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="w"><node id="n">'
        '<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#w"/></scene></COLLADA>'
    )

"""Meshes of an MJCF: their files, placement and scale, and the inertia that MuJoCo computes from their triangles."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.maths.inertia import com_inertia_to_vector
from armid.maths.rotations import homogeneous
from armid.robot.mjcf.mesh_reading import Faces, UncomputableError, read_mesh
from armid.robot.mjcf.poses import rotation_of_quaternion
from armid.robot.mjcf.settings import Settings
from armid.robot.packages import may_read
from armid.robot.xml import numbers

MODES = ("convex", "exact", "legacy", "shell")
"""Values of the attribute `inertia` of a mesh."""

USUAL_MODE = "legacy"
"""Mode of a mesh without the attribute `inertia`."""

SMALLEST = 1e-15
"""Volume or area below which MuJoCo refuses a mesh [m³ or m²]."""


SQUARE = 1e-9
"""Largest element outside the diagonal of a matrix of scale factors that counts as a rounding error."""


@dataclass(frozen=True, slots=True)
class MeshAssets:
    """Meshes of one document.

    Attributes:
        elements: Each mesh with the attributes of its default class, by name.
        folder: Folder in which files of meshes are searched.
        strip: True if the folders in the names of files are ignored.
        source: Path of the document, for messages.
        computed: Inertial parameters that were computed, by the name of the mesh.
    """

    elements: Mapping[str, ET.Element]
    folder: Path
    strip: bool
    source: str
    computed: dict[str, Array] = field(default_factory=dict[str, Array])

    def unit_inertia(self, name: str) -> Array:
        """Ten inertial parameters of a mesh in its own frame, at density 1 [kg/m³, or kg/m² for a shell], (10,).

        Args:
            name: Name of the mesh.

        Raises:
            UncomputableError: The mesh does not exist, its file cannot be read, or MuJoCo would refuse it.
        """
        if name not in self.computed:
            if name not in self.elements:
                raise UncomputableError(f"there is no mesh {name!r}")
            self.computed[name] = self._unit_inertia(self.elements[name])
        return self.computed[name]

    def inertia_files(self) -> list[Path]:
        """Files of the meshes whose inertia was computed, in the order of the names of the meshes."""
        paths = (self.path(self.elements[name]) for name in sorted(self.computed))
        return [path for path in paths if path is not None]

    def existing(self) -> dict[str, tuple[str, Array, Array]]:
        """Path, scale (3,) and pose (4, 4) in the geom of each mesh whose file exists, by name.

        A mesh is left out if its attribute `refquat` is not a rotation by right angles and its scale factors differ,
        because such a mesh cannot be represented by scale factors along the axes of the file.
        """
        found: dict[str, tuple[str, Array, Array]] = {}
        for name, mesh in self.elements.items():
            path = self.path(mesh)
            if path is None or not may_read(path, self.source) or not path.is_file():
                continue
            position, turned = self._reference(mesh)
            for turn, scale in _as_turn_of_scaled(self._scale(mesh), turned):
                found[name] = (str(path), scale, homogeneous(turn, -turn @ (scale * position)))
                break
        return found

    def unusable(self) -> dict[str, str]:
        """Reasons, by the name of the mesh, why a mesh is not read as a shape although no file is missing."""
        usable, found = self.existing(), dict[str, str]()
        for name, mesh in self.elements.items():
            path = self.path(mesh)
            if path is None:
                given = [key for key in ("vertex", "builtin") if key in mesh.attrib]
                found[name] = f"which is given by {given[0]} and not by a file" if given else "which has no file"
            elif not may_read(path, self.source):
                found[name] = "whose file is outside of the folders of the description (armid --allow outside=1)"
            elif name not in usable and path.is_file():
                found[name] = "which is scaled along other axes than those of its file"
        return found

    def path(self, mesh: ET.Element) -> Path | None:
        """Path of the file of a mesh; `None` if the mesh has no file."""
        file = mesh.get("file")
        return None if file is None else self.folder / (Path(file).name if self.strip else file)

    def _scale(self, mesh: ET.Element) -> Array:
        return np.array(numbers(mesh, "scale", 3, self.source, _named(mesh)) or [1.0, 1.0, 1.0])

    def _reference(self, mesh: ET.Element) -> tuple[Array, Array]:
        """Position (3,) [m] and rotation (3, 3) of the frame of a mesh's vertices, in the coordinates of its file."""
        where = _named(mesh)
        position = numbers(mesh, "refpos", 3, self.source, where) or [0.0, 0.0, 0.0]
        turned = numbers(mesh, "refquat", 4, self.source, where) or [1.0, 0.0, 0.0, 0.0]
        return np.array(position), rotation_of_quaternion(np.array(turned))

    def _unit_inertia(self, mesh: ET.Element) -> Array:
        where, mode = _named(mesh), mesh.get("inertia", USUAL_MODE)
        if mode not in MODES:
            raise UncomputableError(f"{where} has inertia={mode!r}, which is none of {', '.join(MODES)}")
        if mode == "convex" and mesh.get("maxhullvert", "-1") != "-1":
            raise UncomputableError(f"the hull of {where} is simplified (maxhullvert)")
        vertices, faces = self._triangles(mesh)
        if mode == "convex" or not len(faces):
            faces = _hull(vertices)
        if mode == "exact":
            _check_closed(faces, vertices, mesh)
        return inertia_of_triangles(vertices[faces], mode)

    def _triangles(self, mesh: ET.Element) -> tuple[Array, Faces]:
        """Vertices (V, 3) [m] of a mesh in the frame of its geom, and triangles (F, 3)."""
        path = self.path(mesh)
        if path is not None:
            if not may_read(path, self.source):
                raise UncomputableError(f"the file of {_named(mesh)} is outside of the folders of the description")
            kind = mesh.get("content_type", "")
            vertices, faces = read_mesh(path, f".{kind.rpartition('/')[2]}" if kind else path.suffix)
        elif "vertex" in mesh.attrib:
            vertices = np.array([float(word) for word in mesh.get("vertex", "").split()]).reshape(-1, 3)
            faces = np.array([int(word) for word in mesh.get("face", "").split()], dtype=np.intp).reshape(-1, 3)
        else:
            raise UncomputableError(f"{_named(mesh)} has neither a file nor vertices")
        position, turned = self._reference(mesh)
        vertices = (vertices - position) @ turned * (scale := self._scale(mesh))
        return vertices, faces if scale.prod() > 0.0 else faces[:, ::-1]  # a reflection turns triangles inside out


def _as_turn_of_scaled(scale: Array, turned: Array) -> Iterator[tuple[Array, Array]]:
    """Yields rotations T (3, 3) and scale factors f (3,) with T · diag(f) = diag(scale) · turnedᵀ.

    So the mesh is first scaled along the axes of its file and then rotated, instead of the reverse.

    Args:
        scale: Factors along the axes of the geom.
        turned: Rotation (3, 3) from the geom to the file.
    """
    signs = np.sign(scale)
    for mirror in (np.ones(3), signs * signs.prod()):  # the second is a half turn, or none
        turn = mirror[:, None] * turned.T
        first = turn.T @ np.diag(scale * mirror) @ turn
        factors = np.diag(first).copy()
        if np.abs(first - np.diag(factors)).max() <= SQUARE:
            yield turn, factors


def _named(mesh: ET.Element) -> str:
    return f"the mesh {mesh.get('name')!r}"


def inertia_of_triangles(corners: Array, mode: str) -> Array:
    """Ten inertial parameters, at density 1, of the body that triangles bound, shape (10,).

    The body is the sum of pyramids from a common point to the triangles; a shell consists of the triangles
    themselves. In the mode `legacy`, MuJoCo counts all volumes of pyramids as positive, so the sum depends on the
    common point. For the centre of mass this point is the centroid of the surface; for mass and inertia it is the
    centre of mass.

    Args:
        corners: Corners of each triangle, counterclockwise from outside, shape (F, 3, 3) [m].
        mode: Value of the attribute `inertia` of a mesh.

    Raises:
        UncomputableError: The volume or area is not positive.
    """
    shell = mode == "shell"
    normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas, centres = np.linalg.norm(normals, axis=1), corners.mean(axis=1)
    area = float(areas.sum())
    if area < SMALLEST:
        raise UncomputableError("the surface of a mesh is too small")
    middle = areas @ centres / area

    def weights(origin: Array) -> Array:
        signed = areas if shell else ((centres - origin) * normals).sum(axis=1) / 3.0
        return np.abs(signed) if mode == "legacy" else signed

    volumes = weights(middle)
    if volumes.sum() < SMALLEST:
        raise UncomputableError("the volume of a mesh is too small, or its triangles are turned inside out")
    com = middle if shell else middle + 0.75 * (volumes @ (centres - middle)) / volumes.sum()
    volumes = weights(com)
    about = corners - com
    total = about.sum(axis=1)
    # Second moments of a triangle, or of the pyramid from the centre of mass to it.
    second = np.einsum("f,fci,fcj->ij", volumes, about, about) + np.einsum("f,fi,fj->ij", volumes, total, total)
    second /= 12.0 if shell else 20.0
    return com_inertia_to_vector(float(volumes.sum()), com, np.trace(second) * np.eye(3) - second)


def _hull(vertices: Array) -> Faces:
    """Triangles of the convex hull of vertices (V, 3), counterclockwise from outside."""
    from scipy.spatial import ConvexHull, QhullError  # the import takes 0.2 s

    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError) as error:
        raise UncomputableError("the convex hull of the vertices of a mesh has no volume") from error
    faces = hull.simplices.astype(np.intp)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normals * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inward] = faces[inward, ::-1]
    return faces


def _check_closed(faces: Faces, vertices: Array, mesh: ET.Element) -> None:
    """Raises an error if triangles are not consistently oriented; MuJoCo refuses such a mesh in the mode `exact`."""
    _, label = np.unique(vertices, axis=0, return_inverse=True)
    edges = np.concatenate([label.reshape(-1)[faces[:, [i, (i + 1) % 3]]] for i in range(3)])
    if len(np.unique(edges, axis=0)) != len(edges):
        raise UncomputableError(f"the triangles of {_named(mesh)} are not consistently oriented")


def mesh_assets(root: ET.Element, settings: Settings, folder: Path) -> MeshAssets:
    """Meshes of a document.

    Args:
        root: The document.
        settings: Settings of the document.
        folder: Folder of the document.
    """
    found: dict[str, ET.Element] = {}
    for mesh in (m for asset in root.findall("asset") for m in asset.findall("mesh")):
        full = settings.resolved(mesh, "main")
        full.set("name", full.get("name") or Path(full.get("file", "")).stem)
        found[full.get("name", "")] = full
    place = folder / settings.compiler.get("meshdir", settings.compiler.get("assetdir", ""))
    return MeshAssets(found, place, settings.compiler.get("strippath") == "true", settings.source)

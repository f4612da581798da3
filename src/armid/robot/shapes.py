"""Geometry of the links: simple bodies and meshes that are fixed to links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import Finding, RobotError
from armid.maths.rotations import axis_rotation, homogeneous

NAMED = 5
"""Largest number of bodies that a finding names."""

Kind = Literal["capsule", "sphere", "cylinder", "box", "ellipsoid", "mesh", "half-space"]


@dataclass(frozen=True, eq=False, slots=True)
class Shape:
    """Body fixed to a link or to the base.

    Attributes:
        name: Name for messages, for instance the name of the link.
        link: Index of the link that carries the body; -1 for the base and the surroundings.
        kind: Kind of shape; `capsule` and `cylinder` lie along z, a `half-space` is solid below z = 0.
        size: Dimensions [m], shape (3,); unused entries are zero. Capsule: radius, and distance of the centres of its
            two end spheres. Cylinder: radius, length. Sphere: radius. Box: lengths of its edges. Ellipsoid: its
            semi-axes along x, y and z. Mesh: scale factors along x, y and z; a negative factor mirrors the mesh.
        placement: Pose in the frame of the link, shape (4, 4).
        path: File of a mesh; empty for other kinds.
    """

    name: str
    link: int
    kind: Kind
    size: Array
    placement: Array
    path: str = ""

    def __post_init__(self) -> None:
        size = np.zeros(3)
        given = np.atleast_1d(np.asarray(self.size, dtype=np.float64))
        size[: len(given)] = given
        object.__setattr__(self, "size", array(size, (3,), f"size of {self.name!r}"))
        object.__setattr__(self, "placement", array(self.placement, (4, 4), f"placement of {self.name!r}"))
        needed = {"capsule": 1, "sphere": 1, "cylinder": 2, "box": 3, "ellipsoid": 3, "mesh": 3, "half-space": 0}
        if self.kind not in needed:
            raise RobotError(
                f"The shape {self.name!r} is of the unknown kind {self.kind!r}.",
                possible=", ".join(needed),
                remedy="give one of these kinds.",
            )
        own = size[: needed[self.kind]]
        # A negative scale mirrors a mesh: the parts of a left arm are often those of the right one.
        if not (own != 0.0 if self.kind == "mesh" else own > 0.0).all() or (
            self.kind != "mesh" and (size < 0.0).any()
        ):
            wanted = "a scale other than zero" if self.kind == "mesh" else "positive sizes"
            raise RobotError(
                f"The {self.kind} {self.name!r} needs {wanted}; found {given.tolist()}.",
                remedy="correct the size in the description.",
            )

    def on(self, link: int, placement: Array) -> Shape:
        """Same shape in the frame of `link`, in which its present frame has the pose `placement` (4, 4)."""
        return replace(self, link=link, placement=placement @ self.placement)


def capsule_between(name: str, link: int, begin: ArrayLike, end: ArrayLike, radius: float) -> Shape:
    """Capsule between two points (3,) [m], given in the frame of a link."""
    a, b = array(begin, (3,), "from"), array(end, (3,), "to")
    length = float(np.linalg.norm(b - a))
    turned = rotation_with_z(b - a if length else np.array([0.0, 0.0, 1.0]))
    return Shape(name, link, "capsule", np.array([radius, length]), homogeneous(turned, 0.5 * (a + b)))


def meshes_missing(files: Mapping[str, str], option: str = "") -> tuple[Finding, ...]:
    """Finding about all collision meshes whose files are missing; there is none if all files exist.

    Args:
        files: Paths of the missing files, by the names of their bodies.
        option: Command-line option with which armid would find the files; empty if no such option is known.
    """
    if not files:
        return ()
    bodies, (first, file) = _listed(tuple(files)), next(iter(files.items()))
    what = f"the collision mesh {file} is" if len(files) == 1 else f"{len(files)} collision meshes ({file}, …) are"
    evidence = f"{what} missing; a collision check would ignore {bodies}{_nearby(option)}"
    remedy = f"if collisions are to be checked, {_naming(option)}; an identification does not need them."
    return (Finding("mesh-missing", "warning", first if len(files) == 1 else "", evidence, remedy),)


def looks_missing(files: Mapping[str, str], option: str = "") -> tuple[Finding, ...]:
    """Finding about all visual meshes whose files are missing; there is none if all files exist.

    Args:
        files: Paths of the missing files, by the names of their bodies.
        option: Command-line option with which armid would find the files; empty if no such option is known.
    """
    if not files:
        return ()
    example = next(iter(files.values()))
    evidence = f"{len(files)} visual meshes are missing, such as {example}: {_listed(tuple(files))}{_nearby(option)}"
    remedy = f"{_naming(option)}."
    return (Finding("visual-missing", "info", "", evidence, remedy),)


def shapes_unknown(kinds: Mapping[str, str], *, drawn: bool = False) -> tuple[Finding, ...]:
    """Finding about shapes whose kind armid does not read; there is none without such shapes.

    Args:
        kinds: Kinds of the shapes in words, by the names of their bodies.
        drawn: True if the shapes are only drawn.
    """
    if not kinds:
        return ()
    told = _listed([f"{kind} of {body}" for body, kind in kinds.items()])
    possible = "box, sphere, cylinder, capsule, or a mesh in a file"
    if drawn:
        remedy = f"write these shapes in another form ({possible}) if they are needed in pictures"
        return (Finding("visual-left-out", "info", ", ".join(kinds), f"not drawn: {told}", remedy),)
    evidence = f"armid does not read these shapes, and a collision check would ignore them: {told}"
    remedy = f"if collisions are to be checked, write them in another form ({possible})"
    return (Finding("shape-unknown", "warning", ", ".join(kinds), evidence, remedy),)


def _nearby(option: str) -> str:
    """Clause which states that an option would find a missing file near the description; empty without an option."""
    return f"; {option} would find it near the description" if option else ""


def _naming(option: str) -> str:
    """Remedy for missing meshes, with the option that finds them, if known."""
    if option:
        return f"give {option}"
    return "name the folder of the package with --package NAME=DIR, or put the meshes beside the description"


def _listed(bodies: Sequence[str]) -> str:
    """Text with the names of the first bodies, and the number of the bodies that are not named."""
    return ", ".join(bodies[:NAMED]) + (f" and {len(bodies) - NAMED} more" if len(bodies) > NAMED else "")


def rotation_with_z(direction: Array) -> Array:
    """Smallest rotation (3, 3) that turns z to a non-zero direction (3,); if this is -z, a rotation about x."""
    with np.errstate(invalid="ignore"):
        x, y, z = direction / np.linalg.norm(direction)
    if x == y == 0.0:
        return np.diag([1.0, np.sign(z), np.sign(z)])
    across = np.hypot(x, y)
    return axis_rotation(np.array([-y, x, 0.0]) / across, np.arctan2(across, z))

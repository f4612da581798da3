"""Body of a description: its stated inertia and its shapes, both in its own frame."""

from __future__ import annotations

from dataclasses import dataclass

from armid.checked_array import Array
from armid.robot.shapes import Shape


@dataclass(frozen=True, eq=False, slots=True)
class DescribedBody:
    """Body of a description with the inertia that its element states.

    Attributes:
        name: Name of the link or body in the description.
        mass: Mass [kg].
        com: Centre of mass in the frame of the body, shape (3,) [m].
        inertia: Inertia about the centre of mass in the axes of the frame of the body, shape (3, 3) [kg·m²].
        shapes: Visual and collision geometry in the frame of the body; the index of the link in them has no meaning.
        missing: Names of the meshes whose files are not found, as in the description.
    """

    name: str
    mass: float
    com: Array
    inertia: Array
    shapes: tuple[Shape, ...]
    missing: tuple[str, ...] = ()

"""Numbers in which the stated inertia of a body is compared with the filled hull of its shapes, and their bounds.

With the second moment S = ½ tr(I)·1 - I of a body of mass m, uᵀSu / m is the mean square distance of its mass from
the centre of mass along a unit vector u. If all mass lies between two planes perpendicular to u, at distances a and b
on both sides of the centre of mass, this mean is at most a·b [Bhatia2000].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.robot.described_bodies.body import DescribedBody
from armid.validation.inertial_checks.filled_shape import FilledShape

LIGHTEST = 10.0
"""Smallest plausible ratio of the mass of a body to the volume of its hull [kg/m³]. Expanded foams have 15 and more;
the smallest ratio that was no placeholder is 14 among 731 different bodies of published descriptions."""

LARGEST = 1.3
"""Largest plausible value of `Measures.reach`. It is larger than 1, because parts outside the drawn shapes may extend
beyond the margin; bodies of published descriptions have a median of 0.4."""

HEAVIEST = 2e4
"""Largest plausible ratio of the mass of a body to the volume of its hull [kg/m³]. Tungsten and gold have 19 300, and
a hull is never smaller than the shapes."""

SMALLEST = 0.05
"""Smallest plausible ratio of the trace of the inertia to that of the filled hull with the same mass. A motor in the
middle of a large cover gives 0.1; the smallest ratio in published descriptions that was no mistake is 0.09."""

BEYOND = 0.05
"""Distance by which mass may lie outside the hull, divided by the diagonal of the box around the hull. It allows for
parts that are not drawn."""

APART = 0.005
"""Length that is added to the distance by `BEYOND` [m]; it is significant for bodies of a few centimetres."""


@dataclass(frozen=True, eq=False, slots=True)
class Measures:
    """Comparison of a body with the filled hull of its shapes.

    Attributes:
        density: Mass divided by the volume of the hull [kg/m³].
        outside: Largest signed distance of the centre of mass from the planes of the hull's faces [m]; negative if
            the centre of mass is inside the hull.
        margin: Largest distance by which mass may lie outside the hull [m].
        ratio: Trace of the inertia divided by that of the filled hull with the same mass.
        reach: Second moment of the body along a principal axis of the hull, divided by the largest second moment that
            a body inside the hull and margin can have along this axis; maximum over the three axes. If it is above 1,
            no such body exists.
    """

    density: float
    outside: float
    margin: float
    ratio: float
    reach: float

    @property
    def is_sound(self) -> bool:
        """True if density, centre of mass and inertia are all within their bounds."""
        return self.is_dense_enough and self.is_inside and self.ratio >= SMALLEST and self.reach <= LARGEST

    @property
    def is_dense_enough(self) -> bool:
        """True if the density lies between `LIGHTEST` and `HEAVIEST`."""
        return LIGHTEST <= self.density <= HEAVIEST

    @property
    def is_inside(self) -> bool:
        """True if the centre of mass lies inside the hull, or outside by at most the margin."""
        return self.outside <= self.margin


def second_moment(body: DescribedBody) -> Array:
    """Mean of (p - com)(p - com)ᵀ over the mass of a body, shape (3, 3) [m²]."""
    return (0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia) / body.mass


def measures_of(body: DescribedBody, shape: FilledShape) -> Measures:
    """Compares a body with the filled hull of its shapes.

    If the centre of mass is outside the hull by more than the margin, the inertia is compared as if it were about the
    centroid of the hull.

    Args:
        body: The body.
        shape: Hull of its shapes.
    """
    margin = BEYOND * shape.extent + APART
    outside = float((shape.planes[:, :3] @ body.com + shape.planes[:, 3]).max())
    centre = body.com if outside <= margin else shape.centroid
    axes = np.linalg.eigh(shape.second_moment)[1]
    along = (shape.corners - centre) @ axes
    largest = (along.max(axis=0) + margin) * (margin - along.min(axis=0))
    own = np.einsum("ik,ij,jk->k", axes, second_moment(body), axes)
    ratio = float(np.trace(body.inertia) / (2.0 * body.mass * np.trace(shape.second_moment)))
    return Measures(body.mass / shape.volume, outside, margin, ratio, float((own / largest).max()))

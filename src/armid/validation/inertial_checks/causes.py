"""Search for one mistake that explains why a body does not agree with its shapes: a wrong unit or reference point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.robot.described_bodies.body import DescribedBody
from armid.validation.inertial_checks.filled_shape import FilledShape
from armid.validation.inertial_checks.measures import Measures, measures_of, second_moment

MUCH = 2.0
"""Smallest parallel-axis term with which an inertia about the wrong point is reported. Unit: second moment of the
filled hull along the line from the origin of the link to the centre of mass. Smaller terms cannot be distinguished
from an uneven density. If the term is larger, the moment about the centre of mass is almost always smaller than the
term: on 52 of 54 links of published arms."""

LEFT = (0.02, 3.0)
"""Smallest and largest second moment along the line after subtraction of the parallel-axis term, divided by that of
the filled hull, with which the mistake is reported; correct links have 0.04 to 2.6."""

ACROSS = (0.2, 4.0)
"""Smallest and largest second moment perpendicular to the line, divided by that of the filled hull, with which the
mistake is reported; correct links have 0.25 to 3.7."""

ASIDE = 0.2
"""Largest deviation of the line from a principal axis of the second moment with which the mistake is reported: the
part of S u perpendicular to u, divided by uᵀ S u, for the unit vector u of the line and the second moment S. A large
parallel-axis term makes the line nearly a principal axis."""


@dataclass(frozen=True, slots=True)
class InertialMistake:
    """Mistake in a description that explains why the inertia of a body does not agree with its shapes.

    Attributes:
        code: Code of the finding.
        words: Clause that describes the mistake.
        remedy: Change of the description that corrects the mistake.
    """

    code: str
    words: str
    remedy: str


@dataclass(frozen=True, slots=True)
class UnitMistake:
    """Mistake of units, as factors by which the numbers in a description are too large.

    Attributes:
        mass: Factor of the mass.
        com: Factor of the coordinates of the centre of mass.
        inertia: Factor of the inertia.
        shapes: Factor of the lengths of the shapes.
        cause: Code, description and remedy of the mistake.
    """

    mass: float
    com: float
    inertia: float
    shapes: float
    cause: InertialMistake


def _unit(mass: float, com: float, inertia: float, shapes: float, words: str, remedy: str) -> UnitMistake:
    code = "mesh-unit" if shapes != 1.0 else "inertial-unit"
    return UnitMistake(mass, com, inertia, shapes, InertialMistake(code, words, remedy))


UNIT_MISTAKES = (
    _unit(1, 1, 1e6, 1, "the inertia is in kg·mm²", "divide its inertia by 1e6"),
    _unit(1, 1, 1e3, 1, "the inertia is in g·m²", "divide its inertia by 1000"),
    _unit(1, 1, 1e9, 1, "the inertia is in g·mm²", "divide its inertia by 1e9"),
    _unit(1, 1e3, 1, 1, "the centre of mass is in millimetres", "divide its centre of mass by 1000"),
    _unit(1e3, 1, 1, 1, "the mass is in grams", "divide its mass by 1000"),
    _unit(1e3, 1, 1e3, 1, "mass and inertia are in grams (g, g·m²)", "divide its mass and inertia by 1000"),
    _unit(1, 1, 1, 1e3, "its shapes are drawn in millimetres", 'give its meshes the scale "0.001 0.001 0.001"'),
    _unit(1, 1, 1, 1e-3, "its shapes are scaled down to a thousandth", "remove the scale of its meshes"),
    _unit(1, 1, 1e-3, 1, "the inertia is 1000 times too small", "multiply its inertia by 1000"),
    _unit(1, 1, 1e-6, 1, "the inertia is a million times too small", "multiply its inertia by 1e6"),
    _unit(1e-3, 1, 1, 1, "the mass is 1000 times too small", "multiply its mass by 1000"),
    _unit(1e-3, 1, 1e-3, 1, "mass and inertia are 1000 times too small", "multiply its mass and inertia by 1000"),
    _unit(1, 1e3, 1e6, 1, "centre of mass and inertia are in millimetres", "divide them by 1000 and by 1e6"),
    _unit(1e3, 1, 1e9, 1, "mass and inertia are in g and g·mm²", "divide them by 1000 and by 1e9"),
    _unit(1e3, 1e3, 1e9, 1, "mass, centre of mass and inertia are in g, mm, g·mm²", "divide by 1000, 1000 and 1e9"),
)
"""Mistakes of units in descriptions, in the order in which they are tried."""

USUAL = (40.0, 8000.0)
"""Smallest and largest ratio of the mass to the volume of the hull with which a body agrees with its shapes after a
unit is corrected [kg/m³]; 95 % of 731 bodies of published descriptions are in this range."""

ORDER = (0.15, 6.0)
"""Smallest and largest ratio of the trace of the inertia to that of the filled hull with which a body agrees with its
shapes after a unit is corrected."""


def unit_mistake(body: DescribedBody, shape: FilledShape) -> InertialMistake | None:
    """Finds a mistake of a unit whose correction makes a body agree with its shapes; `None` if there is none.

    Args:
        body: A body that does not agree with its shapes.
        shape: Hull of its shapes.
    """
    for each in UNIT_MISTAKES:
        other = replace(
            body, mass=body.mass / each.mass, com=body.com / each.com, inertia=body.inertia / each.inertia
        )
        found = measures_of(other, scaled(shape, 1.0 / each.shapes))
        if not (USUAL[0] <= found.density <= USUAL[1] and ORDER[0] <= found.ratio <= ORDER[1] and found.is_inside):
            continue
        if each.com != 1.0 and np.linalg.norm(body.com) < shape.extent:  # it would move little
            continue
        return each.cause
    return None


def scaled(shape: FilledShape, factor: float) -> FilledShape:
    """Hull of a body, scaled about the origin of the body's frame by a factor on all lengths."""
    if factor == 1.0:
        return shape
    planes = shape.planes * np.array([1.0, 1.0, 1.0, factor])
    return FilledShape(
        factor * shape.corners,
        planes,
        factor**3 * shape.volume,
        factor * shape.centroid,
        factor**2 * shape.second_moment,
    )


def about_origin(body: DescribedBody, shape: FilledShape, measures: Measures) -> InertialMistake | None:
    """Tests whether the inertia of a body is about the origin of the link instead of the centre of mass.

    The parallel-axis term adds |com|² to the second moment along the line from origin to centre of mass, and nothing
    to the second moment perpendicular to it. The result is `None` if the inertia does not have this form.

    Args:
        body: The body.
        shape: Hull of its shapes.
        measures: Comparison of the body with the hull.
    """
    away = float(np.linalg.norm(body.com))
    if away == 0.0 or not measures.is_inside or not measures.is_dense_enough:
        return None
    u = body.com / away
    own, filled = second_moment(body), shape.second_moment
    along, usual = float(u @ own @ u), float(u @ filled @ u)
    across = (np.trace(own) - along) / max(np.trace(filled) - usual, 1e-12)
    rest = (along - away**2) / usual
    aside = float(np.linalg.norm(own @ u - along * u)) / max(along, 1e-12)
    much = away**2 / usual
    fits = LEFT[0] <= rest <= min(LEFT[1], much) and ACROSS[0] <= across <= ACROSS[1] and aside <= ASIDE
    if much < MUCH or not fits or not _possible(own - away**2 * np.outer(u, u)):
        return None
    words = (
        f"the inertia is about the origin of the link, not about the centre of mass, {away:.3g} m away: without the "
        f"term m·c² the second moment along that line is {rest:.2g} times that of the filled shape, with it "
        f"{along / usual:.2g} times"
    )
    return InertialMistake(
        "inertia-about-origin", words, "take the parallel-axis term m (c²·1 - c cᵀ) off its inertia"
    )


def _possible(moment: Array) -> bool:
    """True if a body with the given second moment (3, 3) exists: no eigenvalue is negative except for rounding."""
    values = np.linalg.eigvalsh(moment)
    return bool(values[0] > -1e-3 * values[-1])

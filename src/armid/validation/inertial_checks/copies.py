"""Search for inertias that were not computed for their body: copies of another body's numbers, and placeholders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armid.robot.described_bodies.body import DescribedBody
from armid.validation.inertial_checks.filled_shape import FilledShape

DIFFERENT = 0.25
"""Relative difference of two shapes above which they count as different. Compared are the roots of the principal
second moments and the cube root of the volume. Left and right parts differ by less than 0.01, and sizes of one series
of parts by 0.1."""

ROUND_BODY = 1.5
"""Largest ratio of the largest to the smallest principal moment of inertia of a filled shape with which the shape
counts as round, so that equal moments about all axes are plausible."""

NEAR = (1.0 / 3.0, 3.0)
"""Smallest and largest ratio of the trace of the inertia to that of the filled hull with which equal moments about
all axes are plausible for a round body."""


def copied(bodies: Sequence[DescribedBody], shapes: Mapping[str, FilledShape]) -> list[tuple[DescribedBody, ...]]:
    """Groups of bodies with the same mass and inertia whose shapes differ.

    Args:
        bodies: Bodies of an arm.
        shapes: Hulls of their shapes, by name.
    """
    groups: dict[tuple[float, ...], list[DescribedBody]] = {}
    for body in bodies:
        if body.name in shapes:
            key = (body.mass, *np.linalg.eigvalsh(body.inertia).tolist())
            groups.setdefault(tuple(float(f"{x:.9g}") for x in key), []).append(body)
    return [
        tuple(group)
        for group in groups.values()
        if len(group) > 1 and any(_differ(shapes[group[0].name], shapes[each.name]) for each in group[1:])
    ]


def _differ(one: FilledShape, other: FilledShape) -> bool:
    """True if two hulls differ in size by more than the share `DIFFERENT`."""
    sizes = [
        np.append(np.sqrt(np.linalg.eigvalsh(each.second_moment)), each.volume ** (1.0 / 3.0))
        for each in (one, other)
    ]
    return bool((np.abs(sizes[0] - sizes[1]) > DIFFERENT * np.maximum(*sizes)).any())


def is_placeholder(body: DescribedBody, shape: FilledShape, ratio: float) -> bool:
    """True if the inertia of a body is zero, or the same about all axes although the shape is not round.

    Args:
        body: The body.
        shape: Hull of its shapes.
        ratio: Trace of the inertia divided by that of the filled hull with the same mass.
    """
    if not body.inertia.any():
        return True
    diagonal = np.diag(body.inertia)
    if not np.array_equal(body.inertia, diagonal[0] * np.eye(3)):
        return bool(np.abs(body.inertia - diagonal[0] * np.eye(3)).max() <= 1e-9 * abs(diagonal[0])) and _uneven(
            shape, ratio
        )
    return _uneven(shape, ratio)


def _uneven(shape: FilledShape, ratio: float) -> bool:
    """True if equal moments of inertia about all axes are implausible for a filled shape.

    Args:
        shape: The shape.
        ratio: Trace of the stated inertia divided by that of the filled shape with the same mass.
    """
    moments = np.trace(shape.second_moment) - np.linalg.eigvalsh(shape.second_moment)
    return bool(moments.max() > ROUND_BODY * moments.min()) or not NEAR[0] <= ratio <= NEAR[1]

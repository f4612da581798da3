"""Inertia of the bodies that a link carries: the description's, unless that leaves no possible body to carry them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.errors import Finding
from armid.export.types import Body
from armid.maths.inertia import pseudo_inertia, transform, vector_from_pseudo_inertia
from armid.robot.robot import InertialParameters
from armid.values import Array

__all__ = ["SPECK", "as_carried", "is_possible", "is_thin", "moved"]

POSSIBLE = 1e-10
"""Smallest eigenvalue of a pseudo-inertia over its largest that a body needs: more than programs lose in reading."""

SPECK = InertialParameters.from_com(1e-6, np.zeros(3), 1e-10 * np.eye(3))
"""A milligram, a centimetre across: nothing beside a link, and enough for MuJoCo to let it move."""

LEFT = 0.5
"""Share of the largest possible size that scaled bodies get, so that what carries them has as much room again."""

FLATTEST = 1e-3
"""Smallest second moment over the largest of a body whose tensor had to be corrected."""

THINNEST = 1e-3
"""Its smallest radius of gyration about a plane through the centre of mass [m]."""


def is_possible(body: InertialParameters) -> bool:
    """Tell whether a distribution of positive mass has these parameters, with some room for rounding."""
    eigenvalues = np.linalg.eigvalsh(body.pseudo_inertia)
    return bool(eigenvalues[0] > POSSIBLE * eigenvalues[-1])


def is_thin(body: Body, written: InertialParameters) -> bool:
    """Tell whether a body has no extent in the description, as a mass without inertia, and is so written."""
    nominal = body.nominal
    if nominal is None or nominal.mass <= 0.0 or is_possible(nominal) or not nominal.is_consistent():
        return False
    alike = written.mass / nominal.mass * nominal.vector
    return bool(np.abs(written.vector - alike).max() <= 1e-12 * np.abs(alike).max())


def moved(body: Body, inertial: InertialParameters) -> InertialParameters:
    """The inertia of a body seen from its link's frame."""
    return inertial.seen_from(body.placement[:3, :3], body.placement[:3, 3])


def as_carried(
    link: InertialParameters, carrier: str, bodies: Sequence[Body], *, lumped: bool = False
) -> tuple[list[InertialParameters], list[Finding]]:
    """Inertia of each body that a link carries, in its own frame, and what to say of it.

    Nothing was identified of these bodies alone, so that they stay as described, even if no real body is like that,
    as long as the rest of the link is possible. Otherwise impossible ones are corrected and made smaller, and where
    that does not suffice, all are scaled. A link that no real body has keeps what it carries as it is.

    Args:
        link: Identified inertia of the link with all it carries, in the link's frame.
        carrier: Name of the body that takes the rest.
        bodies: Those that it carries.
        lumped: Leave nothing to them.
    """
    described = [body.nominal or InertialParameters.zero() for body in bodies]
    if not bodies:
        return [], []
    names, one = ", ".join(body.name for body in bodies), len(bodies) == 1
    if lumped:
        written = f"{names} {'is' if one else 'are'} written without mass, as --lumped asks"
        what = f"{written}; {carrier} has all of the identified link"
        empty = [SPECK if body.is_welded else InertialParameters.zero() for body in bodies]
        return empty, [Finding("carried-lumped", "info", carrier, what)]
    wrong = [k for k, each in enumerate(described) if not each.is_consistent()]
    if not is_possible(link) or is_possible(_rest(link, bodies, described)):
        kept = f"{names} {'keeps' if one else 'keep'} what the description says"
        what = f"{kept}; {carrier} takes the difference to the identified link"
        found = [Finding("difference-taken", "info", carrier, what), *_thin(bodies)]
        return described, [*found, *([_impossible(bodies, wrong)] if wrong else [])]
    corrected = [_corrected(each) if k in wrong else each for k, each in enumerate(described)]
    sound = [each for k, each in enumerate(corrected) if k not in wrong]
    others = [body for k, body in enumerate(bodies) if k not in wrong]
    room = _rest(link, others, sound)
    if wrong and is_possible(room):
        factor = _factor(room, [bodies[k] for k in wrong], [corrected[k] for k in wrong])
        result = [_scaled(each, factor) if k in wrong else each for k, each in enumerate(corrected)]
        return result, [_corrected_finding(carrier, bodies, wrong, factor)]
    factor = _factor(link, bodies, corrected)
    return [_scaled(each, factor) for each in corrected], [_scaled_finding(carrier, bodies, wrong, factor)]


def _rest(
    link: InertialParameters, bodies: Sequence[Body], inertials: Sequence[InertialParameters]
) -> InertialParameters:
    """Return what is left of a link without some bodies, in the link's frame."""
    own = (moved(body, each).vector for body, each in zip(bodies, inertials, strict=True))
    return InertialParameters.from_vector(link.vector - sum(own, np.zeros(10)))


def _factor(room: InertialParameters, bodies: Sequence[Body], inertials: Sequence[InertialParameters]) -> float:
    """Factor on some bodies that leaves a possible body of the room that they are taken from, one at most."""
    together = sum((moved(body, each).vector for body, each in zip(bodies, inertials, strict=True)), np.zeros(10))
    # P - s C stays positive as long as s is less than the inverse of the largest eigenvalue of P⁻¹ C.
    L = np.linalg.cholesky(room.pseudo_inertia)
    whitened = np.linalg.solve(L, np.linalg.solve(L, pseudo_inertia(together)).T)
    largest = float(np.linalg.eigvalsh(0.5 * (whitened + whitened.T))[-1])
    return min(1.0, LEFT / largest) if largest > 0.0 else 1.0


def _scaled(inertial: InertialParameters, factor: float) -> InertialParameters:
    return inertial if factor == 1.0 else InertialParameters.from_vector(factor * inertial.vector)


def _corrected(inertial: InertialParameters) -> InertialParameters:
    """The same mass and centre of mass with the nearest possible tensor; nothing where the mass is not positive."""
    if inertial.mass <= 0.0:
        return InertialParameters.zero()
    J, com = _about(inertial)
    moments, axes = np.linalg.eigh(J[:3, :3])
    least = max(FLATTEST * moments[-1], THINNEST**2 * inertial.mass)
    J[:3, :3] = (axes * np.maximum(moments, least)) @ axes.T
    return InertialParameters.from_vector(transform(vector_from_pseudo_inertia(J), np.eye(3), com))


def _about(inertial: InertialParameters) -> tuple[Array, Array]:
    """Pseudo-inertia (4, 4) about the centre of mass, and the centre (3,) [m]."""
    com = inertial.com
    return pseudo_inertia(transform(inertial.vector, np.eye(3), -com)), com


def _thin(bodies: Sequence[Body]) -> list[Finding]:
    """A word on carried bodies that have a mass and no extent."""
    names = [body.name for body in bodies if body.nominal is not None and is_thin(body, body.nominal)]
    if not names:
        return []
    what = "no inertia in the description, and nothing was identified of it alone; left as it is"
    return [Finding("links-as-described", "info", name, what) for name in names]


def _impossible(bodies: Sequence[Body], wrong: Sequence[int]) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    what = (
        f"the inertia that the description gives {names} is not physically consistent; it was not identified by "
        "itself and stays as it is, so that simulators that refuse the description refuse the file, too"
    )
    return Finding("carried-impossible", "info", "", what)


def _corrected_finding(carrier: str, bodies: Sequence[Body], wrong: Sequence[int], factor: float) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    scaled = "" if factor == 1.0 else f", and mass and inertia times {factor:.3g}"
    what = (
        f"the inertia that the description gives {names} is not physically consistent, and neither would be what it "
        f"leaves of the identified link for {carrier}: written with the nearest consistent inertia{scaled}; "
        "the torque of the arm is that of the estimate"
    )
    return Finding("carried-corrected", "warning", carrier, what, _cure(names, carrier))


def _scaled_finding(carrier: str, bodies: Sequence[Body], wrong: Sequence[int], factor: float) -> Finding:
    names = ", ".join(body.name for body in bodies)
    which = ", ".join(bodies[k].name for k in wrong)
    also = (
        f"; {which}, not physically consistent in the description, got the nearest consistent inertia"
        if wrong
        else ""
    )
    what = (
        f"with {names} as described, what is left of the identified link for {carrier} would not be physically "
        f"consistent; they were scaled by {factor:.3g}{also}"
        "; the torque of the arm is that of the estimate"
    )
    return Finding("children-scaled", "warning", carrier, what, _cure(names, carrier))


def _cure(names: str, carrier: str) -> str:
    return (
        f"where the masses of single bodies matter, correct those of {names} in the description and identify again; "
        f"--lumped writes them without mass and the whole link as {carrier}"
    )

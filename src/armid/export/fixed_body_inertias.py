"""Inertias of the bodies that are attached to the main body of a link by fixed or locked joints.

They are those of the description, and are changed only if otherwise the main body could not be physically consistent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.export.types import Body
from armid.maths.inertia import pseudo_inertia, transform, vector_from_pseudo_inertia
from armid.robot.robot import InertialParameters

POSSIBLE = 1e-10
"""Ratio of the smallest to the largest eigenvalue of the pseudo-inertia, above which a body is physically consistent;
it is larger than the rounding errors of readers."""

SPECK = InertialParameters.from_com(1e-6, np.zeros(3), 1e-10 * np.eye(3))
"""Body with a mass of a milligram and a size of a centimetre: negligible for a link, but enough to be accepted by
MuJoCo."""

LEFT = 0.5
"""Ratio of the factor by which attached bodies are scaled to the largest possible factor. The other half remains for
the main body."""

FLATTEST = 1e-3
"""Lower bound of the ratio of smallest to largest second moment of mass of a body whose tensor is corrected."""

THINNEST = 1e-3
"""Lower bound of the radius of gyration, about a plane through the centre of mass, of a body whose tensor is
corrected [m]."""


def is_possible(body: InertialParameters) -> bool:
    """True if a body of positive mass can have these inertial parameters; the test has a margin for rounding."""
    eigenvalues = np.linalg.eigvalsh(body.pseudo_inertia)
    return bool(eigenvalues[0] > POSSIBLE * eigenvalues[-1])


def is_thin(body: Body, written: InertialParameters) -> bool:
    """True if a body is a point mass, with a mass but no inertia, both in the description and in the file."""
    nominal = body.nominal
    if nominal is None or nominal.mass <= 0.0 or is_possible(nominal) or not nominal.is_consistent():
        return False
    alike = written.mass / nominal.mass * nominal.vector
    return bool(np.abs(written.vector - alike).max() <= 1e-12 * np.abs(alike).max())


def moved(body: Body, inertial: InertialParameters) -> InertialParameters:
    """Transforms an inertia from the frame of a body to the frame of its link."""
    return inertial.seen_from(body.placement[:3, :3], body.placement[:3, 3])


def as_carried(
    link: InertialParameters, carrier: str, bodies: Sequence[Body], *, lumped: bool = False
) -> tuple[list[InertialParameters], list[Finding]]:
    """Computes the inertia of each body attached to the main body of a link, in the frame of the body, and findings.

    Attached bodies were not identified separately. They therefore keep the inertia of the description, even a
    physically inconsistent one, as long as the rest of the link is consistent. Otherwise, inconsistent attached
    bodies are corrected and scaled down. If the rest of the link is still inconsistent, all attached bodies are
    scaled down. If the identified link itself is inconsistent, the attached bodies are not changed.

    Args:
        link: Identified inertia of the link with all bodies, in the frame of the link.
        carrier: Name of the main body, which gets the remaining inertia.
        bodies: Bodies that are attached to the main body.
        lumped: True if the attached bodies get no inertia, false if they get that of the description.
    """
    described = [body.nominal or InertialParameters.zero() for body in bodies]
    if not bodies:
        return [], []
    names, one = ", ".join(body.name for body in bodies), len(bodies) == 1
    if lumped:
        written = f"{names} {'is' if one else 'are'} written without mass because of --lumped"
        what = f"{written}; {carrier} gets the inertia of the whole identified link"
        empty = [SPECK if body.is_welded else InertialParameters.zero() for body in bodies]
        return empty, [Finding("carried-lumped", "info", carrier, what)]
    wrong = [k for k, each in enumerate(described) if not each.is_consistent()]
    if not is_possible(link) or is_possible(_rest(link, bodies, described)):
        kept = f"{names} {'keeps' if one else 'keep'} the inertia of the description"
        minus = "this inertia" if one else "these inertias"
        what = f"{kept}; {carrier} gets the identified inertia of the whole link minus {minus}"
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
    """Inertia of a link minus the inertias of some of its bodies, in the frame of the link."""
    attached = (moved(body, each).vector for body, each in zip(bodies, inertials, strict=True))
    return InertialParameters.from_vector(link.vector - sum(attached, np.zeros(10)))


def _factor(room: InertialParameters, bodies: Sequence[Body], inertials: Sequence[InertialParameters]) -> float:
    """Factor, at most 1, by which bodies are scaled so that the rest of the link is physically consistent.

    Args:
        room: Inertia of the link from which the bodies are subtracted, in the frame of the link.
        bodies: The bodies that are scaled.
        inertials: Inertia of each of these bodies before it is scaled, in the frame of the body.
    """
    together = sum((moved(body, each).vector for body, each in zip(bodies, inertials, strict=True)), np.zeros(10))
    # P - s C stays positive as long as s is less than the inverse of the largest eigenvalue of P⁻¹ C.
    L = np.linalg.cholesky(room.pseudo_inertia)
    whitened = np.linalg.solve(L, np.linalg.solve(L, pseudo_inertia(together)).T)
    largest = float(np.linalg.eigvalsh(0.5 * (whitened + whitened.T))[-1])
    return min(1.0, LEFT / largest) if largest > 0.0 else 1.0


def _scaled(inertial: InertialParameters, factor: float) -> InertialParameters:
    return inertial if factor == 1.0 else InertialParameters.from_vector(factor * inertial.vector)


def _corrected(inertial: InertialParameters) -> InertialParameters:
    """Replaces an inertia tensor by the nearest consistent one, for the same mass and centre of mass.

    The result is zero if the mass is not positive.
    """
    if inertial.mass <= 0.0:
        return InertialParameters.zero()
    J, com = _about(inertial)
    moments, axes = np.linalg.eigh(J[:3, :3])
    least = max(FLATTEST * moments[-1], THINNEST**2 * inertial.mass)
    J[:3, :3] = (axes * np.maximum(moments, least)) @ axes.T
    return InertialParameters.from_vector(transform(vector_from_pseudo_inertia(J), np.eye(3), com))


def _about(inertial: InertialParameters) -> tuple[Array, Array]:
    """Pseudo-inertia (4, 4) about the centre of mass, and the centre of mass (3,) [m]."""
    com = inertial.com
    return pseudo_inertia(transform(inertial.vector, np.eye(3), -com)), com


def _thin(bodies: Sequence[Body]) -> list[Finding]:
    """Findings about attached bodies that have a mass but no inertia in the description."""
    names = [body.name for body in bodies if body.nominal is not None and is_thin(body, body.nominal)]
    if not names:
        return []
    what = (
        "the description gives this body a mass but no inertia; the body was not identified separately and stays "
        "unchanged"
    )
    return [Finding("links-as-described", "info", name, what) for name in names]


def _impossible(bodies: Sequence[Body], wrong: Sequence[int]) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    what = (
        f"the inertia of {names} in the description is not physically consistent; it was not identified separately "
        "and stays unchanged, so simulators that reject the description also reject the file"
    )
    return Finding("carried-impossible", "info", "", what)


def _corrected_finding(carrier: str, bodies: Sequence[Body], wrong: Sequence[int], factor: float) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    scaled = "" if factor == 1.0 else f", multiplied by {factor:.3g}"
    what = (
        f"the inertia of {names} in the description is not physically consistent, and with it the rest of the "
        f"identified link, {carrier}, would not be consistent either; {names} got the nearest consistent "
        f"inertia{scaled}; the torque of the arm is that of the estimate"
    )
    return Finding("carried-corrected", "warning", carrier, what, _cure(names, carrier))


def _scaled_finding(carrier: str, bodies: Sequence[Body], wrong: Sequence[int], factor: float) -> Finding:
    names = ", ".join(body.name for body in bodies)
    which = ", ".join(bodies[k].name for k in wrong)
    also = (
        f"; {which} had an inertia that is not physically consistent and got the nearest consistent one"
        if wrong
        else ""
    )
    what = (
        f"with the inertia of {names} in the description, the rest of the identified link, {carrier}, would not be "
        f"physically consistent; the inertia of {names} was multiplied by {factor:.3g}{also}"
        "; the torque of the arm is that of the estimate"
    )
    return Finding("children-scaled", "warning", carrier, what, _cure(names, carrier))


def _cure(names: str, carrier: str) -> str:
    return (
        f"if the masses of single bodies are needed, correct the masses of {names} in the description and identify "
        f"again; or use --lumped, which gives the whole link to {carrier} and writes the other bodies without mass"
    )

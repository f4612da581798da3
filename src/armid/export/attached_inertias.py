"""Inertias of the bodies attached to a link's main body: the description's, changed only if necessary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.errors import Finding
from armid.export.types import Body
from armid.maths.inertia import pseudo_inertia, transform, vector_from_pseudo_inertia
from armid.robot.robot import InertialParameters
from armid.values import Array

POSSIBLE = 1e-10
"""Least ratio of smallest to largest eigenvalue of a body's pseudo-inertia; above the rounding errors of readers."""

SPECK = InertialParameters.from_com(1e-6, np.zeros(3), 1e-10 * np.eye(3))
"""Body of a milligram and a centimetre: negligible for a link, but enough for MuJoCo to accept it as moving."""

LEFT = 0.5
"""Share of the largest possible scale that scaled bodies get; it leaves the same margin to the main body."""

FLATTEST = 1e-3
"""Ratio of smallest to largest second moment of a body whose tensor was corrected."""

THINNEST = 1e-3
"""Its smallest radius of gyration about a plane through the centre of mass [m]."""


def is_possible(body: InertialParameters) -> bool:
    """True if a distribution of positive mass has these parameters, with a margin for rounding."""
    eigenvalues = np.linalg.eigvalsh(body.pseudo_inertia)
    return bool(eigenvalues[0] > POSSIBLE * eigenvalues[-1])


def is_thin(body: Body, written: InertialParameters) -> bool:
    """True if a body is a point mass in the description, that is, has no inertia, and is written as such."""
    nominal = body.nominal
    if nominal is None or nominal.mass <= 0.0 or is_possible(nominal) or not nominal.is_consistent():
        return False
    alike = written.mass / nominal.mass * nominal.vector
    return bool(np.abs(written.vector - alike).max() <= 1e-12 * np.abs(alike).max())


def moved(body: Body, inertial: InertialParameters) -> InertialParameters:
    """Inertia of a body in its link's frame."""
    return inertial.seen_from(body.placement[:3, :3], body.placement[:3, 3])


def as_carried(
    link: InertialParameters, carrier: str, bodies: Sequence[Body], *, lumped: bool = False
) -> tuple[list[InertialParameters], list[Finding]]:
    """Inertia of each body attached to a link's main body, in its own frame, and findings.

    Nothing was identified of these bodies alone, so that they stay as described, even if no real body is like that,
    as long as the rest of the link is possible. Otherwise impossible ones are corrected and made smaller, and where
    that does not suffice, all are scaled. A link that no real body has keeps what it carries as it is.

    Args:
        link: Identified inertia of the link with all its bodies, in the link's frame.
        carrier: Name of the main body, which takes the remaining inertia.
        bodies: Bodies attached to it.
        lumped: Give these bodies no inertia.
    """
    described = [body.nominal or InertialParameters.zero() for body in bodies]
    if not bodies:
        return [], []
    names, one = ", ".join(body.name for body in bodies), len(bodies) == 1
    if lumped:
        written = f"{names} {'is' if one else 'are'} written without mass because of --lumped"
        what = f"{written}; {carrier} has the whole identified link"
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
    """Inertia of a link without some of its bodies, in the link's frame."""
    attached = (moved(body, each).vector for body, each in zip(bodies, inertials, strict=True))
    return InertialParameters.from_vector(link.vector - sum(attached, np.zeros(10)))


def _factor(room: InertialParameters, bodies: Sequence[Body], inertials: Sequence[InertialParameters]) -> float:
    """Factor for some bodies, at most 1, with which the rest of the link is physically consistent."""
    together = sum((moved(body, each).vector for body, each in zip(bodies, inertials, strict=True)), np.zeros(10))
    # P - s C stays positive as long as s is less than the inverse of the largest eigenvalue of P⁻¹ C.
    L = np.linalg.cholesky(room.pseudo_inertia)
    whitened = np.linalg.solve(L, np.linalg.solve(L, pseudo_inertia(together)).T)
    largest = float(np.linalg.eigvalsh(0.5 * (whitened + whitened.T))[-1])
    return min(1.0, LEFT / largest) if largest > 0.0 else 1.0


def _scaled(inertial: InertialParameters, factor: float) -> InertialParameters:
    return inertial if factor == 1.0 else InertialParameters.from_vector(factor * inertial.vector)


def _corrected(inertial: InertialParameters) -> InertialParameters:
    """Same mass and centre of mass with the nearest consistent tensor; zero if the mass is not positive."""
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
    """Findings about attached bodies that are point masses."""
    names = [body.name for body in bodies if body.nominal is not None and is_thin(body, body.nominal)]
    if not names:
        return []
    what = "the description gives no inertia and it was not identified separately; it stays unchanged"
    return [Finding("links-as-described", "info", name, what) for name in names]


def _impossible(bodies: Sequence[Body], wrong: Sequence[int]) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    what = (
        f"the inertia that the description gives {names} is not physically consistent; it was not identified "
        "separately and stays unchanged, so simulators that reject the description also reject the file"
    )
    return Finding("carried-impossible", "info", "", what)


def _corrected_finding(carrier: str, bodies: Sequence[Body], wrong: Sequence[int], factor: float) -> Finding:
    names = ", ".join(bodies[k].name for k in wrong)
    scaled = "" if factor == 1.0 else f", and mass and inertia times {factor:.3g}"
    what = (
        f"the inertia that the description gives {names} is not physically consistent, and neither would be the "
        f"rest of the identified link for {carrier}: written with the nearest consistent inertia{scaled}; "
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
        f"with {names} as described, the rest of the identified link for {carrier} would not be physically "
        f"consistent; they were scaled by {factor:.3g}{also}"
        "; the torque of the arm is that of the estimate"
    )
    return Finding("children-scaled", "warning", carrier, what, _cure(names, carrier))


def _cure(names: str, carrier: str) -> str:
    return (
        f"where the masses of single bodies matter, correct those of {names} in the description and identify again; "
        f"--lumped writes them without mass and the whole link as {carrier}"
    )

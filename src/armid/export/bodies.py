"""Where a link's identified inertia goes, when the description has several bodies for it.

Fixed and locked joints are no freedom of the arm, so that what they carry is one link of it. In the file the bodies
are still apart: those carried keep what the description says, and the one that carries them takes the rest. What the
description gives a mass and no extent, as sensors and tools often are, has none in the file either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.export.content import Body
from armid.maths.inertia import pseudo_inertia
from armid.maths.spatial import homogeneous
from armid.robot.robot import InertialParameters, Robot
from armid.values import Array

__all__ = ["carried_by", "is_possible", "is_thin", "placed", "share_out"]

POSSIBLE = 1e-10
"""Smallest eigenvalue of a pseudo-inertia over its largest that a body needs: more than programs lose in reading."""

SPECK = InertialParameters.from_com(1e-6, np.zeros(3), 1e-10 * np.eye(3))
"""A milligram, a centimetre across: nothing beside a link, and enough for MuJoCo to let it move."""

LEFT = 0.5
"""Share of the largest possible size that scaled bodies get, so that what carries them has as much room again."""


def placed(raw: Robot, locked: Mapping[str, float], robot: Robot, joint: int, pose: Array) -> tuple[int, Array, bool]:
    """The link of an arm that a body of its description belongs to, and the body's frame in it.

    Args:
        raw: The arm as the description says it, its locked joints still joints.
        locked: Their positions [rad or m].
        robot: The arm with these joints held still.
        joint: Index in `raw` of the joint that moves the body; -1 for the base.
        pose: Frame of the body in that joint's link, shape (4, 4).

    Returns:
        Index of the link, -1 for the base; the frame in it, shape (4, 4); whether a locked joint stands between.
    """
    welded = False
    while joint >= 0 and raw.joints[joint].name in locked:
        own = raw.joints[joint]
        pose = homogeneous(*own.motion(locked[own.name])) @ pose
        joint, welded = own.parent, True
    return (robot.joint_index(raw.joints[joint].name) if joint >= 0 else -1), pose, welded


def share_out(
    links: Sequence[InertialParameters], bodies: Sequence[Body]
) -> tuple[dict[str, InertialParameters], tuple[Finding, ...]]:
    """New inertias for the bodies of a file, so that together they are the links.

    Args:
        links: Identified inertia of each link, in its frame.
        bodies: The file's bodies that move.

    Returns:
        Inertia by body, in the body's own frame, for those that change; and what was done.
    """
    changed: dict[str, InertialParameters] = {}
    findings: list[Finding] = []
    for i, link in enumerate(links):
        own = [_solid(body) for body in bodies if body.link == i]
        if not own:
            continue
        carrier = _carrier(own)
        others = [body for body in own if body is not carrier]
        heavy = [body for body in others if body.nominal is not None and body.nominal.vector.any()]
        carried = [_moved(body, body.nominal) for body in heavy if body.nominal is not None]
        factor, found = _fitting(link, carried, carrier.name, [body.name for body in heavy])
        findings += found
        findings += _thin(heavy, factor)
        rest = link.vector - sum((factor * each.vector for each in carried), np.zeros(10))
        changed[carrier.name] = _seen_from_body(carrier, InertialParameters.from_vector(rest))
        if factor != 1.0:
            for body in heavy:
                assert body.nominal is not None
                changed[body.name] = InertialParameters.from_vector(factor * body.nominal.vector)
        for body in others:
            if body.is_guessed:
                changed[body.name] = body.nominal or InertialParameters.zero()
                findings.append(_emptied(body.name, carrier.name))
    return changed, tuple(findings)


def _solid(body: Body) -> Body:
    """A body that a program would make from meshes; one on a locked joint needs some mass to be taken."""
    if body.is_guessed and body.is_welded:
        return replace(body, nominal=SPECK)
    return body


def carried_by(bodies: Sequence[Body], links: int) -> Array:
    """What the carrying body of each link has on it, as the description says and in the link's frame, (links, 10)."""
    result = np.zeros((links, 10))
    for i in range(links):
        own = [body for body in bodies if body.link == i]
        for body in own:
            if body is not _carrier(own) and body.nominal is not None:
                result[i] += _moved(body, body.nominal).vector
    return result


def is_possible(body: InertialParameters) -> bool:
    """Whether a distribution of positive mass has these parameters, with some room for rounding."""
    eigenvalues = np.linalg.eigvalsh(body.pseudo_inertia)
    return bool(eigenvalues[0] > POSSIBLE * eigenvalues[-1])


def is_thin(body: Body, written: InertialParameters) -> bool:
    """Whether a body has no extent in the description, as a mass without inertia, and is written so or scaled."""
    nominal = body.nominal
    if nominal is None or nominal.mass <= 0.0 or is_possible(nominal) or not nominal.is_consistent():
        return False
    alike = written.mass / nominal.mass * nominal.vector
    return bool(np.abs(written.vector - alike).max() <= 1e-12 * np.abs(alike).max())


def _thin(heavy: Sequence[Body], factor: float) -> list[Finding]:
    """A word on carried bodies that have a mass and no extent."""
    names = [body.name for body in heavy if body.nominal is not None and is_thin(body, body.nominal)]
    if not names or factor != 1.0:
        return []
    what = f"{', '.join(names)}: no inertia in the description, and nothing was identified of them alone"
    return [Finding("links-as-described", "info", names[0] if len(names) == 1 else "", f"{what}; left as they are")]


def _carrier(own: Sequence[Body]) -> Body:
    """The body that takes the difference: the link's own, or where that is a mere frame the heaviest fixed to it."""

    def mass(body: Body) -> float:
        return 0.0 if body.nominal is None else body.nominal.mass

    if mass(own[0]) > 0.0:
        return own[0]
    return max(own, key=lambda body: (not body.is_welded and mass(body) > 0.0, mass(body), body is own[0]))


def _moved(body: Body, inertial: InertialParameters) -> InertialParameters:
    """The inertia of a body seen from its link's frame."""
    return inertial.seen_from(body.placement[:3, :3], body.placement[:3, 3])


def _seen_from_body(body: Body, inertial: InertialParameters) -> InertialParameters:
    """An inertia in the link's frame seen from a body's own."""
    if (body.placement == np.eye(4)).all():
        return inertial
    R, p = body.placement[:3, :3], body.placement[:3, 3]
    return inertial.seen_from(R.T, -R.T @ p)


def _fitting(
    link: InertialParameters, carried: Sequence[InertialParameters], carrier: str, names: Sequence[str]
) -> tuple[float, list[Finding]]:
    """Factor on what is carried that leaves a possible body, and what to say of it.

    A link that no real body has keeps what it carries as it is.
    """
    if not carried:
        return 1.0, []
    together = InertialParameters.from_vector(np.sum([each.vector for each in carried], axis=0))
    listed = ", ".join(names)
    rest = InertialParameters.from_vector(link.vector - together.vector)
    if is_possible(rest) or not is_possible(link):
        what = f"{listed} keep what the description says; {carrier} takes the difference to the identified link"
        return 1.0, [Finding("difference-taken", "info", carrier, what)]
    # P - s C stays positive as long as s is less than the inverse of the largest eigenvalue of P⁻¹ C.
    L = np.linalg.cholesky(link.pseudo_inertia)
    whitened = np.linalg.solve(L, np.linalg.solve(L, pseudo_inertia(together.vector)).T)
    factor = min(1.0, LEFT / float(np.linalg.eigvalsh(0.5 * (whitened + whitened.T))[-1]))
    what = f"with {listed} as described, no real body would be left for {carrier}; they were scaled by {factor:.3g}"
    return factor, [Finding("children-scaled", "warning", carrier, what)]


def _emptied(name: str, carrier: str) -> Finding:
    return Finding(
        "mesh-mass-removed",
        "info",
        name,
        f"other programs would make its inertia from meshes; it is written as nothing, and {carrier} has the link",
    )

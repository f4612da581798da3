"""Place of a link's identified inertia, when the description has several bodies for it.

Fixed and locked joints are no freedom of the arm, so that what they carry is one link of it. In the file the bodies
are still apart: the heaviest of them takes the difference to what was identified, and the others keep what the
description says. What the description gives a mass and no extent, as sensors and tools often are, has none in the
file either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.export.carried_bodies import SPECK, as_carried, moved
from armid.export.types import Body
from armid.maths.spatial import homogeneous
from armid.robot.robot import InertialParameters, Robot
from armid.values import Array

__all__ = ["carried_by", "carriers", "placed", "share_out"]


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
    links: Sequence[InertialParameters], bodies: Sequence[Body], *, lumped: bool = False
) -> tuple[dict[str, InertialParameters], tuple[Finding, ...]]:
    """New inertias for the bodies of a file, so that together they are the links.

    Args:
        links: Identified inertia of each link, in its frame.
        bodies: The file's bodies that move.
        lumped: Give all of a link to the body that carries, and nothing to those that it carries.

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
        given, found = as_carried(link, carrier.name, heavy, lumped=lumped)
        findings += found
        taken = (moved(body, each).vector for body, each in zip(heavy, given, strict=True))
        rest = link.vector - sum(taken, np.zeros(10))
        changed[carrier.name] = _seen_from_body(carrier, InertialParameters.from_vector(rest))
        changed |= {body.name: each for body, each in zip(heavy, given, strict=True) if each is not body.nominal}
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
    """Return the load on the carrying body of each link, as described and in the link's frame, (links, 10)."""
    result = np.zeros((links, 10))
    for i in range(links):
        own = [body for body in bodies if body.link == i]
        for body in own:
            if body is not _carrier(own) and body.nominal is not None:
                result[i] += moved(body, body.nominal).vector
    return result


def carriers(bodies: Sequence[Body]) -> list[Body]:
    """The bodies that take what was identified, one for each link that has any."""
    return [_carrier([body for body in bodies if body.link == i]) for i in sorted({body.link for body in bodies})]


def _carrier(own: Sequence[Body]) -> Body:
    """The heaviest body by the description, before those on locked joints, and the link's own among equals.

    The difference is a share of the whole link: a light body could not take it and still be a body.
    """

    def mass(body: Body) -> float:
        return 0.0 if body.nominal is None else body.nominal.mass

    return max(own, key=lambda body: (not body.is_welded and mass(body) > 0.0, mass(body), body is own[0]))


def _seen_from_body(body: Body, inertial: InertialParameters) -> InertialParameters:
    """An inertia in the link's frame seen from a body's own."""
    if (body.placement == np.eye(4)).all():
        return inertial
    R, p = body.placement[:3, :3], body.placement[:3, 3]
    return inertial.seen_from(R.T, -R.T @ p)


def _emptied(name: str, carrier: str) -> Finding:
    return Finding(
        "mesh-mass-removed",
        "info",
        name,
        f"other programs would make its inertia from meshes; it is written as nothing, and {carrier} has the link",
    )

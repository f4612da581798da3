"""Distribution of the identified inertia of a link among several bodies of the description.

A fixed or locked joint does not move, so the bodies that it connects are one link of the arm, whose inertia is
identified as a whole. In the file these bodies are still separate. One of them, the main body, is the heaviest. It
gets the identified inertia of the link minus the inertia of the other (attached) bodies, which keep the inertia of
the description. A body that has a mass but no inertia in the description, as sensors and tools often do, has no
inertia in the file either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.export.fixed_body_inertias import SPECK, as_carried, moved
from armid.export.types import Body
from armid.maths.rotations import homogeneous
from armid.robot.robot import InertialParameters, Robot


def placed(raw: Robot, locked: Mapping[str, float], robot: Robot, joint: int, pose: Array) -> tuple[int, Array, bool]:
    """Link to which a body of the description belongs, and the pose of the body in the frame of the link.

    Args:
        raw: Arm of the description, in which locked joints are still joints.
        locked: Positions of the locked joints [rad or m].
        robot: Arm whose links include the bodies on locked joints.
        joint: Index in `raw` of the joint that moves the body; -1 for the base.
        pose: Pose of the body in the link frame of that joint, shape (4, 4).

    Returns:
        Index of the link, -1 for the base; pose of the body in the frame of the link, shape (4, 4); true if a locked
        joint lies between link and body.
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
    """Distributes the inertia of each link among the bodies of the file.

    The inertias of the bodies add up to that of the link.

    Args:
        links: Identified inertia of each link, in the frame of the link.
        bodies: Bodies of the file that move.
        lumped: True to give the whole inertia of a link to its main body, and none to the attached bodies.

    Returns:
        New inertia of each body whose inertia changes, by name, in the frame of the body; and findings about these
        changes.
    """
    changed: dict[str, InertialParameters] = {}
    findings: list[Finding] = []
    for i, link in enumerate(links):
        link_bodies = [_solid(body) for body in bodies if body.link == i]
        if not link_bodies:
            continue
        carrier = _carrier(link_bodies)
        others = [body for body in link_bodies if body is not carrier]
        heavy = [body for body in others if body.nominal is not None and body.nominal.vector.any()]
        given, link_findings = as_carried(link, carrier.name, heavy, lumped=lumped)
        findings += link_findings
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
    """Body with a negligible mass, if programs would compute its inertia from meshes and a locked joint attaches it.

    Programs need a mass there. Other bodies are returned unchanged.
    """
    if body.is_guessed and body.is_welded:
        return replace(body, nominal=SPECK)
    return body


def carried_by(bodies: Sequence[Body], links: int) -> Array:
    """Sum of the described inertias of the bodies attached to each main body, in the link frame, shape (n, 10)."""
    result = np.zeros((links, 10))
    for i in range(links):
        link_bodies = [body for body in bodies if body.link == i]
        for body in link_bodies:
            if body is not _carrier(link_bodies) and body.nominal is not None:
                result[i] += moved(body, body.nominal).vector
    return result


def carriers(bodies: Sequence[Body]) -> list[Body]:
    """Main body of each link that has bodies in the file; the main bodies get the identified inertia."""
    return [_carrier([body for body in bodies if body.link == i]) for i in sorted({body.link for body in bodies})]


def _carrier(bodies: Sequence[Body]) -> Body:
    """Main body of a link: the heaviest body that is not on a locked joint; the first one of equally heavy bodies.

    The heaviest body is chosen because it gets the change of the whole link, which could make a light body physically
    inconsistent.
    """

    def mass(body: Body) -> float:
        return 0.0 if body.nominal is None else body.nominal.mass

    return max(bodies, key=lambda body: (not body.is_welded and mass(body) > 0.0, mass(body), body is bodies[0]))


def _seen_from_body(body: Body, inertial: InertialParameters) -> InertialParameters:
    """Transforms an inertia from the frame of the link to the frame of a body."""
    if (body.placement == np.eye(4)).all():
        return inertial
    R, p = body.placement[:3, :3], body.placement[:3, 3]
    return inertial.seen_from(R.T, -R.T @ p)


def _emptied(name: str, carrier: str) -> Finding:
    return Finding(
        "mesh-mass-removed",
        "info",
        name,
        "the description gives this body no inertia, so other programs would compute an inertia from its meshes; "
        f"{carrier} has the identified inertia of the whole link in the file, so this body is written without "
        "inertia",
    )

"""Contacts during a motion between bodies whose distance is not checked.

A pair is left out because the user has excluded it, or because two neighbouring links overlap in most poses. If such
bodies touch in a motion, the user should look at them before the arm executes the motion. Pairs that touch in nearly
all poses by construction are not examined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.collision.adjacent_link_collisions import spread_positions
from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.ignored_pairs import IgnoredPair
from armid.excitation.collision.required_distances import ALWAYS, HALF
from armid.notebook_display import plural
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot

EVERY = 5
"""Stride of the poses that are examined; bodies that touch only between these poses hardly overlap."""

NAMED = 5
"""Largest number of pairs that a finding names."""


@dataclass(frozen=True, slots=True)
class LeftOutContact:
    """Contact between two bodies whose distance is not checked.

    Attributes:
        account: Text with the names of the pair, and the share of poses with overlap or the option or file that
            excludes the pair.
        time: Time of the first contact [s].
        throughout: True if the bodies touch in all examined poses of the motion.
        unexpected: True if the user has excluded the pair, unless the bodies belong to adjacent links and touch
            throughout, as at a joint.
    """

    account: str
    time: float
    throughout: bool
    unexpected: bool = False


def left_out_contacts(
    collision: CollisionOptions, robot: Robot, times: Array, q: Array
) -> tuple[LeftOutContact, ...]:
    """First contacts, in the order of time, of pairs that touch during a motion and are not checked.

    Args:
        collision: Pairs of bodies, including the pairs that are not checked.
        robot: The arm.
        times: Times of the poses, shape (N,) [s].
        q: Positions of the joints at these times, shape (N, n) [rad or m].
    """
    times, q = times[::EVERY], q[::EVERY]
    poses = forward_kinematics(robot, q)
    found: list[LeftOutContact] = []

    def add(each: IgnoredPair, touching: NDArray[np.intp]) -> None:
        if len(touching):
            throughout = len(touching) == len(times)
            unexpected = bool(each.reason) and not (each.adjacent and throughout)
            found.append(LeftOutContact(each.account, float(times[touching[0]]), throughout, unexpected))

    examined = [k for k, each in enumerate(collision.skipped) if each.reason or each.share < ALWAYS]
    bound = collision.left_out.distances(poses) if examined else np.zeros((len(times), 0))
    for k in examined:
        near = np.flatnonzero(bound[:, k] <= 0.0)
        add(
            collision.skipped[k], near[_touching(collision, collision.skipped[k], poses, near)] if len(near) else near
        )
    for each in collision.adjacent.left_out:
        if each.reason or each.share < HALF:
            position = q[:, max(collision.shapes[k].link for k in each.bodies)]
            which = spread_positions(position)
            flags = _touching(collision, each, poses, which)
            add(each, np.flatnonzero(flags[np.searchsorted(position[which], position).clip(max=len(which) - 1)]))
    return tuple(sorted(found, key=lambda contact: contact.time))


def _touching(
    collision: CollisionOptions, each: IgnoredPair, poses: tuple[Array, Array], which: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Mask (k,) of the poses with the indices `which` (k,) in which the bodies of a pair touch."""
    some = poses[0][which], poses[1][which]
    return too_close(collision.shapes, np.array(each.bodies), 0.0, some)


def contacts_found(contacts: Sequence[LeftOutContact]) -> Finding | None:
    """Finding about pairs of bodies that touch in a plan and are not checked; `None` if there are no contacts."""
    if not contacts:
        return None
    meeting = [f"{each.account} at {each.time:.2f} s" for each in contacts if not each.throughout]
    throughout = [each.account for each in contacts if each.throughout]
    parts = [_listed(meeting)] if meeting else []
    parts += [f"all the time: {_listed(throughout)}"] if throughout else []
    touch = "touches" if len(contacts) == 1 else "touch"
    evidence = f"{plural(len(contacts), 'pair')} of bodies whose distance is not checked {touch} in this plan: "
    remedy = (
        "look at these pairs in the preview; if the bodies of a pair must not touch, do not exclude the pair from "
        "the collision check."
    )
    severity = "warning" if any(each.unexpected for each in contacts) else "info"
    return Finding("left-out-pairs-touch", severity, "", evidence + "; ".join(parts), remedy)


def _listed(accounts: Sequence[str]) -> str:
    """Text that lists the first pairs, and gives the number of the others."""
    more = f" and {len(accounts) - NAMED} more" if len(accounts) > NAMED else ""
    return "; ".join(accounts[:NAMED]) + more

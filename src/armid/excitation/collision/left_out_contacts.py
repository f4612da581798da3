"""Contacts during a motion between bodies whose distance is not checked.

A pair is left out because the user has excluded it, or because two neighbouring links overlap in most poses. If such
bodies touch in a motion, whoever runs it should look at them. Pairs that touch in nearly all poses by construction
are not examined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.errors import Finding
from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.required_distances import ALWAYS
from armid.notebook import plural
from armid.values import Array

EVERY = 5
"""Stride of the poses that are examined: bodies that touch for a shorter time hardly overlap."""

NAMED = 5
"""Largest number of pairs that a finding names."""


@dataclass(frozen=True, slots=True)
class LeftOutContact:
    """Contact between two bodies whose distance is not checked.

    Attributes:
        account: The pair, with the share of poses or the option or file that excludes it.
        time: Time of the first contact [s].
        throughout: True if the bodies touch in all examined poses of the motion.
    """

    account: str
    time: float
    throughout: bool


def left_out_contacts(
    collision: CollisionOptions, times: Array, poses: tuple[Array, Array]
) -> tuple[LeftOutContact, ...]:
    """First contact of each pair that is left out and touches during a motion, in the order of time.

    Args:
        collision: Pairs of bodies, with those that are left out.
        times: Times of the poses, shape (N,) [s].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links at these times.
    """
    examined = [k for k, each in enumerate(collision.skipped) if each.reason or each.share < ALWAYS]
    if not examined:
        return ()
    times, poses = times[::EVERY], (poses[0][::EVERY], poses[1][::EVERY])
    bound = collision.left_out.distances(poses)
    found: list[LeftOutContact] = []
    for k in examined:
        near = np.flatnonzero(bound[:, k] <= 0.0)
        each, some = collision.skipped[k], (poses[0][near], poses[1][near])
        touching = near[too_close(collision.shapes, np.array(each.bodies), 0.0, some)] if len(near) else near
        if len(touching):
            found.append(LeftOutContact(each.account, float(times[touching[0]]), len(touching) == len(times)))
    return tuple(sorted(found, key=lambda contact: contact.time))


def contacts_found(contacts: Sequence[LeftOutContact]) -> Finding | None:
    """Finding on pairs of bodies that touch in a plan and whose distance is not checked; `None` without contacts."""
    if not contacts:
        return None
    meeting = [f"{each.account} at {each.time:.2f} s" for each in contacts if not each.throughout]
    throughout = [each.account for each in contacts if each.throughout]
    parts = [_listed(meeting)] if meeting else []
    parts += [f"all the time: {_listed(throughout)}"] if throughout else []
    touch = "touches" if len(contacts) == 1 else "touch"
    evidence = f"{plural(len(contacts), 'pair')} of bodies whose distance is not checked {touch} in this plan: "
    remedy = "look at these pairs in the preview; if one must not touch, do not exclude it from the collision check."
    return Finding("left-out-pairs-touch", "info", "", evidence + "; ".join(parts), remedy)


def _listed(accounts: Sequence[str]) -> str:
    """The first accounts, with the number of the others."""
    more = f" and {len(accounts) - NAMED} more" if len(accounts) > NAMED else ""
    return "; ".join(accounts[:NAMED]) + more

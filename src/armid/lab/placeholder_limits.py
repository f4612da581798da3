"""Detection of effort limits that are placeholders, from which the lab would derive unrealistic friction."""

from __future__ import annotations

import math

import numpy as np

from armid.errors import Finding
from armid.lab.known_arms import TYPICAL_COULOMB, UNKNOWN_EFFORT, KnownArm, friction_of_limits
from armid.values import Array

MUCH = 0.5
"""Smallest ratio over the joints of friction to the links' largest torque above which limits are suspicious."""

MUCH_OF_EQUAL = 0.25
"""The same threshold where all joints have the same limit."""

PROPOSED = 0.1
"""Proposed friction relative to the largest torque of the links, typical of gears of arms."""

LEAST = 0.01
"""Smallest proposed friction, relative to that of the joint with the largest torque."""

FEWEST = 3
"""Number of joints from which one limit for all is suspicious."""


def placeholder_finding(truth: KnownArm, transmitted: Array) -> Finding | None:
    """Finding about friction that was derived from effort limits that look like placeholders, or `None`.

    Args:
        truth: The arm.
        transmitted: Torque of its links along the motion, shape (N, n) [N·m or N].
    """
    robot, friction = truth.robot, friction_of_limits(truth.robot)
    if not np.array_equal(truth.friction.viscous, friction.viscous):  # effects do not change it
        return None
    limits = np.array([joint.effort_limit for joint in robot.joints])
    known, peak = np.isfinite(limits), np.abs(transmitted).max(axis=0)
    largest = float(peak.max())
    loaded = peak > LEAST * largest
    if not loaded.any():
        return None
    share = friction.coulomb[loaded] / peak[loaded]
    equal = robot.n >= FEWEST and len(set(friction.coulomb)) == 1
    unknown = (share[~known[loaded]] > MUCH).any()
    if not unknown and share.min() <= (MUCH_OF_EQUAL if equal else MUCH):
        return None
    units = " and ".join(sorted({joint.effort_unit for joint in robot.joints}))
    proposed = ", ".join(f"{x:.2g}" for x in np.maximum(PROPOSED * peak, LEAST * largest))
    return Finding(
        "limits-placeholder",
        "warning",
        "",
        f"Friction is {100 * TYPICAL_COULOMB:g} % of the effort limits: Coulomb friction {_list(friction.coulomb)} "
        f"{units}, viscous friction as much at 1 rad/s (m/s). The links take at most {_list(peak)}, so that "
        f"{_reason(limits)}.",
        "give friction of the arm's size in a lab.toml for --options, for instance [arm.friction] with "
        f"coulomb = [{proposed}] and viscous = [{proposed}]; or the drives' effort limits in the description.",
    )


def _reason(limits: Array) -> str:
    """Sentence that says why the limits are suspicious."""
    known = np.isfinite(limits)
    if not known.any():
        return f"{UNKNOWN_EFFORT:g}, which is taken where the description gives no limit, is not of this arm's size"
    limit_text = ", ".join(f"{x:g}" if math.isfinite(x) else "not given" for x in limits)
    missing = "" if known.all() else f" ({UNKNOWN_EFFORT:g} is taken where none is given)"
    return f"the limits {limit_text} look like placeholders{missing}"


def _list(numbers: Array) -> str:
    """Numbers as text; a single one where all are equal."""
    words = [f"{x:.3g}" for x in numbers]
    return words[0] if len(set(words)) == 1 else ", ".join(words)

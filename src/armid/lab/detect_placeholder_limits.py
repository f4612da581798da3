"""Detection of effort limits that are only placeholders, which would give the simulated arm unrealistic friction."""

from __future__ import annotations

import math

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.lab.known_arms import TYPICAL_COULOMB, UNKNOWN_EFFORT, KnownArm, friction_of_limits

MUCH = 0.5
"""Largest plausible ratio of the Coulomb friction of a joint to the largest torque that its links need. Effort limits
are suspicious if all joints with load exceed this ratio, or one joint whose effort limit is unknown."""

MUCH_OF_EQUAL = 0.25
"""Ratio that replaces `MUCH` for arms whose joints all have the same effort limit."""

PROPOSED = 0.1
"""Friction that the finding proposes, divided by the largest torque of the links of the joint; typical of gears of
robot arms."""

LEAST = 0.01
"""Smallest proposed friction, divided by the largest torque of all links. Joints whose torque is smaller have no load
and are not judged."""

FEWEST = 3
"""Smallest number of joints from which it is suspicious that all joints of an arm have the same effort limit."""


def placeholder_finding(truth: KnownArm, transmitted: Array) -> Finding | None:
    """Finding about friction that was computed from effort limits that look like placeholders; otherwise `None`.

    Args:
        truth: The simulated arm.
        transmitted: Torque of the links along the motion, shape (N, n) [N·m or N].
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
        f"The friction was computed as {100 * TYPICAL_COULOMB:g} % of the effort limits: Coulomb friction "
        f"{_list(friction.coulomb)} {units}, and the same value of viscous friction at 1 rad/s (m/s). But the links "
        f"need at most {_list(peak)} {units}, so {_reason(limits)}.",
        "give realistic friction in a lab.toml with --options, for instance [arm.friction] with "
        f"coulomb = [{proposed}] and viscous = [{proposed}]; or write the real effort limits into the description.",
    )


def _reason(limits: Array) -> str:
    """Clause of the finding that states why the effort limits (n,) [N·m or N] are suspicious."""
    known = np.isfinite(limits)
    if not known.any():
        return f"the limit {UNKNOWN_EFFORT:g}, which is assumed because the description has none, is unrealistic"
    limit_text = ", ".join(f"{x:g}" if math.isfinite(x) else "not given" for x in limits)
    missing = "" if known.all() else f" ({UNKNOWN_EFFORT:g} is assumed for a limit that is not given)"
    return f"the limits {limit_text} look like placeholders{missing}"


def _list(numbers: Array) -> str:
    """Text with numbers; if all numbers are equal, the text contains the number once."""
    words = [f"{x:.3g}" for x in numbers]
    return words[0] if len(set(words)) == 1 else ", ".join(words)

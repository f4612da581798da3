"""Torque that is cut off: at a value of its own, or at the description's limit."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.values import Array

__all__ = ["check"]

FEWEST, SHARE = 10, 0.002
"""Samples at the very same extreme value that make a plateau, and the share of all that they must be."""

DENSER = 5.0
"""How much more often the extreme value must occur than its neighbours; coarse converters repeat all of them."""

NEIGHBOURS = 12

LIMIT = 0.98
"""Share of the description's limit that counts as reaching it."""


def check(evidence: Evidence) -> list[Finding]:
    """One finding for each joint whose torque is cut off."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    findings: list[Finding] = []
    for j, joint in enumerate(evidence.robot.joints):
        tau = recording.effort[recording.valid[:, j], j]
        if not len(tau) or np.ptp(tau) == 0.0:
            continue
        count, level = max((_plateau(tau), _plateau(-tau)), key=lambda found: found[0])
        at_limit = int((np.abs(tau) >= LIMIT * joint.effort_limit).sum()) if joint.effort_limit > 0.0 else 0
        if count:
            text = f"{count} of {len(tau)} samples stand at the same extreme, {level:.4g} {joint.effort_unit}."
        elif at_limit >= max(FEWEST, SHARE * len(tau)):
            text = (
                f"{at_limit} of {len(tau)} samples reach {LIMIT:g} of the description's limit, "
                f"{joint.effort_limit:.4g} {joint.effort_unit}."
            )
        else:
            continue
        findings.append(Finding("saturation", "warning", joint.name, text, "saturation = 0.98  # in [processing]"))
    return findings


def _plateau(tau: Array) -> tuple[int, float]:
    """Samples at the largest value, and that value, if they are too many for a peak."""
    top = float(tau.max())
    tolerance = 1e-9 * max(abs(top), float(np.ptp(tau)))
    values, counts = np.unique(tau, return_counts=True)
    near = values >= top - tolerance
    count = int(counts[near].sum())
    others = counts[~near][-NEIGHBOURS:]
    usual = float(np.mean(others)) if len(others) else 0.0
    if count < max(FEWEST, SHARE * len(tau)) or count < DENSER * usual:
        return 0, top
    return count, abs(top)

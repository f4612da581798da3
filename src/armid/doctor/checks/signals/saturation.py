"""Saturated torque: a plateau, or torque at the limit of the description; and torque beyond this limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.suggested_log_format import excluding, lines
from armid.robot.robot import Joint

FEWEST, SHARE = 10, 0.002
"""Smallest number of samples at the same extreme value that form a plateau, and their smallest share of all
samples."""

DENSER = 5.0
"""Ratio by which the extreme value must be more frequent than similar values; coarse converters repeat all values."""

NEIGHBOURS = 12

APART = 0.25
"""Shortest time between two saturated stretches [s]; nearer ones are merged, because noise cuts one into many."""

LIMIT = 0.98
"""Share of the limit of the description from which the limit counts as reached."""

BEYOND = 1.5
"""Ratio of torque to the limit of the description from which this limit cannot have been in force."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports each joint whose torque saturates or is beyond its limit."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    findings: list[Finding] = []
    left_out: list[tuple[float, float]] = []
    for j, joint in enumerate(evidence.robot.joints):
        counted = recording.valid[:, j]
        if evidence.saturation is not None and joint.effort_limit > 0.0:
            counted = counted & (np.abs(recording.effort[:, j]) < evidence.saturation * joint.effort_limit)
        tau = recording.effort[counted, j]
        if not len(tau) or np.ptp(tau) == 0.0:
            continue
        count, level = max((_plateau(tau), _plateau(-tau)), key=lambda found: found[0])
        at_limit = int((np.abs(tau) >= LIMIT * joint.effort_limit).sum()) if joint.effort_limit > 0.0 else 0
        if count:
            text = f"{count} of {len(tau)} samples have the same extreme value, {level:.4g} {joint.effort_unit}."
            flat = counted & (np.abs(np.abs(recording.effort[:, j]) - level) <= 1e-9 * max(level, float(np.ptp(tau))))
            left_out += _stretches(flat, evidence)
            remedy = ""
        elif at_limit >= FEWEST and np.sort(np.abs(tau))[-FEWEST] > BEYOND * joint.effort_limit:
            findings.append(_beyond(joint, tau))
            continue
        elif at_limit >= max(FEWEST, SHARE * len(tau)):
            text = (
                f"{at_limit} of {len(tau)} samples reach {LIMIT:.0%} of the effort limit of the description, "
                f"{joint.effort_limit:.4g} {joint.effort_unit}."
            )
            remedy = lines(table="processing", saturation=LIMIT)
        else:
            continue
        findings.append(Finding("saturation", "warning", joint.name, text, remedy))
    # One line leaves out what stands at an extreme value of any joint: a study has the key once.
    exclude = excluding(evidence.reading, left_out)
    return [each if each.remedy else replace(each, remedy=exclude) for each in findings]


def _beyond(joint: Joint, tau: Array) -> Finding:
    """Finding of torque that no drive with the limit of the description gives."""
    unit, limit, size = joint.effort_unit, joint.effort_limit, np.abs(tau)
    return Finding(
        "torque-beyond-limit",
        "warning",
        joint.name,
        f"{int((size > limit).sum())} of {len(tau)} samples are beyond the effort limit of the description, "
        f"{limit:.4g} {unit}; the largest is {size.max():.4g} {unit}.",
        f"check the unit of this torque (drive_gain, one number for each joint, converts it to {unit}) and the limit "
        "in the description.",
    )


def _stretches(flat: NDArray[np.bool_], evidence: LogEvidence) -> list[tuple[float, float]]:
    """Saturated intervals of time, merged where they nearly meet [s]."""
    recording = evidence.recording
    assert recording is not None
    rows = np.flatnonzero(flat)
    time = rows / evidence.rate if recording.time is None else recording.time[rows]
    pieces = np.split(time, np.flatnonzero(np.diff(time) > APART) + 1)
    return [(float(piece[0]), float(piece[-1])) for piece in pieces]


def _plateau(tau: Array) -> tuple[int, float]:
    """Number of samples at the largest value, 0 if a peak can have as many, and that value."""
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


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "saturation": "The largest torques are too small, and inertias and friction with them.",
        "torque-beyond-limit": "If the unit is wrong, the friction of this joint is wrong by its factor, and "
        "inertial parameters that other joints share are a compromise.",
    },
    untested={
        "saturation": "the rows that it leaves out contain no measurement",
    },
    hides=(
        "contact",
        "temperature-drift",
    ),
    needs_torque=False,
)

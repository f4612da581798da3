"""Detection of saturated samples: torque at a plateau or near the effort limit.

A plateau is the end of the range of a sensor or drive, at which many samples have the same extreme value; the true
torque is larger by an unknown amount. Saturated samples, and the rows that they affect through a filter, are not used
for the joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import Finding, RecordingError
from armid.measurement.processing.channels.statistics import extremes, outside
from armid.measurement.recording import Recording

FEWEST, SHARE = 10, 0.002
"""Smallest number of samples with the same extreme value that form a plateau, and their smallest share of all
samples."""

DENSER = 5.0
"""Smallest ratio of the number of samples at the extreme value to the mean number at values next to it, for a
plateau. Coarse converters repeat all values, not only the extreme one."""

NEIGHBOURS = 12
"""Number of values next to the extreme value with which its frequency is compared."""

ROUNDING = 1e-9
"""Relative difference up to which two values count as equal."""

NOT_USED = "Rows near these samples are not used for this joint."


@dataclass(frozen=True, eq=False, slots=True)
class Plateau:
    """Plateau in the torque of a joint: many samples have the same extreme value.

    Attributes:
        joint: Index of the joint.
        level: Absolute value of the torque at the plateau [N·m or N].
        count: Number of samples at the largest value or at the smallest value, whichever number is larger.
        samples: Number of samples of the joint that were examined.
        rows: Mask of the samples with the absolute value `level`, shape (N,).
    """

    joint: int
    level: float
    count: int
    samples: int
    rows: NDArray[np.bool_]


def plateaus(effort: Array, counted: NDArray[np.bool_]) -> tuple[Plateau, ...]:
    """Finds the plateaus of the torque of each joint.

    Args:
        effort: Torque, shape (N, n) [N·m or N].
        counted: Mask of the samples that are examined, shape (N, n).
    """
    found: list[Plateau] = []
    for j in _repeated_extremes(effort) if counted.all() else range(effort.shape[1]):
        tau = effort[counted[:, j], j]
        if not len(tau) or np.ptp(tau) == 0.0:
            continue
        count, level = max((_plateau(tau), _plateau(-tau)), key=lambda each: each[0])
        if count:
            same = ROUNDING * max(level, float(np.ptp(tau)))
            rows = counted[:, j] & (np.abs(np.abs(effort[:, j]) - level) <= same)
            found.append(Plateau(j, level, count, len(tau), rows))
    return tuple(found)


def _repeated_extremes(effort: Array) -> list[int]:
    """Joints whose torque (N, n) may have a plateau, because enough of its samples lie at its extreme values."""
    low, high = extremes(effort)
    near = ROUNDING * np.maximum(np.maximum(np.abs(low), np.abs(high)), high - low)
    found = outside(effort, low + near, high - near)
    fewest = max(FEWEST, SHARE * len(effort))
    return [j for j in range(len(found)) if found[j] >= fewest and high[j] > low[j]]


def without_plateaus(recording: Recording) -> Recording:
    """Masks the samples of a recording at which the torque is at a plateau."""
    return recording if recording.effort is None else _without(recording, plateaus(recording.effort, recording.valid))


def without_saturated(
    recording: Recording,
    saturation: float | Literal["keep"] | None,
    limits: ArrayLike | None,
    findings: list[Finding],
) -> Recording:
    """Masks the samples of a recording with torque at a plateau or near an effort limit, and adds findings.

    Args:
        recording: Recording in the robot's joint order, SI units, joint side.
        saturation: Share of the effort limit at and above which samples are left out; `keep` leaves out none; `None`
            leaves out only plateaus.
        limits: Effort limit of each joint, shape (n,) [N·m or N]; needed if `saturation` is a number.
        findings: List to which findings about saturated samples are added.

    Raises:
        RecordingError: `saturation` is a number, but the effort limits are not known.
    """
    effort = recording.effort
    if effort is None or saturation == "keep":
        return recording
    if saturation is not None:
        recording = _below_limits(recording, effort, saturation, limits, findings)
    flat = plateaus(effort, recording.valid)
    for each in flat:
        findings.append(
            Finding(
                "saturation",
                "warning",
                recording.channels[each.joint],
                f"{recording.source}: {each.count} of {each.samples} samples have the same extreme effort, "
                f"{each.level:.4g} N·m or N; the true effort is larger. {NOT_USED}",
                'record a motion that needs less torque; saturation = "keep" in [processing] uses all rows.',
            )
        )
    return _without(recording, flat)


def _without(recording: Recording, flat: tuple[Plateau, ...]) -> Recording:
    """Masks the samples of plateaus in a recording."""
    if not flat:
        return recording
    valid = recording.valid.copy()
    for each in flat:
        valid[:, each.joint] &= ~each.rows
    return replace(recording, valid=valid)


def _below_limits(
    recording: Recording, effort: Array, share: float, limits: ArrayLike | None, findings: list[Finding]
) -> Recording:
    """Masks the samples of a recording at which the effort reaches a share of its limit, and adds findings."""
    if limits is None:
        raise RecordingError(
            "The key `saturation` needs the effort limits of the joints, but they are not known.",
            remedy="add effort limits to the description of the robot, or leave `saturation` out.",
        )
    bounds = array(limits, (recording.n,), "effort limits", finite=False)
    over = np.abs(effort) >= share * bounds
    for joint in np.flatnonzero(over.any(axis=0)):
        findings.append(
            Finding(
                "saturation",
                "warning",
                recording.channels[joint],
                f"{recording.source}: The effort reaches {share:g} times the limit {bounds[joint]:g} N·m or N in "
                f"{int(over[:, joint].sum())} of {recording.samples} samples. {NOT_USED}",
                "record a motion that needs less torque, or give a larger share with the key `saturation`.",
            )
        )
    return replace(recording, valid=recording.valid & ~over)


def _plateau(tau: Array) -> tuple[int, float]:
    """Number of samples at the largest value of a torque (N,), and the absolute value of this torque.

    The number is 0 if these samples are not a plateau, because an ordinary peak can have as many.
    """
    top = float(tau.max())
    same = ROUNDING * max(abs(top), float(np.ptp(tau)))
    count, fewest = int((tau >= top - same).sum()), max(FEWEST, SHARE * len(tau))
    if count < fewest:
        return 0, top
    values, counts = np.unique(tau, return_counts=True)
    others = counts[values < top - same][-NEIGHBOURS:]
    usual = float(np.mean(others)) if len(others) else 0.0
    return (0, top) if count < DENSER * usual else (count, abs(top))

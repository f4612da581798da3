"""Torque that is held constant: by the controller until its next sample, or by a log that repeats values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy

HALF_STEP = 0.2
"""Largest difference between a lead and half a sample, in samples, for which a held torque is named as its cause."""

LATER = 0.1
"""Largest difference between a delay and that of a repeated torque, in intervals between two updates, for which
the repetition is named as the whole cause."""

FEWEST = 100
"""Smallest number of updates from which their interval is determined."""

LONGEST = 100
"""Longest interval between updates that is searched for, in rows."""

REGULAR = 0.95
"""Smallest share of the times between changes of the torque that are multiples of the interval. Steps of a coarse
sensor repeat values, too, but the times between their changes have no common divisor; a lost row changes one time."""


def held_by_controller(samples: float) -> str:
    """Sentence on the usual cause if the torque is early by half a sample; an empty text for other delays.

    Args:
        samples: Delay of the torque, negative for a lead [samples].
    """
    cause = " A torque that the controller holds until its next sample runs ahead by half a sample."
    return cause if abs(samples + 0.5) < HALF_STEP else ""


def update_interval(effort: Array) -> int:
    """Number of rows from one update of the torque to the next; 1 if the torque may change in every row.

    Args:
        effort: Torque or current as logged, shape (N, n); NaN where missing.
    """
    changed = (effort[1:] != effort[:-1]) & np.isfinite(effort[1:]) & np.isfinite(effort[:-1])
    between = np.diff(np.flatnonzero(changed.any(axis=1)))
    if len(between) < FEWEST:
        return 1
    shares = {rows: float(np.mean(between % rows == 0)) for rows in range(2, LONGEST + 1)}
    return max((rows for rows, share in shares.items() if share >= REGULAR), default=1)


def with_repeated_torque(finding: Finding, evidence: LogEvidence) -> Finding:
    """Adds cause and a further remedy to a finding about a delay, if the log repeats the last torque in some rows.

    Args:
        finding: Finding about a delay of all torques, whose remedy is the key `delay`.
        evidence: The recording.
    """
    effort, state = evidence.raw.effort, evidence.state
    remedy = Remedy.read(finding.remedy)
    total, stated = remedy.keys.get("delay"), np.unique(evidence.reading.delay)
    rows = 1 if effort is None else update_interval(effort)
    if rows == 1 or state is None or not isinstance(total, float) or len(stated) > 1:
        return finding
    late, held = (total - float(stated[0])) * state.log.rate, 0.5 * (rows - 1)
    if late < held - LATER * rows:
        return finding
    part = "the delay" if late <= held + LATER * rows else f"{held:g} samples of the delay"
    cause = (
        f" The torque changes only once in {rows} rows. In between, the log repeats the last value, which is late "
        f"by {held:g} samples on average; this explains {part}."
    )
    better = "or log the torque in every row, or keep only the rows with a new torque"
    note = "; ".join(filter(None, (remedy.note, better)))
    return replace(finding, evidence=finding.evidence + cause, remedy=lines(note, delay=total).marked())

"""Explanation of a log by a change within it, with the remedy: to leave out the smaller part."""

from __future__ import annotations

from typing import Literal

import numpy as np

from armid.doctor.changes.excluded_part import excluded_part, near_changes
from armid.doctor.changes.refine import FittedChange
from armid.doctor.changes.wording import channel_of, evidence_of
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.remedy_trial import HELPS, RemedyTrial, heldout_error
from armid.measurement.remedy_builders import excluding
from armid.remedy import Remedy

GRADUAL = (
    "record again when this no longer changes: with warm drives and gears, and with one load; find out what the "
    "controller changed during the motion"
)
"""Remedy of a change that grows along the log, so that no part of the log is free of it."""


class ChangeTrial(RemedyTrial):
    """Errors on left-out motion of a model in which nothing changes, and of one with the change."""

    def __str__(self) -> str:
        return (
            f"On left-out motion, the error is {np.exp(self.before):.2%} of the torque if nothing changes in the "
            f"model, and {np.exp(self.after):.2%} with this change."
        )


def trial_of(change: FittedChange) -> ChangeTrial:
    """Errors on left-out motion without and with a change."""
    return ChangeTrial(heldout_error(change.state.rows), heldout_error(change.rows))


def is_warming(change: FittedChange) -> bool:
    """True if friction of several joints changes gradually along the log, as while gears warm up."""
    each = change.candidate
    return each.alternative.kind == "friction" and each.alternative.of_all and each.shape.form != "step"


def explained_by(change: FittedChange, code: str, severity: Literal["error", "warning"]) -> Explanation:
    """Explains the misfit of a model by a change within the log.

    Args:
        change: The change.
        code: Code of the finding.
        severity: Severity of the finding.
    """
    state = change.state
    robot = state.model.robot
    units = ["N" if joint.is_prismatic else "N·m" for joint in robot.joints]
    return Explanation(
        code,
        change.gain,
        severity,
        channel_of(change, robot.joint_names),
        evidence_of(change, robot.joint_names, units),
        lambda evidence: _remedy(change, evidence),
        state.without_change(change.torque).without(near_changes(change)),
        worse=HELPS,
        trial=trial_of(change),
    )


def _remedy(change: FittedChange, evidence: LogEvidence) -> Remedy | str:
    """Lines that leave out the smaller part of the log, or a sentence if the change is gradual."""
    if change.candidate.shape.form == "ramp":
        return GRADUAL
    time = None if evidence.recording is None else evidence.recording.time
    rows = change.state.rows.motion.time
    begin, end = (float(rows[0]), float(rows[-1])) if time is None else (float(time[0]), float(time[-1]))
    part = excluded_part(change, begin, end)
    note = "leaves out the changed part" if part.changed else "keeps the changed part, which is the longer one"
    return excluding(evidence.reading, part.intervals, note)

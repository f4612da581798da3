"""Check for a change within a log: of a torque's gain, offset or delay, of a zero, a payload, friction or gravity.

A log of one arm has one model. What changes between two parts of a log is neither a fault of the log format, which
holds for all of it, nor a short contact. All changes are compared with every other fault by the decrease of the
residual. A position that jumps from one row to the next is found without a model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.doctor.changes.explanation import explained_by, is_warming
from armid.doctor.changes.judgement import change_of
from armid.doctor.changes.position_jumps import Jump
from armid.doctor.changes.refine import FittedChange
from armid.doctor.changes.torque_jumps import TorqueJump, torque_jumps
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.residuals.large_residual import rival
from armid.errors import Finding
from armid.measurement.remedy_builders import excluding

CODE = "changes-midway"

CERTAIN = 0.3
"""Decrease of the mean logarithm of the RMS residuals from which a change is an error: the residual is then a quarter
smaller. Sound recordings, and halves of them, ask for possible changes by at most 0.15."""

WEAKEST = 0.77
"""Factor on a torque, or its inverse, beyond which a change of gain is an error, as between recordings (1.3)."""

LISTED = 6
"""Largest number of times that are listed."""

SLIPPED = 0.02
"""Jump of a position from which it is an error [rad or m]: it moves weights by two percent of the arm's length."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports what changes within a log, and when."""
    joints = dict.fromkeys(each.joint for each in evidence.jumps)
    groups = [[each for each in evidence.jumps if each.joint == j] for j in joints]
    slips = [_slips(evidence, own) if len(own) > 1 else _slip(evidence, own[0]) for own in groups]
    explained = evidence.explained(CODE)
    # A change that explains the log makes torques jump itself; what else jumps is told once that change is left out.
    jumps = [] if explained or evidence.recording is None else torque_jumps(evidence.recording)
    return [*slips, *explained, *(_torque_jump(evidence, each) for each in jumps)]


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a change within the log; `None` if nothing changes.

    Friction that changes gradually on several joints is left to the check for drifting temperature. A change of one
    torque is compared with what that torque may follow otherwise, for instance its angle.
    """
    change = change_of(state)
    if change is None or is_warming(change):
        return None
    j = change.candidate.alternative.of_torque
    if j is not None and (other := rival(state, j, change.gain)) is not None:
        return other
    return explained_by(change, CODE, "error" if _is_certain(change) else "warning")


def _is_certain(change: FittedChange) -> bool:
    """True if no effect of a sound arm resembles a change."""
    if change.candidate.alternative.kind == "gain" and not WEAKEST < change.values[0] < 1.0 / WEAKEST:
        return True
    return change.gain > CERTAIN


def _slips(evidence: LogEvidence, jumps: Sequence[Jump]) -> Finding:
    """Finding on a position that jumps several times and stays each time."""
    recording, name = evidence.recording, evidence.robot.joint_names[jumps[0].joint]
    assert recording is not None
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    sizes = np.array([each.size for each in jumps])
    unit = "m" if evidence.robot.joints[jumps[0].joint].is_prismatic else "rad"
    return Finding(
        CODE,
        "error" if np.abs(sizes).max() > SLIPPED else "warning",
        name,
        f"The position of {name} jumps {len(jumps)} times from one row to the next and stays there, while other "
        f"joints move on: by {sizes.min():+.3g} to {sizes.max():+.3g} {unit}, first at t = "
        f"{float(time[jumps[0].row]):.3f} s. Its encoder slips, or one of its bits is wrong.",
        "find out the cause in the encoder, its coupling and its cable, and record again",
    )


def _slip(evidence: LogEvidence, jump: Jump) -> Finding:
    """Finding on a position that jumps and stays."""
    recording = evidence.recording
    assert recording is not None
    rows, unit = recording.samples, "m" if evidence.robot.joints[jump.joint].is_prismatic else "rad"
    time = recording.time
    at = [jump.row / evidence.rate, 0.0, (rows - 1) / evidence.rate]
    if time is not None:
        at = [float(time[jump.row]), float(time[0]), float(time[-1])]
    late = 2 * jump.row >= rows
    interval = (at[0], at[2]) if late else (at[1], at[0] + 1.0 / evidence.rate)
    return Finding(
        CODE,
        "error" if abs(jump.size) > SLIPPED else "warning",
        evidence.robot.joint_names[jump.joint],
        f"At t = {at[0]:.3f} s the position of {evidence.robot.joint_names[jump.joint]} jumps by {jump.size:+.3g} "
        f"{unit} from one row to the next and stays there, while other joints move on: its encoder slipped, or its "
        "zero was set anew. Either of the two parts may be the wrong one.",
        excluding(evidence.reading, [interval], "leaves out the shorter part"),
    )


def _torque_jump(evidence: LogEvidence, jump: TorqueJump) -> Finding:
    """Finding on a torque that jumps once or several times and stays each time."""
    recording, joint = evidence.recording, evidence.robot.joints[jump.joint]
    assert recording is not None
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    unit = "N" if joint.is_prismatic else "N·m"
    sizes, name = np.array(jump.sizes), evidence.robot.joint_names[jump.joint]
    times = ", ".join(f"{float(time[row]):.2f}" for row in jump.rows[:LISTED])
    more = "" if len(sizes) <= LISTED else f" and {len(sizes) - LISTED} more"
    by = f"{sizes[0]:+.3g} {unit}" if len(sizes) == 1 else f"{sizes.min():+.3g} to {sizes.max():+.3g} {unit}"
    return Finding(
        CODE,
        "warning",
        name,
        f"The torque of {name} jumps from one row to the next and stays there, while the joint moves on: by {by}, at "
        f"t = {times}{more} s. Its zero was set anew, its gain was switched, or the arm was loaded suddenly.",
        "find out what changed the torque at these times; record again without it, or cut the log there into "
        "recordings of their own",
    )


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        CODE: "One model is fitted to two: all parameters that the change concerns are a mean of the two parts, and "
        "the others take part of the difference.",
    },
    explain=explain,
    untested={CODE: "a jump of the position is certain without it"},
    follows=("channel-dead",),
)

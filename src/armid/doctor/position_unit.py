"""Decision between degrees, counts of encoders and positions of motors, for angles that are not in radians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

PLAUSIBLE_CONFLICT, PLAUSIBLE_CORRELATION, PLAUSIBLE_SCALE = 0.6, 0.7, 0.3
"""Limits within which angles are accepted as degrees: largest conflict between the joints, smallest correlation
with the torque of the description, and smallest share of this torque. Angles of motors fail them even inside the
joint limits."""

GEARED = 3.0
"""Range of a motion divided by the range of the limits, from which positions are degrees or positions of motors."""

MOST_DEGREES = 720.0
"""Largest position that is accepted as an angle in degrees. Larger whole numbers are counts of encoders, because
joints with cables turn twice at most."""

USUAL_COUNTS = 4096
"""Smallest number of counts in a turn that is assumed in the example of a message; servos usually have it."""


def reconsidered(evidence: LogEvidence) -> LogEvidence:
    """Replaces findings of the reader about degrees or zeros if the torque shows another unit of the positions.

    The reader may have reported angles in degrees; if the torque contradicts this, they are positions of motors.
    Angles far outside all limits are degrees if the torque agrees with this, otherwise positions of motors. Positions
    of motors that are whole numbers are counts of encoders, and also whole numbers that are too large for degrees.

    Args:
        evidence: The log, with the findings of the reader.
    """
    whole = _are_whole(evidence)
    if whole and _largest(evidence) > MOST_DEGREES:
        others = evidence.without("degrees", "position-offset")
        return replace(others, noted=(*others.noted, _counts(evidence)), recording=None)
    degrees = next((f for f in evidence.noted if f.code == "degrees"), None)
    far = next((f for f in evidence.noted if f.code == "position-offset"), None)
    if degrees is not None and evidence.state is not None and not _explains_torque(evidence):
        doubted, why = degrees, "If the positions were degrees, they would contradict the torque"
    elif far is not None and turns_too_far(evidence):
        read_so = _as_degrees(evidence)
        if read_so is not None and _explains_torque(read_so):
            return _replaced(read_so, far, _degrees(far))
        doubted, why = far, "Other joints move as far as this joint"
    else:
        return evidence
    found = _counts(evidence) if whole else of_motors(f"{doubted.evidence} {why}")
    return replace(_replaced(evidence, doubted, found), recording=None)


def of_motors(reason: str) -> Finding:
    """Finding that the logged positions are positions of the motors and not of the joints.

    Args:
        reason: Reason for this conclusion: beginning of the sentence of evidence, without a full stop.
    """
    return Finding(
        "motor-side",
        "error",
        "q",
        f"{reason}, so the logged positions are probably motor positions, on the motor side of the gears.",
        "find out the matrix N in q_motor = N (q - joint_offset), and give it in the key `transmission`: "
        "transmission = [[N1, 0, …], …]",
    )


def _are_whole(evidence: LogEvidence) -> bool:
    """True if all logged positions are whole numbers and are read as radians of revolute joints."""
    recording, reading, q = evidence.recording, evidence.reading, evidence.raw.q
    if recording is None or reading.transmission is not None or reading.degrees(recording.n).any():
        return False
    turns = [not joint.is_prismatic for joint in evidence.robot.joints]
    known = q[np.isfinite(q)]
    return all(turns) and bool(len(known)) and bool((known == np.round(known)).all())


def _largest(evidence: LogEvidence) -> float:
    """Largest absolute value of the logged positions."""
    return float(np.nanmax(np.abs(evidence.raw.q), initial=0.0))


def _counts(evidence: LogEvidence) -> Finding:
    """Finding that the logged positions are counts of encoders.

    It states the motion for a usual number of counts per turn.
    """
    q = evidence.raw.q
    low, high = np.nanmin(q, axis=0), np.nanmax(q, axis=0)
    reach = high.max() + 1.0 if low.min() >= 0.0 else (high - low).max() + 1.0
    turn = max(USUAL_COUNTS, 2 ** int(np.ceil(np.log2(reach))))
    moves = (high - low) * 2.0 * np.pi / turn
    return Finding(
        "motor-side",
        "error",
        "q",
        f"All positions are whole numbers, from {low.min():.0f} to {high.max():.0f}, so they are probably counts of "
        f"encoders. With {turn} counts per turn, the joints would move over {moves.min():.2g} to "
        f"{moves.max():.2g} rad.",
        "find out the number N of counts per turn of each joint and the count Z at its zero, and convert the "
        "positions in the file to radians: q = 2π (count - Z) / N; convert velocities in counts in the same way.",
    )


def _replaced(evidence: LogEvidence, old: Finding, new: Finding) -> LogEvidence:
    return replace(evidence, noted=tuple(new if each is old else each for each in evidence.noted))


def _degrees(far: Finding) -> Finding:
    text = f"{far.evidence} Other joints move as far as this joint. In degrees, the angles agree with the torque."
    remedy = lines("or transmission and joint_offset, if the log is on the motor side", units="deg")
    return Finding("degrees", "error", "", text, remedy)


def _as_degrees(evidence: LogEvidence) -> LogEvidence | None:
    """The log with all angles read as degrees; `None` if the log format already states degrees or a transmission."""
    reading, recording = evidence.reading, evidence.recording
    assert recording is not None  # findings about limits need it
    if reading.transmission is not None or reading.degrees(recording.n).any():
        return None
    unit = np.where([joint.is_prismatic for joint in evidence.robot.joints], 1.0, np.pi / 180.0)
    offset = np.zeros(recording.n) if reading.joint_offset is None else np.asarray(reading.joint_offset)

    def scaled(values: Array | None) -> Array | None:
        return None if values is None else values * unit

    def moved(positions: Array) -> Array:
        return (positions - offset) * unit + offset

    command = None if recording.command is None else moved(recording.command)
    again = replace(
        recording, q=moved(recording.q), dq=scaled(recording.dq), ddq=scaled(recording.ddq), command=command
    )
    return replace(evidence, recording=again, reading=replace(reading, units="deg"))


def turns_too_far(evidence: LogEvidence) -> bool:
    """True if most joints move over several times the range of their limits."""
    recording = evidence.recording
    assert recording is not None  # findings about limits need it
    span = np.array([high - low for low, high in (joint.position_limits for joint in evidence.robot.joints)])
    known = np.isfinite(span) & (span > 0.0)
    moved = np.ptp(recording.q, axis=0)
    return bool(known.any() and np.median(moved[known] / span[known]) > GEARED)


def _explains_torque(evidence: LogEvidence) -> bool:
    """True if torque and positions agree in the log as it is read, or after faults of single joints are corrected."""
    if evidence.state is None or _agrees(evidence.state):
        return evidence.state is not None
    of_all_joints = any(each.channel in ("q", "effort") for each in evidence.explanations)
    return not of_all_joints and evidence.corrected is not None and _agrees(evidence.corrected)


def _agrees(state: LogState) -> bool:
    """True if the torque agrees with the description, or if the torques of the joints agree with each other."""
    if state.nominal is not None:
        loaded = int(np.argmax(state.nominal.size))
        alike = abs(float(state.nominal.correlation[loaded])) > PLAUSIBLE_CORRELATION
        return alike and abs(float(state.nominal.scale[loaded])) > PLAUSIBLE_SCALE
    return state.conflict < PLAUSIBLE_CONFLICT

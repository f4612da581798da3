"""Weak excitation: parameters that the motion cannot separate, and joints that should move more."""

from __future__ import annotations

from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import products
from armid.errors import Finding
from armid.maths.linalg import scaled_condition
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RotorInertia
from armid.robot import Robot

WEAK_CONDITION = 100.0
"""Condition number, with columns of unit length, above which an estimate may fail on other motion. Good recordings
have 8 to 42; recordings whose estimates fail on other motion have 200 or more."""

POOR_CONDITION = 500.0
"""Condition number from which the finding is a warning; random motions of all joints have up to 400."""

COMPUTED = 1e7
"""Condition number above which its value is dominated by rounding errors, because products of columns square it."""

ORDINARY = 8.0
"""Largest condition number of random states of ordinary arms, with columns of unit length (4 to 8). If the axes of
joints nearly pass through each other's links at odd angles, it can be 90, whatever the motion; the limits above are
increased in proportion."""

STATES = 1000
"""Number of random states; the condition number of different draws differs by a tenth."""

TIMID = 0.25
"""Share of the velocity limits. If no joint reaches it, the motion is too slow to separate inertia from friction."""

NAMED = 4

LITTLE = 0.35
"""Share of the position range or of the velocity limit of a joint below which the joint should move more."""


MUCH = 0.2
"""Share of samples that are left out from which they, and not the length of a log, are named as what is wrong."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the parameters that are hardest to separate, in one finding."""
    state = evidence.corrected
    if state is None:
        return _too_short(evidence)
    model = evidence.model
    if model is None:
        model = DynamicsModel(evidence.robot, tuple(t for t in state.model.terms if not isinstance(t, RotorInertia)))
    if model.nodes:
        return []
    study_state = state
    if model.robot is not state.model.robot or model.terms != state.model.terms:
        study_state = LogState(model, find_base_parameters(model), state.log)
    names, rows = study_state.base.names, study_state.rows
    G = np.zeros((rows.count, rows.count))
    for j, P in enumerate(products(rows)):
        G[np.ix_(rows.parameters[j], rows.parameters[j])] += P[:-1, :-1]
    scale = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    powers, directions = np.linalg.eigh(G / np.outer(scale, scale))
    condition = float(np.sqrt(powers[-1] / max(powers[0], 1e-18 * powers[-1])))
    motion = study_state.rows.motion
    if condition <= WEAK_CONDITION:
        return []
    factor = limit_factor(study_state.model, motion)
    if condition <= WEAK_CONDITION * factor:
        return []
    return [
        Finding(
            "excitation-weak",
            excitation_severity(condition / factor, study_state.model.robot, np.abs(motion.dq).max(axis=0)),
            "",
            poorly_determined(names, directions[:, 0], condition, WEAK_CONDITION * factor),
            _advice(study_state),
        )
    ]


def limit_factor(model: DynamicsModel, motion: Motion) -> float:
    """Factor of the limits of the condition number for an arm whose parameters no motion separates well.

    It is the condition number of random poses within the joint limits, with random velocities and accelerations of
    the same size as those of the motion, divided by that of ordinary arms; at least one.

    Args:
        model: Arm and torque terms, without hysteresis.
        motion: The motion.
    """
    rng = np.random.default_rng(0)
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -np.pi)
    high = np.minimum(np.where(np.isfinite(limits[:, 1]), limits[:, 1], np.pi), low + 2.0 * np.pi)
    q = rng.uniform(low, high, (STATES, model.n))
    dq, ddq = (rng.normal(size=q.shape) * np.sqrt(np.mean(x**2, axis=0)) for x in (motion.dq, motion.ddq))
    columns = model.regressor(Motion(np.arange(float(STATES)), q, dq, ddq))[:, :, find_base_parameters(model).kept]
    return max(1.0, scaled_condition(columns.reshape(-1, columns.shape[2])) / ORDINARY)


def poorly_determined(
    names: tuple[str, ...], direction: Array, condition: float, limit: float = WEAK_CONDITION
) -> str:
    """Sentence on a condition number, with the largest parameters in the weakest direction (b,)."""
    worst = ", ".join(names[k] for k in np.argsort(-np.abs(direction))[:NAMED])
    if condition > COMPUTED:
        return f"The motion does not separate {worst} at all, within numerical precision."
    return (
        f"The motion hardly separates {worst} (condition number {condition:.0f} with columns of unit length; above "
        f"{limit:.0f} an estimate may fail on other motion)."
    )


def _too_short(evidence: LogEvidence) -> list[Finding]:
    """Finding for a log that is too short for a model."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    unchecked = "signs, order, zeros, gravity and delays were not checked."
    length = f"{recording.samples} samples, {recording.samples / evidence.rate:.3g} s,"
    text = f"The log of {length} is too short to fit a model; {unchecked}"
    remedy = "record a longer motion, at a sample rate of 20 Hz or more"
    left_out = int((~evidence.counted.valid).any(axis=1).sum())
    if left_out > MUCH * recording.samples:
        text = (
            f"{left_out} of {length} are left out for one joint or more, because they are excluded, repeated, stuck "
            "or saturated. A filter needs long stretches without gaps, and the remaining rows are too few to fit a "
            f"model; {unchecked}"
        )
        remedy = (
            "record again without the disturbances for which these samples are excluded, or correct the key `exclude`"
        )
    return [Finding("excitation-weak", "warning", "", text, remedy)]


def excitation_severity(condition: float, robot: Robot, fastest: Array) -> Literal["warning", "info"]:
    """Severity of a weak excitation: a warning above `POOR_CONDITION` or if all joints are slow.

    Args:
        condition: Condition number with columns of unit length, divided by `limit_factor`.
        robot: The arm.
        fastest: Largest speed of each joint, shape (n,) [rad/s or m/s].
    """
    limits = np.array([joint.velocity_limit for joint in robot.joints])
    known = np.isfinite(limits) & (limits > 0.0)
    timid = bool(known.all() and (fastest < TIMID * limits).all())
    return "warning" if condition > POOR_CONDITION or timid else "info"


def _advice(state: LogState) -> str:
    """Remedy that names the joints that should move more."""
    motion, parts = state.rows.motion, []
    for j, joint in enumerate(state.model.robot.joints):
        low, high = joint.position_limits
        span, speed = float(np.ptp(motion.q[:, j])), float(np.abs(motion.dq[:, j]).max())
        room = min(high - low, 2 * np.pi) if np.isfinite(high - low) else 2 * np.pi
        narrow = span < LITTLE * room
        slow = 0.0 < joint.velocity_limit < np.inf and speed < LITTLE * joint.velocity_limit
        if narrow and slow:
            parts.append(f"{joint.name} wider than {span:.2g} and faster than {speed:.2g} {joint.unit}/s")
        elif narrow or slow:
            parts.append(
                f"{joint.name} {'wider than' if narrow else 'faster than'} "
                f"{span if narrow else speed:.2g} {joint.unit}{'' if narrow else '/s'}"
            )
    moves = "; ".join(parts) if parts else "all joints together, fast and wide"
    return f"record another motion, for instance one designed by armid excite; move {moves}"


CHECK = LogCheck(
    look=check,
    scope="command",
    effects={
        "excitation-weak": "Some parameters cannot be separated: the estimate fits this motion and "
        "may fail on others.",
    },
)

"""Check for weak excitation: parameters that the motion cannot separate, and joints that should move more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import products
from armid.errors import Finding
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RigidBody, RotorInertia
from armid.robot import Robot

WEAK_CONDITION = 100.0
"""Condition number, with columns of unit length, above which an estimate may fail on other motion. Good recordings
have 8 to 42; recordings whose estimates fail on other motion have 200 or more."""

POOR_CONDITION = 500.0
"""Condition number from which the finding is a warning; random motions of all joints have up to 400."""

COMPUTED = 1e7
"""Condition number above which its value is dominated by rounding errors, because products of columns square it."""

STATES = 1000
"""Number of random states from which the combinations of parameters are computed that an arm separates well."""

SPEED, ACCELERATION = 1.5, 3.0
"""Standard deviations of velocities [rad/s or m/s] and accelerations [rad/s² or m/s²] of the random states."""

TIMID = 0.25
"""Share of the velocity limits. If no joint reaches it, the motion is too slow to separate inertia from friction."""

NAMED = 4

LITTLE = 0.35
"""Share of the position range or of the velocity limit of a joint below which the joint should move more."""


MUCH = 0.2
"""Share of left-out samples from which a finding names the left-out samples, and not the length of the log, as the
reason why too few rows remain."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the parameters that the motion separates worst from each other, in one finding."""
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
    condition, weakest = _condition(G)
    if condition <= WEAK_CONDITION:
        return []
    change = separable_combinations(study_state.model, study_state.base, names)
    condition = min(condition, _condition(change.T @ G @ change)[0])
    if condition <= WEAK_CONDITION:
        return []
    motion = study_state.rows.motion
    return [
        Finding(
            "excitation-weak",
            excitation_severity(condition, study_state.model.robot, np.abs(motion.dq).max(axis=0)),
            "",
            poorly_determined(names, weakest, condition),
            _advice(study_state),
        )
    ]


def _condition(gram: Array) -> tuple[float, Array]:
    """Condition number and weakest direction (b,) of columns scaled to unit length.

    Args:
        gram: Scalar products of the columns, shape (b, b).
    """
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    powers, directions = np.linalg.eigh(gram / np.outer(scale, scale))
    return float(np.sqrt(powers[-1] / max(powers[0], 1e-18 * powers[-1]))), directions[:, 0]


def separable_combinations(model: DynamicsModel, base: BaseParameters, names: Sequence[str]) -> Array:
    """Combinations of the columns of base parameters that random states of the arm separate well.

    The condition number of a motion depends on the choice of the base parameters. If link frames have odd angles, or
    if axes nearly meet, some base parameters are hard to separate with any motion, although the torque is determined
    well. Combinations of the inertial columns that are orthonormal at random states do not depend on the choice of
    the base parameters.

    Args:
        model: Arm and torque terms, without hysteresis.
        base: Base parameters of the model.
        names: Names of the columns, which may contain copies of friction parameters, b in number.

    Returns:
        Matrix C, shape (b, b): the columns X become X C.
    """
    change = np.eye(len(names))
    own = np.flatnonzero(np.isin(base.kept, model.inertial_columns))
    if not len(own):
        return change
    rng = np.random.default_rng(0)
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    bounded = np.isfinite(limits).all(axis=1)
    low = np.where(bounded, limits[:, 0], -np.pi)
    high = np.where(bounded, np.minimum(limits[:, 1], low + 2.0 * np.pi), np.pi)
    q = rng.uniform(low, high, (STATES, model.n))
    motion = Motion.of_states(q, SPEED * rng.normal(size=q.shape), ACCELERATION * rng.normal(size=q.shape))
    columns = DynamicsModel(model.robot, (RigidBody(),)).regressor(motion)
    kept = np.searchsorted(model.inertial_columns, base.kept[own])
    triangle = np.linalg.qr(columns.reshape(-1, columns.shape[2])[:, kept], mode="r")
    at = np.array([list(names).index(base.names[k]) for k in own], dtype=np.intp)
    change[np.ix_(at, at)] = np.linalg.inv(triangle)
    return change


def poorly_determined(names: tuple[str, ...], direction: Array, condition: float) -> str:
    """Sentence that states a condition number and names the parameters that the motion separates worst.

    Args:
        names: Names of the base parameters, b in number.
        direction: Combination of parameters that the motion determines worst, shape (b,).
        condition: Condition number, with columns of unit length.
    """
    worst = ", ".join(names[k] for k in np.argsort(-np.abs(direction))[:NAMED])
    if condition > COMPUTED:
        return f"The motion does not separate {worst} at all, within numerical precision."
    return (
        f"The motion hardly separates {worst} (condition number {condition:.0f} with columns of unit length; above "
        f"{WEAK_CONDITION:.0f} an estimate may fail on other motion)."
    )


def _too_short(evidence: LogEvidence) -> list[Finding]:
    """Finding that a log has too few rows for the fit of a model."""
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
            "or saturated. A filter needs long segments without gaps, and the remaining rows are too few to fit a "
            f"model; {unchecked}"
        )
        remedy = (
            "record again without the disturbances for which these samples are excluded, or correct the key `exclude`"
        )
    return [Finding("excitation-weak", "warning", "", text, remedy)]


def excitation_severity(condition: float, robot: Robot, fastest: Array) -> Literal["warning", "info"]:
    """Severity of the finding about weak excitation: a warning above `POOR_CONDITION` or if all joints are slow.

    Args:
        condition: Condition number with columns of unit length.
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
                f"{joint.name} {'wider than' if narrow else 'faster than'} {span if narrow else speed:.2g} "
                f"{joint.unit}{'' if narrow else '/s'}"
            )
    moves = "; ".join(parts) if parts else "all joints together, fast and wide"
    return f"record another motion, for instance one designed by armid excite; move {moves}"


CHECK = LogCheck(
    look=check,
    scope="command",
    effects={
        "excitation-weak": "Some parameters cannot be separated: the estimate fits this motion and "
        "may fail on other motions.",
    },
)

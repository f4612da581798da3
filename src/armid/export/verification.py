"""Verification of a file: armid and other programs read it, and their torques are compared with the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import Finding, OutputError
from armid.estimation.estimate_record import torque_parameters
from armid.export.catalogue import EXPORTERS, Exporter
from armid.export.input_digest_check import Unseen
from armid.export.types import Content, Witness, WrittenDescription
from armid.information.residuals import compare
from armid.model.dynamics_model import DynamicsModel
from armid.robot.angle_rounding import rounded
from armid.robot.robot import Robot
from armid.runs.run import Run
from armid.study.recordings.processed import judged_without_memory, process_each
from armid.validation.torque_validation import Check, JointCheck

STATES = 50
"""Number of random states at which torques are compared."""

SPEED, ACCELERATION = 2.0, 4.0
"""Bounds of the velocities [rad/s or m/s] and accelerations [rad/s² or m/s²] of the random states. With these
bounds, torques by gravity, velocities and accelerations have a similar size."""

REACH = np.pi
"""Bound of the position of a joint without limits [rad or m]."""

TORQUE = 1e-9
"""Largest allowed difference of torques, divided by the largest torque. Programs that transform tensors to principal
axes lose about 1e-13; numbers with seventeen digits are exact."""

PREDICTED = 1e-6
"""Largest allowed relative difference of predictions on validation motion."""

ROUNDED = 1e-3
"""Largest allowed relative difference of predictions if angles of the description were corrected: bodies on locked
joints are then rotated by up to 1e-4 rad."""


@dataclass(frozen=True, eq=False, slots=True)
class Prediction:
    """RMS torque error on one validation recording, for each joint, shape (n,) [N·m or N].

    Attributes:
        path: Path of the recording.
        estimate: Error of the estimate of the run.
        file: Error of the model in the file.
    """

    path: str
    estimate: Array
    file: Array


@dataclass(frozen=True, eq=False, slots=True)
class Verified:
    """Result of the verification of a file.

    Attributes:
        checks: Checks of the file; all were passed.
        predictions: Torque errors on validation motion.
        findings: Findings about checks that were not possible, and about consequences of the format.
    """

    checks: tuple[Check, ...]
    predictions: tuple[Prediction, ...]
    findings: tuple[Finding, ...]


def verify(
    exporter: Exporter,
    written: WrittenDescription,
    content: Content,
    run: Run,
    theta: Array,
    unseen: Unseen,
    *,
    unphysical: bool = False,
) -> Verified:
    """Reads a file back and compares its model with the identified model.

    Args:
        exporter: Exporter of the format of the file.
        written: The written file.
        content: Content that the file should have.
        run: The run.
        theta: Standard parameters that were written, shape (p,).
        unseen: Validation recordings of the run.
        unphysical: True if the values are physically inconsistent; then other programs may reject the file.

    Raises:
        OutputError: The model in the file differs from the identified model, or another program rejects the file.
    """
    raw = exporter.read(written.data, content.locked)
    robot = _in_order(_held(raw, content), content.robot)
    checks, findings = _torques(exporter, written, content, robot, unphysical)
    findings += [Finding("unseen-missing", "info", "", text) for text in unseen.missing]
    snapped = _in_order(_held(rounded(raw)[0], content), content.robot)
    predictions, prediction_checks = _predictions(run, snapped, theta, unseen)
    checks += prediction_checks
    findings += _rounding(content, robot)
    if not np.allclose(raw.gravity, content.robot.gravity):
        of_run, of_file = (", ".join(f"{x:g}" for x in gravity) for gravity in (content.robot.gravity, raw.gravity))
        what = (
            f"gravity in the base frame is ({of_run}) in the run, but ({of_file}) in a simulator that loads the file"
        )
        findings.append(
            Finding("gravity-differs", "info", "", what, "mount the arm in the simulator as the real arm is mounted")
        )
    for check in checks:
        if not check.ok:
            raise OutputError(
                f"The written file differs from the identified model: {check.name}, relative difference "
                f"{check.value:.2g}, at most {check.bound:g} allowed. Nothing was written.",
                remedy="search the description for settings that change inertias, or choose another format with "
                "--to.",
            )
    return Verified(tuple(checks), tuple(predictions), tuple(findings))


def _held(raw: Robot, content: Content) -> Robot:
    """Arm of a file after its joints are locked as in the run, and with the gravity of the run."""
    held = {name: value for name, value in content.locked.items() if name in raw.joint_names}
    return raw.lock(held).with_gravity(content.robot.gravity)


def _in_order(robot: Robot, like: Robot) -> Robot:
    """Arm with its joints in the order of the joints of another arm."""
    if robot.joint_names == like.joint_names:
        return robot
    if sorted(robot.joint_names) != sorted(like.joint_names):
        raise OutputError(
            f"The written file has other joints than the run: {', '.join(robot.joint_names)}.",
            remedy="report this: the description contains an element that armid does not write correctly.",
        )
    order = [robot.joint_index(name) for name in like.joint_names]
    joints = [robot.joints[k] for k in order]
    joints = [replace(j, parent=order.index(j.parent) if j.parent >= 0 else -1) for j in joints]
    tip = replace(robot.tip, parent=order.index(robot.tip.parent) if robot.tip.parent >= 0 else -1)
    return replace(robot, joints=tuple(joints), links=tuple(robot.links[k] for k in order), tip=tip)


def _torques(
    exporter: Exporter, written: WrittenDescription, content: Content, robot: Robot, unphysical: bool
) -> tuple[list[Check], list[Finding]]:
    """Compares the model with rigid-body torques and joint parameters that several programs read from the file."""
    q, dq, ddq = _states(content.robot)
    expected = _inverse_dynamics(robot, _inertial(content.robot), q, dq, ddq)
    largest = float(np.abs(expected).max()) or 1.0
    torque = _inverse_dynamics(robot, _inertial(robot), q, dq, ddq)
    checks = [_check("rigid-body torque read by armid", torque, expected, largest)]
    findings: list[Finding] = []
    for witness in exporter.witnesses(written.data, content, q, dq, ddq):
        if witness.torque is None:
            if not witness.is_absent and not unphysical:
                _refuse_broken(exporter, content, witness)
            findings.append(Finding("not-checked", "info", witness.name, witness.reason))
        else:
            checks.append(_check(f"rigid-body torque in {witness.name}", witness.torque, expected, largest))
        for joint, values in witness.joints.items():
            for term, value in content.joints.get(joint, {}).items():
                if term in values:
                    name = f"{term} of {joint} in {witness.name}"
                    error = abs(values[term] - value) / max(abs(value), 1.0)
                    checks.append(JointCheck(name, error, TORQUE, error <= TORQUE))
    return checks, findings


def _refuse_broken(exporter: Exporter, content: Content, witness: Witness) -> None:
    """Raises an error if another program rejects the file although the same program accepts the description."""
    q = np.zeros((1, content.robot.n))
    before = [] if content.source is None else exporter.witnesses(content.source.data, content, q, q, q)
    if not any(each.name == witness.name and each.torque is None for each in before):
        raise OutputError(
            f"{witness.name} rejects the file that would be written: {witness.reason} Nothing was written.",
            remedy="choose another format with --to.",
        )


def _check(name: str, actual: Array, expected: Array, largest: float) -> Check:
    error = float(np.abs(actual - expected).max()) / largest
    return Check(name, error, TORQUE, error <= TORQUE)


def _states(robot: Robot) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations, (N, n) each, of random states within the limits of the joints."""
    rng = np.random.default_rng(0)
    limits = np.array([joint.position_limits for joint in robot.joints])
    low, high = np.maximum(limits[:, 0], -REACH), np.minimum(limits[:, 1], REACH)
    return (
        rng.uniform(np.minimum(low, high), high, (STATES, robot.n)),
        rng.uniform(-SPEED, SPEED, (STATES, robot.n)),
        rng.uniform(-ACCELERATION, ACCELERATION, (STATES, robot.n)),
    )


def _inertial(robot: Robot) -> Array:
    """Inertial parameters of the links of an arm, shape (n, 10)."""
    vector = robot.inertial_vector
    return np.zeros((robot.n, 10)) if vector is None else vector


def _inverse_dynamics(robot: Robot, inertial: Array, q: Array, dq: Array, ddq: Array) -> Array:
    return kernel.inverse_dynamics(robot.tree, inertial, q, dq, ddq)


def _rounding(content: Content, robot: Robot) -> list[Finding]:
    """Finding that states the change of the torque if the run has corrected rounded angles; empty if it has not."""
    q, dq, ddq = _states(content.robot)
    exact = _inverse_dynamics(content.robot, _inertial(content.robot), q, dq, ddq)
    as_written = _inverse_dynamics(robot, _inertial(content.robot), q, dq, ddq)
    error = float(np.abs(exact - as_written).max()) / (float(np.abs(exact).max()) or 1.0)
    if error <= TORQUE:
        return []
    what = (
        "the run corrected rounded angles of the description, but the file keeps the rounded angles; the torque "
        f"changes by {error:.1g} of its largest value"
    )
    return [Finding("description-rounded", "info", "", what)]


def _predictions(run: Run, robot: Robot, theta: Array, unseen: Unseen) -> tuple[list[Prediction], list[Check]]:
    """Torque errors of the estimate and of the file on validation motion, and checks that the two errors agree."""
    from_file = theta.copy()
    from_file[run.model.inertial_columns] = _inertial(robot).ravel()
    model = DynamicsModel(robot, run.model.terms, run.model.load_parameters)
    estimated = torque_parameters(run.estimate.base, run.estimate.fit)
    bound = ROUNDED if any(f.code == "description-rounded" for f in run.robot.findings) else PREDICTED
    predictions: list[Prediction] = []
    checks: list[Check] = []
    for choice, recording in unseen.recordings:
        (processed,) = judged_without_memory(
            process_each([(choice, recording)], run.processing, run.robot), run.model
        )
        observations, band = processed.observations, processed.observations.band
        both = [
            (compare(run.model, estimated, o, band), compare(model, from_file, o, band)) for o in observations.runs
        ]
        mask = np.concatenate([a.mask for a, _ in both])
        mine = np.concatenate([a.predicted for a, _ in both])
        theirs = np.concatenate([b.predicted for _, b in both])
        measured = np.concatenate([a.measured for a, _ in both])
        predictions.append(Prediction(choice.path, _rms(measured - mine, mask), _rms(measured - theirs, mask)))
        error = float(np.linalg.norm(_rms(mine - theirs, mask)) / (np.linalg.norm(_rms(mine, mask)) or 1.0))
        checks.append(Check(f"torque on {choice.path}", error, bound, error <= bound))
    return predictions, checks


def _rms(values: Array, mask: Array | np.ndarray) -> Array:
    """Root mean square of each column over the rows in the mask; zero if the mask contains no rows."""
    counted = np.where(mask, values, 0.0)
    return np.sqrt(np.sum(counted**2, axis=0) / np.maximum(np.sum(mask, axis=0), 1))


def places_of(model: DynamicsModel, theta: Array) -> dict[str, dict[str, float]]:
    """Values of friction and rotor inertia that a format may store: for each joint, the value of each term."""
    stored_terms = {term for exporter in EXPORTERS.values() for term in exporter.PLACES}
    stored: dict[str, dict[str, float]] = {name: {} for name in model.robot.joint_names}
    for column, (term, law) in zip(model.law_columns, model.laws, strict=True):
        if term in stored_terms and law.coordinate == ((law.joint, 1.0),):
            stored[model.robot.joint_names[law.joint]][term] = float(theta[column])
    return stored


def without_place(model: DynamicsModel, places: Sequence[str]) -> Mapping[str, list[str]]:
    """Names of the parameters that a format cannot store; the keys are the names of the terms."""
    not_stored: dict[str, list[str]] = {}
    names = [parameter.name for parameter in model.parameters]
    for column, (term, law) in zip(model.law_columns, model.laws, strict=True):
        if term not in places or law.coordinate != ((law.joint, 1.0),):
            not_stored.setdefault(term, []).append(names[column])
    return not_stored

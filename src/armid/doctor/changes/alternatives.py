"""Possible changes within a recording, as regressor columns whose coefficients differ in one part of the recording.

A log is made by one arm with one set of conventions. If a joint's torque gets another gain, an encoder slips or a
payload is picked up, a part of the log has another torque than the model of the rest. Each `Alternative` states the
difference as columns of the regressor that are zero outside of this part.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.doctor.fitted_log import LogState
from armid.measurement.observations import ObservedRun
from armid.model.dynamics_model import DynamicsModel

Kind = Literal[
    "gain", "offset", "friction", "order", "zero", "scale", "payload", "gravity", "delay", "talk", "balance"
]

STEP = 1e-4
"""Displacement with which the derivative of the torque by a position is computed [rad or m]; the error of the
difference is then below 1e-8 of the torque."""


OF_ONE_TORQUE: tuple[Kind, ...] = ("gain", "offset", "friction", "delay", "balance")
"""Kinds that concern the torque of a joint alone if they concern one joint."""


@dataclass(frozen=True, eq=False, slots=True)
class Alternative:
    """Quantity that may differ between two parts of a log.

    Attributes:
        kind: What may differ: the gain, the offset, or the delay of torques; dry friction; the order of two torques;
            the share of another torque in a torque (`talk`); the zero of a position, or its zero and its scale; a
            payload; the direction of gravity; a torque that balances the weight at a joint (`balance`), which may
            change gradually only.
        joints: Indices of the joints concerned; all joints where the arm as a whole is concerned. For `talk`, the
            joint and the other one whose torque is added.
        columns: Torque of each joint for a unit of each coefficient, shape (e, M, n).
        frictional: For friction, the joint of each coefficient.
    """

    kind: Kind
    joints: tuple[int, ...]
    columns: Array
    frictional: tuple[int, ...] = ()

    @property
    def of_all(self) -> bool:
        """True if all joints are concerned."""
        return len(self.joints) == self.columns.shape[2]

    @property
    def of_torque(self) -> int | None:
        """Index of the joint whose torque alone is concerned; `None` if others are, too."""
        if self.kind == "talk" or (len(self.joints) == 1 and self.kind in OF_ONE_TORQUE):
            return self.joints[0]
        return None

    @property
    def concerned(self) -> NDArray[np.bool_]:
        """True for each coefficient and each joint whose torque it changes, shape (e, n)."""
        if self.of_torque is None and self.kind != "order":
            return np.asarray(self.columns.any(axis=1), dtype=np.bool_)
        result = np.zeros((len(self.columns), self.columns.shape[2]), dtype=np.bool_)
        result[:, list(self.joints) if self.of_torque is None else self.of_torque] = True
        return result


def alternatives_of(state: LogState) -> list[Alternative]:
    """Everything that may change within a log."""
    rows, n, joints = state.rows, state.rows.n, state.model.robot.joints
    every = tuple(range(n))
    found = [Alternative("offset", (j,), _alone(n, j, np.ones(len(rows.torque)))) for j in every]
    dry = [(j, column) for j in every for column in _dry_friction(state, j)]
    found += [Alternative("friction", (j,), _alone(n, j, column), (j,)) for j, column in dry]
    found += [Alternative("gain", (j,), _alone(n, j, rows.torque[:, j])) for j in every]
    found += [Alternative("balance", (j,), _balance(state, j)) for j in every if not joints[j].is_prismatic]
    if n > 1:
        found += [Alternative("gain", every, rows.torque[None].copy())]
        offsets = np.concatenate([_alone(n, j, np.ones(len(rows.torque))) for j in every])
        found.append(Alternative("offset", every, offsets))
        if len(dry) > 1:
            columns = np.concatenate([_alone(n, j, column) for j, column in dry])
            found.append(Alternative("friction", every, columns, tuple(j for j, _ in dry)))
    late, theta = -state.torque_slope(), state.standard(state.fit.values)
    found.append(Alternative("delay", every, late[None]))
    slopes = state.rigid_slopes(theta, STEP)
    found += [Alternative("zero", (j,), slopes[[j]]) for j in every]
    if n > 1:
        found += [Alternative("delay", (j,), _alone(n, j, late[:, j])) for j in every]
        found += [
            Alternative("talk", (j, k), _alone(n, j, rows.torque[:, k])) for j in every for k in every if j != k
        ]
    scales = _scales(state, theta)
    found += [Alternative("scale", (j,), np.stack([slopes[j], scales[j]])) for j in every]
    found.append(Alternative("payload", every, _payload(state)))
    found.append(Alternative("gravity", every, weights_by_axis(state)))
    found += _exchanges(rows.torque)
    return found


def _alone(n: int, j: int, column: Array) -> Array:
    """Column (M,) of joint j among n joints, shape (1, M, n)."""
    result = np.zeros((1, len(column), n))
    result[0, :, j] = column
    return result


def _balance(state: LogState, j: int) -> Array:
    """Torques of joint j that follow its angle as a weight does, or a balancer against it, shape (2, M, n)."""
    q = state.rows.motion.q[:, j]
    return np.concatenate([_alone(state.rows.n, j, np.sin(q)), _alone(state.rows.n, j, np.cos(q))])


def _dry_friction(state: LogState, j: int) -> Iterator[Array]:
    """Columns of the dry friction of joint j, shape (M,) each."""
    for symbol, column in zip(state.symbols(j), state.rows.columns[j], strict=True):
        if symbol == "FS":
            yield column


def _scales(state: LogState, theta: Array) -> Array:
    """Derivative of the torque by the relative scale of each position and of its derivatives, shape (n, M, n).

    It is computed at the rows without the filter of the log, which changes it little: the motion is inside the band.
    """
    rows, m = state.rows, state.rows.motion
    bodies = theta[state.model.inertial_columns].reshape(-1, 10)

    def torque(factor: Array) -> Array:
        return kernel.inverse_dynamics(state.model.tree, bodies, m.q * factor, m.dq * factor, m.ddq * factor)

    steps = 1.0 + STEP * np.eye(rows.n)
    return np.stack([torque(up) - torque(2.0 - up) for up in steps]) / (2.0 * STEP)


def _payload(state: LogState) -> Array:
    """Torque for a unit of mass and of each first moment that is added to the last link, shape (4, M, n)."""
    own = state.model.inertial_columns.reshape(-1, 10)[-1][:4]
    to_base = state.base.regrouping[:, own]
    each = zip(state.rows.parameters, state.rows.columns, strict=True)
    return np.stack([to_base[parameters].T @ x for parameters, x in each], axis=-1)


def weights_by_axis(state: LogState, bodies: Array | None = None) -> Array:
    """Torque of bodies for a unit of gravity along each axis of the base, shape (3, M, n).

    Args:
        state: The log.
        bodies: Inertial parameters of the bodies, shape (n, 10); if not given, those of the fitted links.
    """
    if bodies is None:
        bodies = state.standard(state.fit.values)[state.model.inertial_columns].reshape(-1, 10)
    trees = [DynamicsModel(state.model.robot.with_gravity(tuple(axis)), state.model.terms).tree for axis in np.eye(3)]

    def weights(run: ObservedRun) -> Array:
        q = run.motion.q
        still = np.zeros_like(q)
        return np.stack([kernel.inverse_dynamics(tree, bodies, q, still, still) for tree in trees], axis=1)

    return np.moveaxis(state.at_rows(weights), 1, 0)


def _exchanges(torque: Array) -> list[Alternative]:
    """Exchanges of the torques of two joints; the coefficient of a complete exchange is 1."""
    n = torque.shape[1]
    result: list[Alternative] = []
    for i in range(n):
        for j in range(i + 1, n):
            column = np.zeros((1, *torque.shape))
            column[0, :, i] = torque[:, j] - torque[:, i]
            column[0, :, j] = torque[:, i] - torque[:, j]
            result.append(Alternative("order", (i, j), column))
    return result

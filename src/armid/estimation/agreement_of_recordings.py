"""Agreement of one recording with the other recordings of the same arm, computed from their triangular factors.

Links are the same in all recordings; friction and offsets may differ. In a comparison of two sides, the recording is
one side and all other recordings together are the other side. In the common fit, the inertial parameters are common
to both sides, and each side has separate friction parameters. The weighted sum of squared residuals of the common fit
is compared with that of separate fits of the sides, and with that of a fit in which the torque of each joint j in the
recording has an unknown scale s_j,

    ρ_j = s_j R_j π + noise,

where R_j and ρ_j are the triangular factor and the right-hand side of the joint, and π the parameters. The scales are
computed with Levenberg-Marquardt steps, each of which solves a least-squares problem with the columns [s_j R_j, R_j
π]. The covariance of the scales is computed with the jackknife from the factors of the blocks with these columns; it
is valid for correlated residuals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.uncertainty.covariance_choice_thresholds import (
    FEWEST_BLOCKS,
    MAX_NEIGHBOUR_CORRELATION,
    MIN_MERGED_BLOCKS,
)
from armid.estimation.uncertainty.jackknife import Groups, correlation, group_blocks, jackknife
from armid.information.information import Information, JointFactors, select, stack, total
from armid.kernel import factor_columns
from armid.maths.linalg import unit_columns
from armid.model.parameter_name import ParameterName

STEPS = 60
"""Largest number of Levenberg-Marquardt steps."""

DAMPING = (1e-4, 1e4)
"""Initial and largest damping factor of the Levenberg-Marquardt steps, for columns of unit length."""

CONVERGED = 1e-6
"""Relative decrease of the cost in one step below which the iteration ends."""

KNOWN = 1e-9
"""Limit of the ratio of a singular value to the largest one, for columns of unit length: the data determine the
direction of the singular value if the ratio is above this limit. Also the smallest ratio of squared noise to squared
torque."""

CORRELATED = 4.0
"""Smallest number of consecutive rows that count as one independent sample; the test of payloads uses the same
value."""


@dataclass(frozen=True, eq=False, slots=True)
class Agreement:
    """Comparison of one recording with all others: residuals with common and with separate inertial parameters.

    Attributes:
        recording: Number of the recording.
        sides: Information with separate friction parameters for the two sides; block 0 contains the other recordings,
            block 1 this recording.
        values: Parameters of the common fit, shape (b,).
        weights: Weight of the rows of each joint, one divided by the standard deviation of its noise, shape (n,).
        common: RMS residual of the recording in the common fit, shape (n,) [N·m or N].
        alone: RMS residual of the recording if it is fitted alone, shape (n,) [N·m or N].
        torque: RMS torque of the recording, shape (n,) [N·m or N].
        cost: Weighted sum of squared residuals of both sides in the common fit.
        separate: Weighted sum of squared residuals of both sides if each side is fitted alone.
    """

    recording: int
    sides: Information
    values: Array
    weights: Array
    common: Array
    alone: Array
    torque: Array
    cost: float
    separate: float

    @property
    def excess(self) -> float:
        """Weighted RMS residual of all joints in the common fit, divided by that of the recording fitted alone."""
        alone = float(np.linalg.norm(self.weights * self.alone))
        return float(np.linalg.norm(self.weights * self.common)) / max(alone, np.finfo(float).tiny)

    @property
    def relative(self) -> float:
        """RMS residual of all joints in the common fit, divided by the RMS torque of the recording."""
        torque = float(np.linalg.norm(self.torque))
        return float(np.linalg.norm(self.common)) / max(torque, np.finfo(float).tiny)

    @property
    def expected(self) -> float:
        """Largest `cost` - `separate` that correlated noise can cause: its mean plus five standard deviations."""
        parameters = 2 * self.sides.count
        return CORRELATED * (parameters + 5.0 * np.sqrt(2.0 * parameters))


@dataclass(frozen=True, eq=False, slots=True)
class TorqueScales:
    """Scale of the torque of each joint in a recording, relative to the model that fits the other recordings.

    Attributes:
        scale: Scale of each joint, shape (n,).
        values: Parameters of the fit with these scales, shape (b,).
        cost: Weighted sum of squared residuals of both sides.
        squares: Sum of squared residuals of both sides, shape (n,) [(N·m)² or N²].
        residual: RMS residual of the recording, shape (n,) [N·m or N].
    """

    scale: Array
    values: Array
    cost: float
    squares: Array
    residual: Array


def compare_recordings(information: Information, own: NDArray[np.bool_]) -> tuple[Agreement, ...]:
    """Compares each recording with all other recordings; the result is empty if there is only one recording.

    Args:
        information: Factors of the recordings.
        own: Mask of the parameters that may differ between recordings, such as friction, shape (b,).
    """
    used = information.rows.any(axis=1)
    numbers = np.unique(information.recording[used])
    if len(numbers) < 2:
        return ()
    each = {int(r): total(select(information, used & (information.recording == r))) for r in numbers}
    weights = _weights(list(each.values()))
    return tuple(
        _compare(total(select(information, used & (information.recording != r))), part, r, own, weights)
        for r, part in each.items()
    )


def torque_scales(agreement: Agreement) -> TorqueScales:
    """Computes the torque scale of each joint with which a recording agrees best with the other recordings."""
    sides, weights = agreement.sides, agreement.weights
    opposite = -np.ones(sides.n)
    starts = [
        (agreement.values, np.ones(sides.n)),
        (_solve(_scaled(sides, opposite), weights), opposite),
        _first_scales(sides, agreement, weights),
    ]
    cost, values, scale = min(
        ((_cost(sides, values, scale, weights), values, scale) for values, scale in starts), key=lambda each: each[0]
    )
    damping = DAMPING[0]
    for _ in range(STEPS):
        A, y = stack(total(_linearised(sides, values, scale)), weights)
        at = np.concatenate([values, scale])
        tried = at + _damped_step(A, y - A @ at, damping)
        new = _cost(sides, tried[: sides.count], tried[sides.count :], weights)
        if not new < cost:
            damping *= 10.0
            if damping > DAMPING[1]:
                break
            continue
        converged = cost - new <= CONVERGED * new
        cost, values, scale = new, tried[: sides.count], tried[sides.count :]
        damping = max(damping / 10.0, KNOWN)
        if converged:
            break
    squares = _squares(sides, values, scale)
    residual = np.sqrt(squares[1] / np.maximum(sides.rows[1], 1))
    return TorqueScales(scale, values, cost, squares.sum(axis=0), residual)


def scale_deviations(
    information: Information, own: NDArray[np.bool_], agreement: Agreement, scales: TorqueScales
) -> Array:
    """Standard deviations of the torque scales of one recording, shape (n,); infinite for undetermined scales.

    Args:
        information: Factors of all recordings, block by block.
        own: Mask of the parameters that may differ between recordings, shape (b,).
        agreement: Comparison of the recording.
        scales: Torque scales of this recording.
    """
    here = (information.recording == agreement.recording).astype(np.int64)
    blocks = separate_by_recording(replace(information, recording=here), own)
    wide = _linearised(blocks, scales.values, scales.scale)
    A, _ = stack(total(wide), agreement.weights)
    unit, length = unit_columns(A)
    _, size, Vt = np.linalg.svd(unit, full_matrices=False)
    kept = size > KNOWN * size[0]
    half = Vt[kept].T / size[kept]
    inverse = half @ half.T / np.outer(length, length)
    undetermined = np.sum(Vt[~kept][:, blocks.count :] ** 2, axis=0) > KNOWN
    rows = information.rows.sum(axis=0)
    noise = agreement.weights**2 * scales.squares / np.maximum(rows, 1)
    variance = CORRELATED * np.maximum(noise, 1.0) * np.diag(inverse)[blocks.count :]
    at = np.concatenate([scales.values, scales.scale])
    if kept.all() and (groups := _groups(wide, at, agreement.weights, inverse)) is not None:
        scatter = jackknife(wide, groups, np.zeros(groups.max() + 1, np.int64), at, agreement.weights, inverse)
        variance = np.maximum(variance, np.diag(scatter)[blocks.count :])
    return np.where(undetermined, np.inf, np.sqrt(variance))


def _groups(wide: Information, values: Array, weights: Array, inverse: Array) -> Groups | None:
    """Group of neighbouring blocks to which each block belongs, shape (blocks,), for the jackknife.

    The groups are enlarged until they are uncorrelated or only few remain. The result is `None` if the recording has
    fewer than `FEWEST_BLOCKS` groups, since the jackknife leaves out one group at a time.

    Args:
        wide: Information about parameters and torque scales, block by block.
        values: Parameters and scales.
        weights: Weight of the rows of each joint, shape (n,).
        inverse: Inverse of the weighted normal matrix.
    """
    own = wide.recording == 1
    per_group, groups = 1, group_blocks(wide)
    while np.unique(groups[own]).size // 2 >= MIN_MERGED_BLOCKS:
        if correlation(wide, groups, values, weights, inverse) <= MAX_NEIGHBOUR_CORRELATION:
            break
        per_group *= 2
        groups = group_blocks(wide, per_group)
    return groups if np.unique(groups[own]).size >= FEWEST_BLOCKS else None


def _compare(rest: Information, part: Information, number: int, own: NDArray[np.bool_], weights: Array) -> Agreement:
    """Computes the common fit of a recording and all other recordings, and the separate fits of the two sides.

    Args:
        rest: Factors of all other recordings, merged into one block.
        part: Factors of the recording, merged into one block.
        number: Number of the recording.
        own: Mask of the parameters that may differ between recordings, shape (b,).
        weights: Weight of the rows of each joint, shape (n,).
    """
    sides = separate_by_recording(_side_by_side(rest, part), own)
    values = _solve(sides, weights)
    common = held_out_squares(select(sides, np.array([1])), values)
    squares, spent = _alone(part, weights)
    separate = weights**2 @ (squares + _alone(rest, weights)[0])
    rows = part.rows.sum(axis=0)
    return Agreement(
        number,
        sides,
        values,
        weights,
        np.sqrt(common / np.maximum(rows, 1)),
        np.sqrt(squares / np.maximum(rows - spent, 1.0)),
        np.sqrt(_squared_torque(part) / np.maximum(rows, 1)),
        float(weights**2 @ held_out_squares(sides, values)),
        float(separate),
    )


def _side_by_side(rest: Information, part: Information) -> Information:
    """Information with the other recordings as block 0 and this recording as block 1."""
    joints = tuple(
        JointFactors(a.parameters, np.concatenate([a.R, b.R])) for a, b in zip(rest.joints, part.joints, strict=True)
    )
    rows = np.concatenate([rest.rows, part.rows])
    return replace(rest, joints=joints, rows=rows, run=np.arange(2), recording=np.arange(2))


def _weights(parts: list[Information]) -> Array:
    """Weights of the joints, shape (n,), from the residuals of separate fits of the recordings."""
    torque = np.sum([_squared_torque(part) for part in parts], axis=0)
    rows = np.maximum(np.sum([part.rows.sum(axis=0) for part in parts], axis=0), 1)
    first = 1.0 / np.sqrt(np.where(torque > 0.0, torque / rows, 1.0))
    squares, free = np.zeros(parts[0].n), np.zeros(parts[0].n)
    for part in parts:
        of_part, spent = _alone(part, first)
        squares += of_part
        free += np.maximum(part.rows.sum(axis=0) - spent, 1.0)
    noise = np.sqrt(np.maximum(squares / free, KNOWN * torque / rows))
    return 1.0 / np.where(noise > 0.0, noise, 1.0)


def _squared_torque(part: Information) -> Array:
    """Sum of the squared torque of each joint, shape (n,) [(N·m)² or N²]."""
    return np.array([np.sum(joint.R[:, :, -1] ** 2) for joint in part.joints])


def _solve(information: Information, weights: Array) -> Array:
    """Weighted least-squares parameters of smallest norm, shape (b,); the data need not determine all of them."""
    A, y = stack(total(information), weights)
    unit, length = unit_columns(A)
    return np.linalg.lstsq(unit, y, rcond=KNOWN)[0] / length


def _damped_step(A: Array, residual: Array, damping: float) -> Array:
    """Damped least-squares step of the parameters: minimises |A step - residual|² plus a penalty on the step."""
    unit, length = unit_columns(A)
    b = len(length)
    penalty = np.sqrt(damping) * np.eye(b, b + 1)
    R = factor_columns(np.concatenate([np.column_stack([unit, residual]), penalty]).T)[0]
    return np.linalg.solve(R[:b, :b], R[:b, b]) / length


def _alone(part: Information, weights: Array) -> tuple[Array, Array]:
    """Sum of squared residuals and sum of leverages of each joint in a fit of `part` alone, shape (n,) each."""
    squares = held_out_squares(part, _solve(part, weights))
    A, _ = stack(total(part), weights)
    U, size, _ = np.linalg.svd(unit_columns(A)[0], full_matrices=False)
    leverage = np.sum(U[:, size > KNOWN * size[0]] ** 2, axis=1)
    ends = np.cumsum([joint.R.shape[2] for joint in part.joints])[:-1]
    return squares, np.array([float(of_joint.sum()) for of_joint in np.split(leverage, ends)])


def _first_scales(sides: Information, agreement: Agreement, weights: Array) -> tuple[Array, Array]:
    """Start values of the search: parameters from a fit of the other recordings, and the torque scales for them.

    A parameter that the other recordings do not determine is taken from the common fit.
    """
    alone = _solve(select(sides, np.array([0])), weights)
    values = np.where(alone != 0.0, alone, agreement.values)
    scale = np.ones(sides.n)
    for j, joint in enumerate(sides.joints):
        predicted = joint.R[1, :, :-1] @ values[joint.parameters]
        size = float(predicted @ predicted)
        scale[j] = predicted @ joint.R[1, :, -1] / size if size > 0.0 else 1.0
    return values, scale


def _scaled(sides: Information, scale: Array) -> Information:
    """Information of both sides, in which the regressor of the recording is multiplied by a factor for each joint."""
    joints: list[JointFactors] = []
    for joint, factor in zip(sides.joints, scale, strict=True):
        R = joint.R.copy()
        R[1, :, :-1] *= factor
        joints.append(JointFactors(joint.parameters, R))
    return replace(sides, joints=tuple(joints))


def _squares(sides: Information, values: Array, scale: Array) -> Array:
    """Sums of squared residuals of each joint, shape (2, n): of the other recordings, and of the scaled recording."""
    squares = np.empty((2, sides.n))
    for j, joint in enumerate(sides.joints):
        predicted = joint.R[:, :, :-1] @ values[joint.parameters]
        predicted[1] *= scale[j]
        squares[:, j] = np.sum((joint.R[:, :, -1] - predicted) ** 2, axis=1)
    return squares


def _cost(sides: Information, values: Array, scale: Array, weights: Array) -> float:
    return float(weights**2 @ _squares(sides, values, scale).sum(axis=0))


def _linearised(split: Information, values: Array, scale: Array) -> Information:
    """Triangular factors for parameters and torque scales as unknowns, linearised at given values of both.

    Args:
        split: Information of the two sides, or of their blocks; the scaled recording has the number 1.
        values: Parameters, shape (b,).
        scale: Torque scale of each joint, shape (n,).
    """
    names = (*split.names, *(ParameterName(f"scale_{j + 1}") for j in range(split.n)))
    of_recording = split.recording == 1
    joints: list[JointFactors] = []
    for j, joint in enumerate(split.joints):
        predicted = joint.R[:, :, :-1] @ values[joint.parameters] * of_recording[:, None]
        factor = np.where(of_recording, scale[j], 1.0)[:, None, None]
        side = joint.R[:, :, -1] + scale[j] * predicted
        wide = np.concatenate([joint.R[:, :, :-1] * factor, predicted[:, :, None], side[:, :, None]], axis=2)
        R = np.stack([factor_columns(np.ascontiguousarray(each.T))[0] for each in wide])
        joints.append(JointFactors(np.append(joint.parameters, split.count + j), R))
    return replace(split, names=names, joints=tuple(joints))

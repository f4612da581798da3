"""Links whose torque a log is compared with: the links of the description, or of an earlier run of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array

DESCRIPTION = "the description"
"""Name, for use in sentences, of the links that a log is compared with by default."""

CENTRE, RADIUS = 0.3, 0.2
"""Distance of the centre of mass of a usual load from the origin of the link that carries it [m], and radius of
gyration of the load [m]."""

SMALLEST_SCALE = 1e-6
"""Smallest ratio of the torque of the log to the torque of the links with which a load is estimated; below it, the
load is zero."""

AS_WELL = 0.02
"""Relative increase of the sum of squared residuals up to which a load alone explains a log as well as a load and
another scale of the torque."""

KEPT = 0.5
"""Smallest ratio of the torque of links and load to the torque of the links. A load with a smaller ratio cancels
most of the torque of the links and is not accepted."""

ROUNDS = 4
"""Number of times that load and scale of the torque are estimated, each time with the scale of the time before."""


@dataclass(frozen=True, eq=False, slots=True)
class KnownLinks:
    """Links of an earlier run, or of the description; in the log, the arm may carry an additional load.

    Attributes:
        bodies: Inertial parameters of the links, shape (n, 10).
        source: Name of the run, for use in sentences, or `DESCRIPTION`.
        loaded: Index of the link that may carry a load that `bodies` does not contain; `None` if no link may carry
            one.
    """

    bodies: Array
    source: str
    loaded: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", array(self.bodies, (None, 10), "bodies"))

    @property
    def of_run(self) -> bool:
        """True if the links are those of an earlier run."""
        return self.source != DESCRIPTION

    @property
    def usual_load(self) -> Array:
        """Standard deviations (10,) of the parameters of a load, for which a load as heavy as the arm is not unusual.

        If the links are known by base parameters only, their masses are unknown, and the first moments are used
        instead.
        """
        moments = float(np.linalg.norm(self.bodies[:, 1:4], axis=1).sum())
        mass = max(float(np.abs(self.bodies[:, 0]).sum()), moments / CENTRE, 1e-3)
        return mass * np.array([1.0, *[CENTRE] * 3, *[CENTRE**2 + RADIUS**2] * 6])


def torque_with_load(
    links: Array,
    load_columns: Sequence[Array],
    joint_columns: Sequence[Array],
    torque: Array,
    sigma: Array,
    usual: Array,
) -> Array:
    """Torque of the links together with the load that fits a log best, shape (M, n) [N·m or N].

    First, only a load is estimated; if it explains the log, the scale of the log's torque is right. Otherwise the
    scale is estimated together with the load, and small loads are preferred, so that an effort in another unit is not
    mistaken for a load. A load that would cancel most of the torque of the links is not accepted, because such a
    small effort has another scale.

    Args:
        links: Torque of the links without the load, shape (M, n).
        load_columns: Torque of each joint for a unit of each parameter of the load, n of shape (M, 10), zero in rows
            that are not used.
        joint_columns: Orthonormal columns of friction, offset and rotor inertia of each joint, n of shape (M, k).
        torque: Torque of the log, zero in rows that are not used, shape (M, n).
        sigma: Noise of each joint, shape (n,) [N·m or N].
        usual: Standard deviations of the parameters of a load, shape (10,).
    """
    P = np.zeros((12, 12))
    for j, (own, Q) in enumerate(zip(load_columns, joint_columns, strict=True)):
        A = np.column_stack([links[:, j], own * usual, torque[:, j]]) / sigma[j]
        A = A - Q @ (Q.T @ A)
        P += A.T @ A
    if P[0, 0] == 0.0:
        return links
    alone, (scale, of_scaled) = _load_alone(P), _load_and_scale(P)
    enough = _misfit(P, 1.0, alone) <= (1.0 + AS_WELL) * _misfit(P, scale, of_scaled)
    for load in (alone, of_scaled) if enough else (of_scaled,):
        total = np.append(1.0, load)
        if total @ P[:11, :11] @ total > KEPT**2 * P[0, 0]:
            return links + np.column_stack([own @ (load * usual) for own in load_columns])
    return links


def _load_alone(P: Array) -> Array:
    """Load (10,) that fits a log best if the torque of the log has the right scale.

    The unit of each element is the standard deviation for a usual load.

    Args:
        P: Scalar products of the torque of the links, of a unit of each of the ten load parameters, and of the log,
            shape (12, 12).
    """
    return np.array(np.linalg.solve(P[1:11, 1:11] + np.eye(10), P[1:11, 11] - P[1:11, 0]), dtype=np.float64)


def _load_and_scale(P: Array) -> tuple[float, Array]:
    """Ratio of the log's torque to the torque of links and load, and the load (10,).

    The unit of each element is the standard deviation for a usual load.

    Args:
        P: Scalar products of the torque of the links, of a unit of each of the ten load parameters, and of the log,
            shape (12, 12).
    """
    scale = float(P[0, 11] / P[0, 0])
    load = np.zeros(10)
    for _ in range(ROUNDS):
        size = max(abs(scale), SMALLEST_SCALE)
        prior = np.diag([0.0, *[1.0 / size**2] * 10])
        found = np.array(np.linalg.solve(P[:11, :11] + prior, P[:11, 11]), dtype=np.float64)
        scale = float(found[0])
        if abs(scale) < SMALLEST_SCALE:
            return scale, np.zeros(10)
        load = found[1:] / scale
    return scale, load


def _misfit(P: Array, scale: float, load: Array) -> float:
    """Sum of squared differences between the torque of the log and the torque of links and load, times a scale."""
    x = np.array([scale, *(scale * load), -1.0])
    return float(x @ P @ x)

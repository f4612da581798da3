"""Links whose torque a log is compared with: those of the description, or those of an earlier run of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array

DESCRIPTION = "the description"
"""Name in sentences of what a log is compared with by default."""

CENTRE, RADIUS = 0.3, 0.2
"""Distance of the centre of mass of a usual load from the origin of its link [m], and its radius of gyration [m]."""

SMALLEST_SCALE = 1e-6
"""Smallest scale of the torque relative to that of the links at which a load can be told from the links."""

AS_WELL = 0.02
"""Relative increase of the sum of squared residuals up to which a load alone explains a log as well as a load and
another scale of the torque."""

KEPT = 0.5
"""Share of the torque of the links that remains at least with a load; a load that cancels more is no load."""

ROUNDS = 4
"""Number of estimates of the load, each with the scale of the one before."""


@dataclass(frozen=True, eq=False, slots=True)
class KnownLinks:
    """Links that were identified in an earlier run; in the log, the arm may carry an additional load.

    Attributes:
        bodies: Inertial parameters of the links, shape (n, 10).
        source: Name of the run in sentences.
        loaded: Number of the link that may carry a load that the bodies do not contain; `None` if there is none.
    """

    bodies: Array
    source: str
    loaded: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", array(self.bodies, (None, 10), "bodies"))

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
    """Torque of the links with the load that explains a log best, shape (M, n) [N·m or N].

    If a load alone explains the log, the scale of the log's torque is right. Otherwise the scale is estimated, too,
    so that an effort in another unit is not mistaken for a load; small loads are then preferred. A load that would
    cancel most of the torque of the links is not accepted: an effort that is so small has another scale.

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
    """Load (10,) that explains a log whose torque has the right scale, in units of a usual load.

    Args:
        P: Products of the torque of links, usual load and log, shape (12, 12).
    """
    return np.array(np.linalg.solve(P[1:11, 1:11] + np.eye(10), P[1:11, 11] - P[1:11, 0]), dtype=np.float64)


def _load_and_scale(P: Array) -> tuple[float, Array]:
    """Scale of the log's torque, and the load (10,) in units of a usual load, which has the same scale.

    Args:
        P: Products of the torque of links, usual load and log, shape (12, 12).
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
    """Sum of the squared differences between the torque of the log and the torque with a scale and a load (10,)."""
    x = np.array([scale, *(scale * load), -1.0])
    return float(x @ P @ x)

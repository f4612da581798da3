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


@dataclass(frozen=True, eq=False, slots=True)
class KnownLinks:
    """Links that an earlier run has identified, which may now carry a load.

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
        """Standard deviations (10,) of the parameters of a load: one as heavy as the arm is not unusual."""
        mass = max(float(np.abs(self.bodies[:, 0]).sum()), 1e-3)
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

    The scale of the log's torque is an unknown, too, so that an effort in another unit is not taken for a load. A
    load of a usual size is preferred where the motion does not tell one from the other, as with one joint alone.

    Args:
        links: Torque of the links without the load, shape (M, n).
        load_columns: Torque of each joint for a unit of each parameter of the load, n of shape (M, 10), zero in rows
            that are not used.
        joint_columns: Orthonormal columns of friction, offset and rotor inertia of each joint, n of shape (M, k).
        torque: Torque of the log, zero in rows that are not used, shape (M, n).
        sigma: Noise of each joint, shape (n,) [N·m or N].
        usual: Standard deviations of the parameters of a load, shape (10,).
    """
    H, side = np.zeros((11, 11)), np.zeros(11)
    for j, (own, Q) in enumerate(zip(load_columns, joint_columns, strict=True)):
        A = np.column_stack([links[:, j], own * usual]) / sigma[j]
        A, y = A - Q @ (Q.T @ A), torque[:, j] / sigma[j]
        H, side = H + A.T @ A, side + A.T @ y
    prior = np.eye(11)
    scale, *load = np.linalg.solve(H + prior, side + prior[0])
    if abs(scale) < SMALLEST_SCALE:
        return links
    parameters = np.array(load) * usual / scale
    return links + np.column_stack([own @ parameters for own in load_columns])

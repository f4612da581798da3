"""Wrench at the tip from external joint torques, with its covariance and the directions that are not determined.

With the Jacobian J of the tip, a wrench w causes the external joint torques r = Jᵀ w + e, where e has the covariance
of the residuals. A direction of the wrench counts as not determined if its standard deviation is too large, for
instance near a singular pose or with fewer than six joints. The estimate has no component in such directions, and
they are reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.robot.kinematics import forward_kinematics, frame_pose, longest_reach
from armid.robot.robot import Robot

SINGULAR = 30.0
"""Ratio of the standard deviation of a direction of the wrench to the smallest one, from which the direction counts
as not determined. On the iiwa 14, Panda and UR10e in random poses, the ratio of the largest to the smallest standard
deviation is 5 to 20 in the middle half of the poses."""

LENGTH_SHARE = 0.25
"""Length by which moments are divided for a comparison with forces, relative to the reach of the arm: a typical lever
arm."""

NAMES = ("FX", "FY", "FZ", "MX", "MY", "MZ")
"""Names of the components of a wrench: force [N] and moment [N·m] in the axes of the base."""


@dataclass(frozen=True, eq=False, slots=True)
class TipWrench:
    """Force on the tip of an arm, and moment about the tip, in the axes of the base frame.

    Attributes:
        value: Force [N] and moment [N·m], shape (6,).
        covariance: Covariance in the directions that are determined, shape (6, 6).
        undetermined: The k unit directions that are not determined, shape (k, 6); their moments are divided by
            `length`.
        length: Length by which moments are divided for a comparison with forces [m].
        misfit: Squared part of the torques that no wrench at the tip explains, in units of their covariance, divided
            by its degrees of freedom; NaN without degrees of freedom. Large values indicate a contact at another
            place.
    """

    value: Array
    covariance: Array
    undetermined: Array
    length: float
    misfit: float

    @property
    def deviation(self) -> Array:
        """Standard deviation of each component, shape (6,) [N and N·m].

        It is infinite for components that have a part in an undetermined direction.
        """
        lost = (self.undetermined**2).sum(axis=0) > 0.01 if len(self.undetermined) else np.zeros(6, dtype=np.bool_)
        return np.where(lost, np.inf, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def tip_jacobian(robot: Robot, q: Array) -> Array:
    """Jacobian of the tip at joint positions q (n,), shape (6, n): velocity of the tip, then angular velocity.

    Both are in the axes of the base.
    """
    rotations, origins = forward_kinematics(robot, q[None])
    _, tip = frame_pose(robot, q[None])
    jacobian = np.zeros((6, robot.n))
    link = robot.tip.parent
    while link >= 0:
        joint = robot.joints[link]
        axis = rotations[0, link] @ joint.axis
        if joint.is_prismatic:
            jacobian[:3, link] = axis
        else:
            jacobian[:3, link] = np.cross(axis, tip[0] - origins[0, link])
            jacobian[3:, link] = axis
        link = joint.parent
    return jacobian


def tip_wrench(robot: Robot, q: Array, external: Array, covariance: Array) -> TipWrench:
    """Wrench at the tip that explains external joint torques best, weighted by their covariance.

    Args:
        robot: The arm.
        q: Joint positions, shape (n,) [rad or m].
        external: External joint torques, shape (n,) [N·m or N].
        covariance: Covariance of their errors, shape (n, n).
    """
    length = max(LENGTH_SHARE * longest_reach(robot), 1e-6)
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    jacobian = tip_jacobian(robot, q) * scale[:, None]  # of a wrench whose moments are divided by the length
    used = np.flatnonzero(np.abs(jacobian).max(axis=0) > 0.0)
    floor = 1e-12 * max(float(np.diag(covariance).max(initial=0.0)), 1e-12)
    inverse = np.linalg.inv(covariance[np.ix_(used, used)] + floor * np.eye(len(used)))
    information = jacobian[:, used] @ inverse @ jacobian[:, used].T
    sizes, directions = np.linalg.eigh(0.5 * (information + information.T))
    known = sizes > max(float(sizes[-1]), 0.0) / SINGULAR**2
    own = directions[:, known]
    spread = (own / sizes[known]) @ own.T
    scaled = spread @ (jacobian[:, used] @ inverse @ external[used])
    rest = external[used] - jacobian[:, used].T @ scaled
    freedom = len(used) - int(np.count_nonzero(known))
    misfit = float(rest @ inverse @ rest) / freedom if freedom > 0 else np.nan
    return TipWrench(
        scaled * scale,
        spread * np.outer(scale, scale),
        directions[:, ~known].T,
        length,
        misfit,
    )

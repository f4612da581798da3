"""Prior knowledge of servos."""

from __future__ import annotations

from dataclasses import dataclass

from armid.checked_array import Array

BODIES = 0.1
"""Prior deviation of the factors of the links of a description, the usual difference between CAD and a built link. A
factor acts on both sides of a pseudo-inertia, so the masses of links of UR5e and iiwa differ by 18 % with it."""


@dataclass(frozen=True, eq=False, slots=True)
class ServoOptions:
    """Prior knowledge of the servos of an arm.

    Attributes:
        stiffness: Stiffness of each joint, shape (n,) [N·m/rad or N/m]; `None` if it is not stated.
        stiffness_deviation: Relative standard deviation of the stiffness, 0 if it is exact.
        damping: Damping of each servo, shape (n,) [N·m·s/rad or N·s/m]; `None` if it is part of the viscous friction.
        limit: Largest torque, shape (n,) [N·m or N]; `None` for the limits of the description.
        delay: Delay at which the search starts [s].
        bodies: Prior deviation of the links; 0 for the links of the description.
    """

    stiffness: Array | None = None
    stiffness_deviation: float = 0.0
    damping: Array | None = None
    limit: Array | None = None
    delay: float = 0.0
    bodies: float = BODIES

"""External torques that act on the links of a simulated arm, such as pushes and collisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import LabError


@dataclass(frozen=True, slots=True)
class Push:
    """External torque on a joint, a table `[[pushes]]` of a `lab.toml`.

    Attributes:
        joint: Index of the joint, from 0.
        torque: Torque; positive values accelerate the joint [N·m or N].
        start: Time of the start, from the start of the log [s].
        seconds: Duration [s].
        rise: Time in which the torque rises linearly at the start and falls at the end [s].
    """

    joint: int = 0
    torque: float = 10.0
    start: float = 1.0
    seconds: float = 0.2
    rise: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.torque) and self.seconds > 0.0 and self.rise >= 0.0):
            raise LabError(
                "For a push, `torque` must be finite, `seconds` positive and `rise` not negative; found "
                f"{self.torque}, {self.seconds} and {self.rise}.",
                remedy="correct these values in the table [[pushes]].",
            )

    def at(self, time: Array) -> Array:
        """Torque of the push at times (N,) [s] since the start of the log, shape (N,) [N·m or N]."""
        since, left = time - self.start, self.start + self.seconds - time
        inside = (since >= 0.0) & (left > 0.0)
        if not self.rise:
            return np.where(inside, self.torque, 0.0)
        return np.where(inside, self.torque * np.clip(np.minimum(since, left) / self.rise, 0.0, 1.0), 0.0)


def external_torque(pushes: Sequence[Push], n: int, time: Array) -> Array | None:
    """Sum of pushes at times (N,) [s], shape (N, n) [N·m or N]; `None` if there are none.

    Raises:
        LabError: A push is for a joint that the arm does not have.
    """
    if not pushes:
        return None
    torque = np.zeros((len(time), n))
    for push in pushes:
        if not 0 <= push.joint < n:
            raise LabError(
                f"A push is for joint {push.joint}, but the joints of the arm have the indices 0 to {n - 1}.",
                remedy="give an index in this range.",
            )
        torque[:, push.joint] += push.at(time)
    return torque

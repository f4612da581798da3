"""Orders of channels that occur in wrongly ordered logs, and a test of an order with the limits of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.fitted_log import LogState
from armid.measurement.position_range_check import FAR

BEYOND = 0.1
"""Share of the range of a joint by which its positions may exceed the range, because limits of descriptions are
approximate."""

Order = NDArray[np.intp]


@dataclass(frozen=True, eq=False, slots=True)
class LimitExcess:
    """Distance by which the positions of each channel exceed the limits of each joint.

    Attributes:
        excess: Element (j, k) is the distance by which the positions of channel k exceed the limits of joint j,
            divided by the range of joint j, shape (n, n). It is minus infinity if joint j has no limits, and infinity
            if one of the joints j and k is revolute and the other one prismatic.
        far: Mask of the joints that are far outside their limits and move over more than the range of the limits,
            shape (n,). Neither inaccurate limits nor a wrong zero can explain this.
    """

    excess: Array
    far: NDArray[np.bool_]

    @property
    def given_fits(self) -> bool:
        """True if all joints are inside their limits when the channels stay in the order of the log."""
        return self.fits(np.arange(len(self.excess)))

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Mask that is true at (j, k) if the positions of channel k may be those of joint j, shape (n, n).

        Positions far outside the limits of a joint are allowed only if the logged positions of the joint are as far
        outside.
        """
        return (self.excess < np.inf) & (self.excess <= np.maximum(BEYOND, np.diag(self.excess)[:, None]))

    def fits(self, order: Order) -> bool:
        """True if all joints are inside their limits when joint j has the positions of channel order[j]."""
        return bool((self.excess[np.arange(len(order)), order] <= BEYOND).all())


def limit_excess(state: LogState) -> LimitExcess:
    """Compares the positions of all channels of a log with the limits of all joints."""
    joints = state.model.robot.joints
    slides = np.array([joint.is_prismatic for joint in joints])
    q = np.concatenate([run.motion.q[run.rows] for run in state.log.runs])
    low, high = np.array([joint.position_limits for joint in joints]).T[:, :, None]
    known = np.isfinite(low) & np.isfinite(high) & (high > low)
    span = np.where(known, high - low, 1.0)
    excess = np.where(known, np.maximum(low - q.min(axis=0), q.max(axis=0) - high) / span, -np.inf)
    far = (np.diag(excess) > FAR) & (np.ptp(q, axis=0) > (1.0 + BEYOND) * span[:, 0])
    return LimitExcess(np.where(slides[:, None] == slides, excess, np.inf), far)


def usual_orders(n: int) -> list[Order]:
    """Orders (n,) with two channels exchanged, all reversed, or three or more neighbours shifted by one place.

    Args:
        n: Number of channels.
    """
    same = np.arange(n)
    return [*exchanges(n), *([same[::-1]] if n > 3 else []), *shifts(n)]


def exchanges(n: int) -> list[Order]:
    """Orders (n,) of n channels in which two channels are exchanged."""
    result: list[Order] = []
    for pair in combinations(range(n), 2):
        order = np.arange(n)
        order[list(pair)] = pair[::-1]
        result.append(order)
    return result


def shifts(n: int) -> list[Order]:
    """Orders (n,) in which three or more neighbouring channels are shifted cyclically by one place."""
    result: list[Order] = []
    for first, last in combinations(range(n), 2):
        if last - first < 2:
            continue
        for step in (-1, 1):
            order = np.arange(n)
            order[first : last + 1] = np.roll(order[first : last + 1], step)
            result.append(order)
    return result

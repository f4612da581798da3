"""Changes of base parameters by a recalibration, and the selection of changes that noise does not explain."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """Change of a base parameter by a recalibration.

    Attributes:
        name: Name of the parameter.
        before: Value in the earlier estimate.
        after: Value in the new estimate.
        change: Change of the value. If the parameter has separate values in earlier and new recordings, the change is
            the difference of these values in the common solution of all recordings. Errors that both values have,
            such as errors of torque scales, cancel in this difference, so it can differ slightly from after - before.
        deviation: Standard deviation of the change.
        half: Half of the 95 % interval of the change.
    """

    name: str
    before: float
    after: float
    change: float
    deviation: float
    half: float

    @property
    def size(self) -> float:
        """Absolute change divided by half of its 95 % interval; above 1, noise does not explain the change."""
        if self.half > 0.0:
            return abs(self.change) / self.half
        return math.inf if self.change else 0.0

    @property
    def beyond(self) -> bool:
        """True if zero is outside the 95 % interval of the change."""
        return self.size > 1.0

    @property
    def ratio(self) -> float:
        """Absolute value of the change divided by its standard deviation."""
        return abs(self.change) / self.deviation if self.deviation > 0.0 else 0.0


def changed(changes: Iterable[ParameterChange]) -> list[ParameterChange]:
    """Selects the changes that noise does not explain, the largest first."""
    return sorted((each for each in changes if each.beyond), key=lambda each: -each.size)

"""Changes of the units of a fleet since an earlier fleet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.fleet.fleet_estimate import FleetEstimate
from armid.estimation.fleet.odd_units import FALSE_ALARM, holm
from armid.maths.distributions import NORMAL


@dataclass(frozen=True, slots=True)
class UnitChange:
    """Change of one own parameter or torque scale of a unit.

    Attributes:
        unit: Name of the unit.
        joint: Number of the joint, from 0.
        parameter: Name of the parameter.
        before: Value in the earlier fleet.
        after: Value in this fleet.
        half: Half width of the 95 % interval of the change, for independent errors of both fleets.
        beyond: True if the change is larger than errors explain; the probability that any unchanged parameter of the
            fleet is named is at most `FALSE_ALARM`.
    """

    unit: str
    joint: int
    parameter: str
    before: float
    after: float
    half: float
    beyond: bool

    @property
    def change(self) -> float:
        """Change of the value."""
        return self.after - self.before


def changes_since(before: FleetEstimate, after: FleetEstimate) -> tuple[UnitChange, ...]:
    """Changes of all own parameters of the units that both fleets have, in the order of the later fleet.

    Args:
        before: The earlier fleet.
        after: The later fleet.

    Raises:
        ArmidError: The fleets have no unit in common, or other parameters.
    """
    if before.own.names != after.own.names or before.prior.names != after.prior.names:
        raise ArmidError(
            "The earlier fleet has other parameters than this fleet, so they cannot be compared.",
            remedy="identify both fleets with the same arm description and the same torque terms.",
        )
    both = [name for name in after.units if name in before.units]
    if not both:
        raise ArmidError(
            f"The earlier fleet has none of the units {', '.join(after.units)}.",
            possible=f"units of the earlier fleet: {', '.join(before.units)}",
            remedy="give the units the same names in both fleet files.",
        )
    first, later = (_own(fleet, both) for fleet in (before, after))
    change = later[0] - first[0]
    deviation = np.sqrt(first[1] ** 2 + later[1] ** 2)
    ratio = np.abs(change) / np.where(deviation > 0.0, deviation, np.inf)
    probability = np.array([math.erfc(each / math.sqrt(2.0)) for each in ratio.ravel()])
    beyond = (holm(probability) < FALSE_ALARM).reshape(ratio.shape)
    return tuple(
        UnitChange(
            unit,
            int(after.own.joint[k]),
            parameter,
            float(first[0][u, k]),
            float(later[0][u, k]),
            float(NORMAL * deviation[u, k]),
            bool(beyond[u, k]),
        )
        for u, unit in enumerate(both)
        for k, parameter in enumerate(after.own.names)
    )


def _own(fleet: FleetEstimate, units: list[str]) -> tuple[Array, Array]:
    """Own unknowns of some units and their standard deviations, shape (units, m) each."""
    at = [fleet.units.index(name) for name in units]
    place = [k for k, name in enumerate(fleet.prior.names) if name in fleet.prior.own]
    values = np.column_stack([fleet.values[at][:, place], fleet.scale[at]])
    return values, np.column_stack([fleet.deviation[at][:, place], fleet.scale_deviation[at]])


def change_record(change: UnitChange) -> dict[str, Any]:
    """Change as a dictionary for a JSON file."""
    return {
        "unit": change.unit,
        "parameter": change.parameter,
        "before": change.before,
        "after": change.after,
        "change": change.change,
        "half_interval": change.half,
        "beyond": change.beyond,
    }

"""Information of the units of a fleet in a fixed order, with the sizes of their unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.fleet.layout import FleetLayout, fleet_layout
from armid.estimation.fleet.unit_rows import torque_squares
from armid.information.information import Information, total

FIRST_OWN, FIRST_SCALE = 0.3, 0.05
"""First standard deviations between units: effect of an own parameter on the RMS torque of its joint, relative;
torque scale."""

ASSUMED_UNITS, ASSUMED_SCALE = 2.0, 0.03
"""Number of units that the variance of the torque scales counts in addition, and their standard deviation if the
recordings state none; it is usual for torque constants. Where bodies have little torque, the data hardly determine
the scale of a joint, and a variance that is too small by chance would make the intervals of its friction too
narrow."""


@dataclass(frozen=True, eq=False, slots=True)
class FleetData:
    """Information of U units, ordered by name.

    Attributes:
        names: Names of the units.
        blocks: Information of each unit, block by block.
        whole: Information of each unit, all blocks merged.
        layout: Order of the unknowns.
        torque: RMS torque of each joint, shape (n,) [N·m or N].
        first: First standard deviation of each own unknown between units, shape (m,).
        assumed: Number of units that each variance between units counts in addition, and sum of their squared
            deviations, shape (2, m).
    """

    names: tuple[str, ...]
    blocks: tuple[Information, ...]
    whole: tuple[Information, ...]
    layout: FleetLayout
    torque: Array
    first: Array
    assumed: Array


def fleet_data(units: Mapping[str, Information], own: NDArray[np.bool_]) -> FleetData:
    """Puts the information of units in the order of their names.

    Args:
        units: Information of each unit, by name; at least two.
        own: Mask of the base parameters that each unit has for itself, shape (b,).

    Raises:
        EstimationError: There are fewer than two units, or they have different parameters.
    """
    names = tuple(sorted(units))
    if len(names) < 2:
        raise EstimationError(
            f"A fleet needs at least two units; found {len(names)}.",
            remedy="add the recordings of another unit, or use armid identify for a single arm.",
        )
    first = units[names[0]]
    for name in names[1:]:
        if units[name].names != first.names or units[name].n != first.n:
            raise EstimationError(
                f"The units {names[0]} and {name} have different base parameters.",
                remedy="compute all units with the same robot and the same torque terms.",
            )
    whole = tuple(total(units[name]) for name in names)
    layout = fleet_layout(first, own)
    rows = np.maximum(np.sum([each.rows[0] for each in whole], axis=0), 1)
    torque = np.sqrt(
        np.maximum(np.sum([torque_squares(each) for each in whole], axis=0) / rows, np.finfo(float).tiny)
    )
    sizes = np.ones(len(layout.own))
    for k, parameter in enumerate(layout.own):
        j = layout.joint[k]
        at = int(np.searchsorted(whole[0].joints[j].parameters, parameter))
        square = sum(float(np.sum(each.joints[j].R[0, :, at] ** 2)) for each in whole)
        sizes[k] = torque[j] / np.sqrt(square / rows[j]) if square > 0.0 else 1.0
    deviation = np.concatenate([FIRST_OWN * sizes, np.full(layout.n, FIRST_SCALE)])
    assumed = np.zeros((2, layout.count))
    stated = np.max([each.scale_deviation for each in whole], axis=0)
    assumed[0, len(layout.own) :] = ASSUMED_UNITS
    assumed[1, len(layout.own) :] = ASSUMED_UNITS * np.where(stated > 0.0, stated, ASSUMED_SCALE) ** 2
    return FleetData(names, tuple(units[name] for name in names), whole, layout, torque, deviation, assumed)

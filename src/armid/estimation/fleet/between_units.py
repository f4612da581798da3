"""Variances between units by restricted maximum likelihood, with the EM algorithm [Dempster1977, Laird1982].

The own unknowns of a unit are normally distributed about the means of the fleet. In each step, the variance of an
own unknown becomes the mean over the units of its expected squared deviation, given the data. This deviation contains
the uncertainty of the common unknowns, which makes the likelihood the restricted one [Laird1982].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.fleet.elimination import (
    Common,
    Eliminated,
    eliminate,
    merged_factor,
    own_deviations,
    solve_common,
)
from armid.estimation.fleet.layout import FleetLayout

STEPS = 60
"""Largest number of steps. A step reduces the error of a variance by the share that the data do not determine."""

CONVERGED = 3e-3
"""Largest relative change of a standard deviation at which the iteration ends. With 20 units, a standard deviation is
known to 16 %."""

FREE = 1e3
"""Factor of the standard deviation of an own unknown that is left out of means and variances: its unit then
determines it alone."""

LEAST = 1e-4
"""Smallest standard deviation between units, as a share of the first value: below it, a difference between units has
no effect on the torque."""


@dataclass(frozen=True, eq=False, slots=True)
class Population:
    """Common unknowns of a fleet, and the scatter of the own unknowns between its units.

    Attributes:
        common: Shared parameters and means.
        deviation: Standard deviation of each own unknown between units, shape (m,).
        units: Rows of each unit after the elimination of its own unknowns.
        own: Deviations of the own unknowns of each unit from the means, shape (U, m).
        known: Variances of these deviations for known common unknowns, shape (U, m).
        added: Variances that the uncertainty of the common unknowns adds, shape (U, m).
    """

    common: Common
    deviation: Array
    units: tuple[Eliminated, ...]
    own: Array
    known: Array
    added: Array

    @property
    def squares(self) -> Array:
        """Expected squared deviations, shape (U, m)."""
        return self.own**2 + self.known + self.added


def estimate_population(
    rows: Sequence[Array],
    layout: FleetLayout,
    start: Array,
    least: Array,
    kept: NDArray[np.bool_],
    *,
    usual: NDArray[np.bool_] | None = None,
    assumed: Array | None = None,
    steps: int = STEPS,
) -> Population:
    """Estimates common unknowns and variances between units.

    Args:
        rows: Triangular factor of each unit, from `unit_rows`.
        layout: Order of the unknowns.
        start: First standard deviations between units, shape (m,).
        least: Smallest standard deviations, shape (m,).
        kept: Mask of the own unknowns that count for means and variances, shape (U, m).
        usual: Mask of the units that count for the shared parameters, shape (U,); all if not given.
        assumed: Number of units that each variance counts in addition, and sum of their squared deviations, shape
            (2, m); none if not given.
        steps: Largest number of steps; 0 for the first standard deviations.

    Raises:
        EstimationError: The units do not determine all common unknowns.
    """
    deviation = start
    more, squares = np.zeros((2, layout.count)) if assumed is None else assumed
    number = np.maximum(kept.sum(axis=0) + more, 1)
    counted = np.ones(len(rows), dtype=np.bool_) if usual is None else usual
    found = _at(rows, layout, deviation, kept, counted)
    for _ in range(steps):
        updated = np.maximum(np.sqrt((np.where(kept, found.squares, 0.0).sum(axis=0) + squares) / number), least)
        change = np.abs(np.log(updated / deviation)).max()
        deviation = updated
        found = _at(rows, layout, deviation, kept, counted)
        if change <= CONVERGED:
            break
    return found


def _at(
    rows: Sequence[Array],
    layout: FleetLayout,
    deviation: Array,
    kept: NDArray[np.bool_],
    usual: NDArray[np.bool_],
) -> Population:
    """Common unknowns and deviations of the units for given standard deviations between units (m,)."""
    units: list[Eliminated] = []
    for each, mask, counts in zip(rows, kept, usual, strict=True):
        unit = eliminate(each, layout, np.where(mask, deviation, FREE * deviation))
        units.append(unit if counts else replace(unit, factor=np.zeros_like(unit.factor)))
    common = solve_common(merged_factor([unit.factor for unit in units]), common_names(layout))
    own, known, added = (np.array(x) for x in zip(*(own_deviations(u, layout, common) for u in units), strict=True))
    return Population(common, deviation, tuple(units), own, known, added)


def common_names(layout: FleetLayout) -> tuple[str, ...]:
    """Names of the common unknowns: shared parameters, and own parameters for their means."""
    return tuple(str(layout.names[k]) for k in (*layout.shared, *layout.own))

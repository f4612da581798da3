"""Distribution of the parameters of each unit of a fleet that follows from all other units."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.fleet.between_units import FREE, LEAST, Population, common_names
from armid.estimation.fleet.elimination import Common, left_out_factors, solve_common
from armid.estimation.fleet.fleet_data import FleetData
from armid.estimation.fleet.fleet_rounds import FleetState
from armid.estimation.fleet.unit_update import FleetPrior


def others_without_each(data: FleetData, population: Population) -> list[Common]:
    """For each unit, the common unknowns as all other units determine them.

    Raises:
        EstimationError: Without one of the units, the others do not determine all common unknowns.
    """
    factors = left_out_factors([unit.factor for unit in population.units])
    return [solve_common(factor, common_names(data.layout)) for factor in factors]


def scatter_of_others(data: FleetData, state: FleetState, population: Population) -> tuple[Array, Array]:
    """Standard deviation of each own unknown between the other units, and number of these units, shape (U, m) each.

    Args:
        data: The fleet.
        state: State of its estimate.
        population: Common unknowns and scatter.
    """
    squares = np.where(state.counted, population.squares, 0.0)
    number = state.counted.sum(axis=0) - state.counted
    variance = (squares.sum(axis=0) - squares + data.assumed[1]) / np.maximum(number + data.assumed[0], 1)
    return np.maximum(np.sqrt(np.maximum(variance, 0.0)), LEAST * data.first), number


def left_out_priors(
    data: FleetData, state: FleetState, population: Population, others: list[Common]
) -> list[FleetPrior]:
    """Distribution of the parameters of each unit without its own data.

    Own unknowns that are odd, and the bodies of a unit with odd bodies, have a wide distribution.

    Args:
        data: The fleet.
        state: State of its estimate.
        population: Common unknowns and scatter.
        others: Common unknowns without each unit.
    """
    scatter, number = scatter_of_others(data, state, population)
    return [
        prior_of(data, state, common, np.where(kept, 1.0, FREE) * deviation, count, odd_bodies=not usual)
        for common, deviation, count, kept, usual in zip(
            others, scatter, number, state.kept, state.usual, strict=True
        )
    ]


def prior_of(
    data: FleetData, state: FleetState, common: Common, deviation: Array, number: Array, *, odd_bodies: bool = False
) -> FleetPrior:
    """Distribution of the parameters of a unit.

    Args:
        data: The fleet.
        state: State of its estimate.
        common: Common unknowns, from other units.
        deviation: Standard deviation of each own unknown of the unit, shape (m,).
        number: Number of units from which each of these was estimated, shape (m,).
        odd_bodies: True if the bodies of the unit are known to differ.
    """
    layout, d = data.layout, len(data.layout.own)
    order = np.concatenate([layout.shared, layout.own])
    root = np.empty_like(common.half)
    root[order] = common.half
    covariance = (FREE if odd_bodies else 1.0) ** 2 * (root @ root.T)
    covariance[layout.own, layout.own] += deviation[:d] ** 2
    mean = np.empty(len(layout.names))
    mean[order] = common.values
    return FleetPrior(
        layout.names,
        mean,
        covariance,
        deviation[d:],
        state.noise,
        state.correlation,
        layout.own_names[:d],
        max(float(number.min()) - 1.0, 1.0),
    )

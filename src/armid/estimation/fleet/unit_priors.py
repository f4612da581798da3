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


def scatter_of_others(
    data: FleetData, state: FleetState, population: Population, others: list[Common]
) -> tuple[Array, Array]:
    """Scatter of each own unknown between the other units: standard deviations and degrees of freedom, (U, m) each.

    The deviations are about the mean of the other units, which an odd unit does not shift. This mean takes one degree
    of freedom; that of the torque scales is 1.

    Args:
        data: The fleet.
        state: State of its estimate.
        population: Common unknowns and scatter.
        others: Common unknowns without each unit.
    """
    counted = state.counted
    shift = np.array([data.layout.mean_map @ (each.values - population.common.values) for each in others])
    squares = np.where(counted, population.own**2 + population.known, 0.0)
    own = np.where(counted, population.own, 0.0)
    number = counted.sum(axis=0) - counted
    about = squares.sum(axis=0) - squares - 2.0 * shift * (own.sum(axis=0) - own) + number * shift**2
    freedom = np.maximum(number - data.layout.mean_map.any(axis=1) + data.assumed[0], 1.0)
    variance = np.maximum((about + data.assumed[1]) / freedom, 0.0)
    return np.maximum(np.sqrt(variance), LEAST * data.first), freedom


def left_out_priors(data: FleetData, state: FleetState, others: list[Common], scatter: Array) -> list[FleetPrior]:
    """Distribution of the parameters of each unit without its own data.

    Own unknowns that are odd, and the bodies of a unit with odd bodies, have a wide distribution.

    Args:
        data: The fleet.
        state: State of its estimate.
        others: Common unknowns without each unit.
        scatter: Standard deviation of each own unknown between the other units, shape (U, m).
    """
    return [
        prior_of(data, state, common, np.where(kept, 1.0, FREE) * deviation, odd_bodies=not usual)
        for common, deviation, kept, usual in zip(others, scatter, state.kept, state.usual, strict=True)
    ]


def prior_of(
    data: FleetData, state: FleetState, common: Common, deviation: Array, *, odd_bodies: bool = False
) -> FleetPrior:
    """Distribution of the parameters of a unit.

    Args:
        data: The fleet.
        state: State of its estimate.
        common: Common unknowns, from other units.
        deviation: Standard deviation of each own unknown of the unit, shape (m,).
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
    )

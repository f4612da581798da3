"""Noise, torque scales and scatter of a fleet, estimated in turn until they no longer change."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.fleet.between_units import LEAST, STEPS, Population, estimate_population
from armid.estimation.fleet.fleet_data import FleetData
from armid.estimation.fleet.odd_units import robust_start
from armid.estimation.fleet.unit_rows import residual_squares, score_squares, unit_rows

ROUNDS = 12
"""Largest number of rounds; five are usual."""

SETTLED = 1e-3
"""Largest relative change of the noise, and largest change of a torque scale, at which the rounds end."""

NO_SCALE = 1e-6
"""Standard deviation of the torque scales in the first round, in which the predicted torque is not known yet."""

AGAIN = 0.1
"""Share of the first standard deviations from which a round starts at least. The algorithm approaches a variance from
above in few steps; from far below it would need many."""

RESOLUTION = 1e-12
"""Lower limit of the ratio of residual to torque, so that data without noise have finite weights."""


@dataclass(frozen=True, eq=False, slots=True)
class FleetState:
    """State of the estimate of a fleet of U units.

    Attributes:
        noise: Standard deviation of each joint's residual, shape (n,) [N·m or N].
        correlation: Number of rows that count as one independent sample, shape (n,).
        values: Base parameters of each unit, shape (U, b).
        scale: Torque scales, shape (U, n).
        deviation: Standard deviation of each own unknown between units, shape (m,).
        kept: Mask of the own unknowns that count for means and scatter, shape (U, m).
        usual: Mask of the units that count for the shared parameters, shape (U,).
    """

    noise: Array
    correlation: Array
    values: Array
    scale: Array
    deviation: Array
    kept: NDArray[np.bool_]
    usual: NDArray[np.bool_]

    @property
    def weights(self) -> Array:
        """Weight of the rows of each joint, so that weighted rows count as independent samples, shape (n,)."""
        return 1.0 / (self.noise * np.sqrt(self.correlation))

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Mask of the own unknowns that count; those of a unit with odd bodies do not, shape (U, m)."""
        return self.kept & self.usual[:, None]


def rows_of_units(data: FleetData, state: FleetState) -> list[Array]:
    """Triangular factors of all units, linearised at the parameters and torque scales of a state."""
    return [
        unit_rows(each, data.layout, state.weights, values, scale)
        for each, values, scale in zip(data.whole, state.values, state.scale, strict=True)
    ]


def first_rounds(data: FleetData) -> tuple[FleetState, Population]:
    """Estimates a fleet for the first time, without the own unknowns that are far from the median of the fleet.

    Raises:
        EstimationError: The units do not determine all common unknowns.
    """
    count, n, m = len(data.names), data.layout.n, data.layout.count
    state = FleetState(
        data.torque,
        np.ones(n),
        np.zeros((count, len(data.layout.names))),
        np.ones((count, n)),
        data.first,
        np.ones((count, m), dtype=np.bool_),
        np.ones(count, dtype=np.bool_),
    )
    start = data.first.copy()
    start[m - n :] = NO_SCALE
    state = _updated(data, state, _population(data, state, start, 0))
    population = _population(data, state, data.first)
    state = replace(
        _updated(data, state, population),
        deviation=population.deviation,
        kept=robust_start(population.own, population.known + population.added),
    )
    return rounds(data, state)


def rounds(data: FleetData, state: FleetState) -> tuple[FleetState, Population]:
    """Estimates noise, torque scales, scatter and parameters in turn until they no longer change.

    Raises:
        EstimationError: The units do not determine all common unknowns.
    """
    population = _population(data, state, np.maximum(state.deviation, AGAIN * data.first))
    for _ in range(ROUNDS):
        before = state
        state = replace(_updated(data, state, population), deviation=population.deviation)
        noise = np.abs(np.log(state.noise / before.noise)).max()
        if max(noise, np.abs(state.scale - before.scale).max()) <= SETTLED:
            break
        population = _population(data, state, np.maximum(state.deviation, AGAIN * data.first))
    return state, population


def _population(data: FleetData, state: FleetState, start: Array, steps: int = STEPS) -> Population:
    """Common unknowns and scatter for the noise and the torque scales of a state."""
    rows, least = rows_of_units(data, state), LEAST * data.first
    start = start if steps == 0 else np.maximum(start, least)
    return estimate_population(
        rows, data.layout, start, least, state.counted, usual=state.usual, assumed=data.assumed, steps=steps
    )


def _updated(data: FleetData, state: FleetState, population: Population) -> FleetState:
    """State with parameters and torque scales of all units, and with noise and correlation of their residuals."""
    layout, n = data.layout, data.layout.n
    per_joint = np.bincount(layout.joint, minlength=n)
    values = np.array([layout.base_values(population.common.values, own) for own in population.own])
    scale = 1.0 + population.own[:, layout.count - n :]
    squares, gradients, ranks = np.zeros(n), np.zeros(n), np.zeros(n)
    free = np.full(n, -len(layout.shared) / n)
    for blocks, whole, value, factor in zip(data.blocks, data.whole, values, scale, strict=True):
        squares += residual_squares(whole, value, factor)
        free += np.maximum(whole.rows[0] - per_joint, 0)
        found = score_squares(blocks, value, factor)
        gradients, ranks = gradients + found[0], ranks + found[1]
    variance = np.maximum(squares / np.maximum(free, 1.0), (RESOLUTION * data.torque) ** 2)
    correlation = np.maximum(gradients / (variance * np.maximum(ranks, 1.0)), 1.0)
    return replace(state, noise=np.sqrt(variance), correlation=correlation, values=values, scale=scale)

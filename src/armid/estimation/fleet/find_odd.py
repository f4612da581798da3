"""Search for units of a fleet that differ from all other units."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.fleet.between_units import FREE, Population
from armid.estimation.fleet.elimination import Common, eliminate
from armid.estimation.fleet.fleet_data import FleetData
from armid.estimation.fleet.fleet_rounds import FleetState, rows_of_units
from armid.estimation.fleet.odd_units import (
    FALSE_ALARM,
    FEWEST,
    TOLD,
    OddBodies,
    OddUnknown,
    bodies_probability,
    holm,
    student_two_sided,
)
from armid.estimation.fleet.unit_rows import torque_squares
from armid.estimation.fleet.unit_update import FleetPrior, UnitEstimate

BODY_EFFECT = 0.02
"""Smallest change of the RMS torque of a joint, relative to its RMS torque, for which bodies count as odd."""

EXACT = 1e-12
"""Smallest share of a variance that the data remove, against division by zero."""


def odd_unknowns(
    data: FleetData,
    state: FleetState,
    scatter_and_freedom: tuple[Array, Array],
    priors: list[FleetPrior],
    estimates: list[UnitEstimate],
) -> tuple[Array, list[OddUnknown]]:
    """Scores of all own unknowns, shape (U, m), and the own unknowns that differ from the other units.

    The value that the data of a unit alone give to an own unknown is y = μ + P (x - μ) / (P - C), with mean μ and
    variance P from the other units, and x and variance C after the data. In a unit like the others, y - μ has the
    variance P² / (P - C).

    Args:
        data: The fleet.
        state: State of its estimate.
        scatter_and_freedom: Scatter of each own unknown between the other units, and its degrees of freedom.
        priors: Distribution of each unit without its own data.
        estimates: Parameters of each unit.
    """
    layout = data.layout
    scatter, freedom = scatter_and_freedom
    between = scatter**2
    own = layout.own
    width = np.array([np.append(np.diag(p.covariance)[own], p.scale_deviation**2) for p in priors])
    after = np.array([np.append(np.diag(e.covariance)[own], e.scale_deviation**2) for e in estimates])
    values = np.array([np.append(e.values[own], e.scale) for e in estimates])
    mean = np.array([np.append(p.mean[own], np.ones(layout.n)) for p in priors])
    gain = width / np.maximum(width - after, EXACT * width)
    # An odd unknown has a wide distribution, but is compared with the scatter of the others. The variance of their
    # mean was computed with the scatter of all units, which an odd unit enlarges.
    of_mean = width - np.where(state.kept, between, (FREE * scatter) ** 2)
    usual = np.maximum(of_mean, 0.0) * between / state.deviation**2 + between
    spread = usual + after * gain
    told = (usual / spread >= TOLD) & (state.counted.sum(axis=0) - state.counted >= FEWEST - 1)
    score = np.where(told, (values - mean) * gain / np.sqrt(spread), np.nan)
    # Only the scatter is estimated from few units [Satterthwaite1946].
    probability = student_two_sided(score, freedom * (spread / between) ** 2)
    corrected = np.ones_like(probability)
    corrected[told] = holm(probability[told])
    odd = [
        OddUnknown(
            data.names[u],
            int(layout.joint[k]),
            layout.own_names[k],
            float(values[u, k]),
            float(mean[u, k]),
            float(scatter[u, k]),
            float(score[u, k]),
            float(corrected[u, k]),
        )
        for u, k in zip(*np.nonzero(corrected < FALSE_ALARM), strict=True)
    ]
    return score, sorted(odd, key=lambda each: (-abs(each.score), each.unit, each.parameter))


def odd_bodies(data: FleetData, state: FleetState, population: Population, others: list[Common]) -> list[OddBodies]:
    """Units whose shared parameters differ from those of the other units, whatever their own parameters.

    Args:
        data: The fleet.
        state: State of its estimate.
        population: Common unknowns and scatter.
        others: Common unknowns without each unit.
    """
    layout, a, d = data.layout, len(data.layout.shared), len(data.layout.own)
    deviation = np.append(FREE * population.deviation[:d], population.deviation[d:])
    squares: list[float] = []
    changes: list[Array] = []
    for rows, common in zip(rows_of_units(data, state), others, strict=True):
        factor = eliminate(rows, layout, deviation).factor
        columns = factor[:a, :a]
        innovation = factor[:a, -1] - factor[:a, :-1] @ common.values
        shown = columns @ common.half[:a]
        squares.append(float(innovation @ np.linalg.solve(np.eye(a) + shown @ shown.T, innovation)))
        wide = FREE * shown  # the bodies that the unit alone would have
        gain = np.linalg.solve(np.eye(a) + wide @ wide.T, innovation)
        changes.append(FREE * common.half[:a] @ (wide.T @ gain))
    ratio, probability = bodies_probability(np.array(squares), a)
    found: list[OddBodies] = []
    for u in np.flatnonzero(probability < FALSE_ALARM):
        effect = _effects(data, int(u), changes[u])
        j = int(np.argmax(effect))
        if effect[j] >= BODY_EFFECT:
            found.append(OddBodies(data.names[u], j, float(effect[j]), float(ratio[u]), float(probability[u])))
    return found


def _effects(data: FleetData, u: int, change: Array) -> Array:
    """RMS change of the torque of each joint by a change of the shared parameters (a,), relative, shape (n,)."""
    full = np.zeros(len(data.layout.names))
    full[data.layout.shared] = change
    whole = data.whole[u]
    squares = np.array([np.sum((joint.R[0, :, :-1] @ full[joint.parameters]) ** 2) for joint in whole.joints])
    return np.sqrt(squares / np.maximum(torque_squares(whole), np.finfo(float).tiny))

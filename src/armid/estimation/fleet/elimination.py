"""Elimination of the own unknowns of each unit from a fleet, and merging of what remains.

The normal matrix of a fleet has the form of an arrow: own unknowns of different units meet only in the common
unknowns (shared parameters and means). Therefore the own unknowns are eliminated unit by unit, by QR factorisations
of their small factors, and only triangular factors of the common unknowns are merged. Merging is associative, so a
fleet without one of its units is the merge of the units before and after it; nothing is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.fleet.layout import FleetLayout
from armid.maths.linalg import null_directions, triangular_factor, unit_columns


@dataclass(frozen=True, eq=False, slots=True)
class Eliminated:
    """Rows of one unit after the elimination of its own unknowns z.

    Attributes:
        inverse: Inverse of the triangular factor of z, shape (m, m).
        mixed: Coefficients of the common unknowns x in the rows of z, shape (m, x).
        side: Right-hand side of the rows of z, shape (m,).
        factor: Triangular factor about the common unknowns, the right-hand side last, shape (x + 1, x + 1).
    """

    inverse: Array
    mixed: Array
    side: Array
    factor: Array


@dataclass(frozen=True, eq=False, slots=True)
class Common:
    """Estimate of the common unknowns.

    Attributes:
        values: Values, shape (x,).
        half: Square root h of their covariance h hᵀ, shape (x, x).
    """

    values: Array
    half: Array


def eliminate(rows: Array, layout: FleetLayout, deviation: Array) -> Eliminated:
    """Eliminates the own unknowns of a unit, which scatter about their means.

    Args:
        rows: Triangular factor of the unit, from `unit_rows`.
        layout: Order of the unknowns.
        deviation: Standard deviation of each own unknown between units, shape (m,).
    """
    m, a, d = layout.count, len(layout.shared), len(layout.own)
    wide = np.zeros((len(rows) + m, m + a + d + 1))
    wide[: len(rows), : m + a] = rows[:, :-1]
    wide[: len(rows), -1] = rows[:, -1]
    wide[len(rows) :, :m] = np.diag(1.0 / deviation)
    wide[len(rows) :, m : m + a + d] = -layout.mean_map / deviation[:, None]
    R = triangular_factor(wide)
    factor = np.zeros((a + d + 1, a + d + 1))
    factor[: len(R) - m] = R[m : m + a + d + 1, m:]
    return Eliminated(np.asarray(np.linalg.inv(R[:m, :m]), dtype=np.float64), R[:m, m:-1], R[:m, -1], factor)


def merged_factor(factors: Sequence[Array]) -> Array:
    """Triangular factor of the stacked factors of several units, shape (x + 1, x + 1)."""
    result = factors[0]
    for factor in factors[1:]:
        result = triangular_factor(np.concatenate([result, factor]))
    return result


def left_out_factors(factors: Sequence[Array]) -> list[Array]:
    """For each unit, the triangular factor of all other units, shape (x + 1, x + 1)."""
    nothing = np.zeros_like(factors[0])
    before, after = [nothing], [nothing]
    for factor in factors[:-1]:
        before.append(merged_factor([before[-1], factor]))
    for factor in factors[:0:-1]:
        after.append(merged_factor([after[-1], factor]))
    return [merged_factor([first, last]) for first, last in zip(before, reversed(after), strict=True)]


def solve_common(factor: Array, names: Sequence[str]) -> Common:
    """Solves for the common unknowns.

    Args:
        factor: Merged triangular factor, the right-hand side last.
        names: Names of the common unknowns, for messages.

    Raises:
        EstimationError: The units do not determine all common unknowns.
    """
    R, side = factor[:-1, :-1], factor[:-1, -1]
    directions = null_directions(R)
    if len(directions):
        touched = np.flatnonzero(np.abs(directions).max(axis=0) > 0.1 * np.abs(directions).max()).tolist()
        raise EstimationError(
            f"The units together determine only {len(names) - len(directions)} of {len(names)} common parameters; "
            f"they do not determine {', '.join(names[k] for k in touched)}.",
            remedy="record a motion that moves the joints of these parameters with at least one unit, lock these "
            "joints, or use fewer torque terms.",
        )
    scaled, length = unit_columns(R)
    half = np.linalg.inv(scaled) / length[:, None]
    return Common(half @ side, half)


def own_deviations(unit: Eliminated, layout: FleetLayout, common: Common) -> tuple[Array, Array, Array]:
    """Deviations of the own unknowns of a unit from their means, and two variances of them, shape (m,) each.

    The first variance is that for known common unknowns; the second one is what their uncertainty adds.

    Args:
        unit: The unit.
        layout: Order of the unknowns.
        common: Estimate of the common unknowns.
    """
    change = unit.inverse @ unit.mixed + layout.mean_map
    values = unit.inverse @ unit.side - change @ common.values
    return values, np.sum(unit.inverse**2, axis=1), np.sum((change @ common.half) ** 2, axis=1)

"""Section 3.1.4 and appendix of the thesis: zero and dependent columns, base parameters, and Algorithm 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.maths.inertia import com_inertia_to_vector, vector_to_com_inertia
from armid.model.dynamics_model import DynamicsModel
from armid.thesis.derivation import Identity, derivation
from armid.thesis.lagrange import make_frames, torque_of_bodies
from armid.thesis.published import Sum, formula, published, weight
from armid.thesis.setting import HANGING, Setting, random_states

GAP = 1e-10
"""Ratio of a singular value of the regressor to the largest one below which the singular value counts as zero, so
that a column depends on the others. Rounding gives about 1e-15, independent columns give more than 1e-2."""

ALIKE = 1e-12
"""Largest relative difference that counts as a rounding error."""


@dataclass(frozen=True, slots=True)
class Dependence:
    """Line of equation (A.1) of the thesis: a removed column as a sum of other columns.

    Attributes:
        column: Name of the removed column.
        label: Name of the column that the thesis prints for this line.
        printed: Sum that the thesis prints; empty if the print cannot be read as a sum.
        right: Correct sum.
        printed_error: Largest difference of the sides of the printed line, divided by the largest element of both
            sides; NaN if the print cannot be read.
        right_error: Value of `printed_error` for the correct sum.
    """

    column: str
    label: str
    printed: str
    right: str
    printed_error: float
    right_error: float


@dataclass(frozen=True, slots=True)
class Grouping:
    """Line of equation (3.39) of the thesis: a base parameter as a sum of standard parameters.

    Attributes:
        name: Name of the base parameter.
        printed: Printed sum.
        error: Largest difference between a printed coefficient and the coefficient that is computed from the
            geometry.
    """

    name: str
    printed: str
    error: float


@dataclass(frozen=True, eq=False, slots=True)
class Reduction:
    """Results of section 3.1.4 of the thesis.

    Attributes:
        columns: Number of columns of the regressor Y.
        zero: Names of the zero columns.
        rank: Number of independent columns.
        singular: Smallest singular value of Y that is not zero, and largest singular value that is zero within
            rounding, both divided by the largest singular value.
        removed: Removed parameters, π_r of equation (3.33).
        names: Base parameters, π_b of equation (3.38).
        dependences: Lines of equation (A.1).
        groupings: Lines of equation (3.39).
        identities: Equations (3.9) to (3.30) of the derivation.
        torque_error: Largest difference between Y_b π_b(π(μ)) and τ(μ) in Algorithm 1, divided by the largest torque.
            The torque τ(μ) is computed from the matrices M, C and g for the physical parameters μ.
    """

    columns: int
    zero: tuple[str, ...]
    rank: int
    singular: tuple[float, float]
    removed: tuple[str, ...]
    names: tuple[str, ...]
    dependences: tuple[Dependence, ...]
    groupings: tuple[Grouping, ...]
    identities: tuple[Identity, ...]
    torque_error: float


def reduction(setting: Setting) -> Reduction:
    """Checks all printed equations on the reduction to base parameters with the computed regressor Y."""
    model, base = setting.hanging.dynamics, setting.hanging.base
    states = random_states(setting, seed=3)
    Y = model.regressor(states)
    flat = Y.reshape(-1, Y.shape[2])
    by_name: dict[str, Array] = dict(zip(base.standard_names, flat.T, strict=True))
    sizes = np.linalg.svd(flat, compute_uv=False)
    rank = int(np.count_nonzero(sizes > GAP * sizes[0]))
    zero = [name for name, column in by_name.items() if np.abs(column).max() <= ALIKE * np.abs(flat).max()]
    mu = physical_of_standard(model, setting.theta)
    tau = torque_of_bodies(make_frames(published()), states, mu, np.array(HANGING))
    reduced = setting.hanging.columns(states) @ base.values_of(standard_of_physical(model, mu))
    return Reduction(
        Y.shape[2],
        tuple(zero),
        rank,
        (float(sizes[rank - 1] / sizes[0]), float(sizes[rank] / sizes[0])),
        tuple(base.standard_names[k] for k in base.removed),
        base.names,
        tuple(_dependence(by_name, *line) for line in published().columns),
        tuple(_grouping(setting, name, terms) for name, terms in published().groupings.items()),
        derivation(setting),
        float(np.abs(reduced - tau).max() / np.abs(tau).max()),
    )


def standard_of_physical(model: DynamicsModel, physical: Array, *, printed: bool = False) -> Array:
    """Standard parameters π(μ) of equation (3.7) of the thesis, shape (84,).

    Args:
        model: Model with rigid bodies, viscous and Coulomb friction.
        physical: Physical parameters, one row for each link in the order of equation (3.40), shape (7, 12).
        printed: If true, YY_i is computed as the thesis prints it, with r_y² + r_z²; the correct sum is r_x² + r_z².
    """
    names: list[str] = [parameter.name for parameter in model.parameters]
    theta = np.zeros(len(names))
    for k, own in enumerate(model.inertial_columns.reshape(-1, 10)):
        m, rx, ry, rz, xx, xy, xz, yy, yz, zz, fv, fs = physical[k]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        theta[own] = com_inertia_to_vector(m, np.array([rx, ry, rz]), tensor)
        if printed:
            theta[names.index(f"YY_{k + 1}")] = yy + m * (ry**2 + rz**2)
        theta[names.index(f"FV_{k + 1}")], theta[names.index(f"FS_{k + 1}")] = fv, fs
    return theta


def physical_of_standard(model: DynamicsModel, theta: Array) -> Array:
    """Physical parameters (7, 12) for standard parameters (p,): one row for each link in the order of (3.40)."""
    names: list[str] = [parameter.name for parameter in model.parameters]
    rows: list[list[float]] = []
    for k, own in enumerate(model.inertial_columns.reshape(-1, 10)):
        mass, com, tensor = vector_to_com_inertia(theta[own])
        upper = [tensor[i, j] for i in range(3) for j in range(i, 3)]
        rows.append([mass, *com, *upper, *(theta[names.index(f"{symbol}_{k + 1}")] for symbol in ("FV", "FS"))])
    return np.array(rows)


def _dependence(columns: dict[str, Array], name: str, label: str, right: Sum, printed: Sum | None) -> Dependence:
    meant = label if label in columns else name  # a wrong label is replaced by the right one
    return Dependence(
        name,
        label,
        "" if printed is None else formula(printed),
        formula(right),
        np.nan if printed is None else _column_error(columns, meant, printed),
        _column_error(columns, name, right),
    )


def _column_error(columns: dict[str, Array], name: str, terms: Sum) -> float:
    """Largest difference between a regressor column and a sum of columns, divided by the largest element of both.

    Args:
        columns: Columns of the regressor by name.
        name: Name of the column.
        terms: The sum of columns.
    """
    zero = np.zeros_like(columns[name])
    total = sum((weight(each, published().lengths) * columns[each.name] for each in terms), zero)
    difference = float(np.abs(columns[name] - total).max())
    if difference <= ALIKE * max(float(np.abs(column).max()) for column in columns.values()):
        return difference
    return difference / max(float(np.abs(columns[name]).max()), float(np.abs(total).max()))


def _grouping(setting: Setting, name: str, terms: Sum) -> Grouping:
    base = setting.hanging.base
    row = np.zeros(len(base.standard_names))
    for each in terms:
        row[base.standard_names.index(each.name)] += weight(each, published().lengths)
    return Grouping(name, formula(terms), float(np.abs(row - base.regrouping[base.names.index(name)]).max()))

"""Columns of the base parameters along a series, and the exact gradient of anything made of them.

Rigid bodies go through the kernel's adjoint, the other terms through the derivatives of their laws. Buffers are kept:
fresh arrays of some megabytes cost more than what is computed into them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.excitation.criteria import Spectral
from armid.excitation.softening import softened
from armid.information.setup import ColumnSource
from armid.model.expression import Expression, derivative, evaluate
from armid.values import Array

__all__ = ["Columns"]

STATES = ("q", "dq", "ddq")


@dataclass(frozen=True, eq=False, slots=True)
class _Group:
    """Columns that share a law: values and slopes are evaluated for all of them at once.

    Attributes:
        rows: Which of the terms' rows, shape (e,).
        columns: Where they stand among the columns of all joints, shape (e,).
        coordinate: Joints that make the coordinate of each, shape (e, n).
        weight: Factor of each row, shape (e, 1).
        law: The law, softened.
        slopes: Its derivatives by q, dq and ddq, `None` where zero.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    coordinate: Array
    weight: Array
    law: Expression
    slopes: tuple[Expression | None, ...]


def _groups(source: ColumnSource, width: float) -> tuple[_Group, ...]:
    """The terms' kept rows, by law."""
    by_law: dict[Expression, list[int]] = {}
    entries = [source.model.entries[e] for e in source.layout.kept]
    for row, (_, _, law, _) in enumerate(entries):
        by_law.setdefault(law.expression, []).append(row)
    groups: list[_Group] = []
    for expression, rows in by_law.items():
        law = softened(expression, width)
        slopes = [derivative(law, state) for state in STATES]
        coordinate = np.zeros((len(rows), source.model.n))
        for at, row in enumerate(rows):
            for j, weight in entries[row][2].coordinate:
                coordinate[at, j] = weight
        groups.append(
            _Group(
                np.array(rows),
                source.layout.term[rows].astype(np.intp),
                coordinate,
                np.array([[entries[row][3]] for row in rows]),
                law,
                tuple(None if slope == Expression(0.0) else slope for slope in slopes),
            )
        )
    return tuple(groups)


class Columns:
    """Columns along N samples, the information in them, and gradients back to the states.

    Args:
        source: Model and layout of the columns.
        samples: N.
        width: Width over which laws with corners are spread [rad/s or m/s]; 0 leaves them as they are.
    """

    def __init__(self, source: ColumnSource, samples: int, width: float = 0.0) -> None:
        self.source = source
        self.samples = samples
        self._layout = source.layout
        self._count = len(source.names)
        self._groups = _groups(source, width)
        self._torque = np.zeros((samples, source.tree.n))
        self._terms = np.zeros((len(self._layout.term), samples))
        self._x = np.empty((self._layout.columns, samples))
        self._cotangent = np.zeros((self._layout.columns, samples))
        offset = self._layout.offset
        self._blocks = tuple(
            (slice(int(offset[j]), int(offset[j + 1]) - 1), np.ix_(p, p), p)
            for j, p in enumerate(self._layout.parameters)
        )
        self._states = (self._torque, self._torque, self._torque)
        self._environments: list[dict[str, Array]] = []

    def fill(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Columns of all joints at states (N, n), torque last and zero, shape (columns, N); a view of a buffer."""
        self._states = (q, dq, ddq)
        self._environments = []
        for group in self._groups:
            environment = {name: group.coordinate @ x.T for name, x in zip(STATES, (q, dq, ddq), strict=True)}
            self._environments.append(environment)
            self._terms[group.rows] = group.weight * evaluate(group.law, environment)
        return kernel.columns(self.source.tree, self._layout, q, dq, ddq, self._torque, self._terms, out=self._x)

    def information(self, weights: Array) -> Array:
        """G = Σ_j weights_j Y_jᵀ Y_j of what `fill` has left, shape (b, b)."""
        G = np.zeros((self._count, self._count))
        for weight, (rows, block, _) in zip(weights, self._blocks, strict=True):
            x = self._x[rows]
            G[block] += weight * (x @ x.T)
        return G

    def information_gradient(self, slopes: Array | Spectral, weights: Array) -> tuple[Array, Array, Array]:
        """Gradient by q, dq, ddq (N, n) of a function of G with derivative `slopes`, (b, b) or of low rank."""
        for weight, (rows, block, p) in zip(weights, self._blocks, strict=True):
            if isinstance(slopes, Spectral):
                left = (2.0 * weight) * slopes.vectors[p] * slopes.slopes
                np.matmul(left, slopes.vectors[p].T @ self._x[rows], out=self._cotangent[rows])
            else:
                np.matmul((2.0 * weight) * slopes[block], self._x[rows], out=self._cotangent[rows])
        return self._pull(self._cotangent)

    def torque(self, values: Array) -> Array:
        """Torque (N, n) of base parameters (b,)."""
        return np.stack([values[p] @ self._x[rows] for rows, _, p in self._blocks], axis=1)

    def torque_gradient(self, values: Array, joint: int, slopes: Array) -> tuple[Array, Array, Array]:
        """Gradient by q, dq, ddq (N, n) of Σ slopes · torque of one joint, slopes (N,)."""
        cotangent = np.zeros_like(self._cotangent)
        rows, _, p = self._blocks[joint]
        np.multiply(values[p][:, None], slopes, out=cotangent[rows])
        return self._pull(cotangent)

    def _pull(self, cotangent: Array) -> tuple[Array, Array, Array]:
        """Gradient of Σ cotangent · columns by the states."""
        gradient = kernel.columns_adjoint(self.source.tree, self._layout, *self._states, cotangent)
        for group, environment in zip(self._groups, self._environments, strict=True):
            worth = group.weight * cotangent[group.columns]
            for slope, part in zip(group.slopes, gradient, strict=True):
                if slope is not None:
                    part += (worth * evaluate(slope, environment)).T @ group.coordinate
        return gradient

"""Test of many additional columns, of one joint or of all, by the decrease of the residual that they give.

The regressor columns of the model are projected out of all additional columns at once, so that some hundred columns
are tested in a few milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armid.checked_array import Array
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import RIDGE

LEFT = 1e-3
"""Smallest share of the power of a column that counts as left beside the columns of the model."""


@dataclass(frozen=True, eq=False)
class AddedColumns:
    """Tests of additional columns of the torque beside the fitted model, of one joint or of all joints.

    Attributes:
        state: The log with the model.
    """

    state: LogState

    @cached_property
    def inverse(self) -> Array:
        """Inverse of the weighted normal matrix of the base parameters, shape (b, b)."""
        rows, sigma = self.state.rows, self.state.fit.sigma
        total = np.zeros((rows.count, rows.count))
        for parameters, columns, mask, size in zip(rows.parameters, rows.columns, rows.mask.T, sigma, strict=True):
            own = columns * (mask / size)
            total[np.ix_(parameters, parameters)] += own @ own.T
        scale = np.sqrt(total.diagonal())
        scale = np.where(scale > 0.0, scale, 1.0)
        scaled = total / np.outer(scale, scale) + RIDGE * np.eye(len(total))
        return np.asarray(np.linalg.inv(scaled), dtype=np.float64) / np.outer(scale, scale)

    def decrease_together(self, j: int, columns: Array) -> float:
        """Decrease of the squared residual, as `decreases` states it, by all columns (k, M) of a law together."""
        rows, fit = self.state.rows, self.state.fit
        mask, parameters = rows.mask[:, j] / fit.sigma[j], rows.parameters[j]
        added = columns * mask
        beside = (rows.columns[j] * mask) @ added.T
        whole = added @ added.T
        left = whole - beside.T @ self.inverse[np.ix_(parameters, parameters)] @ beside
        along = added @ (fit.residual[:, j] / fit.sigma[j])
        inverse = np.linalg.pinv(left + RIDGE * np.diag(whole.diagonal()), hermitian=True)
        return float(along @ inverse @ along) / max(int(rows.mask[:, j].sum()), 1)

    def decreases_of_laws(self, j: int, laws: Sequence[Array]) -> Array:
        """Decreases of the squared residual by laws, as `decrease_together` gives them, in less time.

        Args:
            j: Index of the joint on whose torque the laws act.
            laws: Columns of each law, shape (k, M).
        """
        rows, fit = self.state.rows, self.state.fit
        mask, parameters = rows.mask[:, j] / fit.sigma[j], rows.parameters[j]
        added = np.concatenate(laws) * mask
        beside = (rows.columns[j] * mask) @ added.T
        covered = self.inverse[np.ix_(parameters, parameters)] @ beside
        along = added @ (fit.residual[:, j] / fit.sigma[j])
        power = np.sum(added * added, axis=1)
        ends = np.cumsum([len(law) for law in laws])
        decreases = np.zeros(len(laws))
        for k, (first, stop) in enumerate(zip(ends - [len(law) for law in laws], ends, strict=True)):
            own = slice(first, stop)
            left = added[own] @ added[own].T - beside[:, own].T @ covered[:, own] + RIDGE * np.diag(power[own])
            decreases[k] = along[own] @ (np.linalg.pinv(left, hermitian=True) @ along[own])
        return decreases / max(int(rows.mask[:, j].sum()), 1)

    def decrease_of_all(self, columns: Array) -> tuple[float, Array]:
        """Decrease of the squared residual, as `decreases` states it, by columns that act on all joints together.

        Args:
            columns: Columns, shape (e, M, n) [N·m or N for a unit of the coefficient].

        Returns:
            The decrease, divided by the mean number of rows of a joint, and the coefficients, shape (e,).
        """
        rows, fit = self.state.rows, self.state.fit
        e = len(columns)
        beside, whole, along = np.zeros((rows.count, e)), np.zeros((e, e)), np.zeros(e)
        for j in range(rows.n):
            mask = rows.mask[:, j] / fit.sigma[j]
            added = columns[:, :, j] * mask
            beside[rows.parameters[j]] += (rows.columns[j] * mask) @ added.T
            whole += added @ added.T
            along += added @ (fit.residual[:, j] / fit.sigma[j])
        left = whole - beside.T @ self.inverse @ beside
        values = np.linalg.pinv(left + RIDGE * np.diag(whole.diagonal()), hermitian=True) @ along
        return float(along @ values) / max(float(rows.mask.sum()) / rows.n, 1.0), np.asarray(values)

    def decreases_of_two(self, joints: tuple[int, int], columns: Array) -> Array:
        """Decreases of the squared residual, as `decrease_of_all` states them, by columns that act on two joints.

        Each column acts on either joint with a coefficient of its own.

        Args:
            joints: Indices of the two joints.
            columns: Columns, shape (f, M).

        Returns:
            Decreases, shape (f,).
        """
        rows, fit = self.state.rows, self.state.fit
        masks = [rows.mask[:, k] / fit.sigma[k] for k in joints]
        added = [columns * mask for mask in masks]
        beside = [(rows.columns[k] * m) @ x.T for k, m, x in zip(joints, masks, added, strict=True)]
        along = [x @ (fit.residual[:, k] / fit.sigma[k]) for k, x in zip(joints, added, strict=True)]
        (a, b), (p, q) = beside, (rows.parameters[k] for k in joints)
        power = [np.sum(x * x, axis=1) for x in added]
        first = np.maximum(power[0] - np.sum(a * (self.inverse[np.ix_(p, p)] @ a), axis=0), LEFT * power[0])
        second = np.maximum(power[1] - np.sum(b * (self.inverse[np.ix_(q, q)] @ b), axis=0), LEFT * power[1])
        mixed = -np.sum(a * (self.inverse[np.ix_(p, q)] @ b), axis=0)
        determinant = first * second - mixed**2
        determinant = np.where(determinant > RIDGE * first * second, determinant, np.inf)
        gained = along[0] ** 2 * second - 2.0 * along[0] * along[1] * mixed + along[1] ** 2 * first
        return np.asarray(gained / determinant / max(float(rows.mask.sum()) / rows.n, 1.0))

    def decreases(self, j: int, columns: Sequence[Array] | Array) -> tuple[Array, Array]:
        """Decrease of the squared residual by each column alone, and the coefficient of the column.

        The decrease is that of all joints, each weighted by its residual, divided by the number of rows of joint j.
        It is 1 if the column removes the whole residual of joint j, and can be larger if the residual of other
        joints falls, too.

        Args:
            j: Index of the joint on whose torque the columns act.
            columns: Columns, shape (f, M) [N·m or N for a unit of the coefficient].

        Returns:
            Decreases and coefficients, shape (f,) each.
        """
        rows, fit = self.state.rows, self.state.fit
        mask, parameters = rows.mask[:, j] / fit.sigma[j], rows.parameters[j]
        added = np.asarray(columns) * mask
        beside = (rows.columns[j] * mask) @ added.T
        power = np.sum(added * added, axis=1)
        inverse = self.inverse[np.ix_(parameters, parameters)]
        left = power - np.sum(beside * (inverse @ beside), axis=0)
        along = added @ (fit.residual[:, j] / fit.sigma[j])
        left = np.where(left > RIDGE * power, left, np.inf)
        return along**2 / left / max(int(rows.mask[:, j].sum()), 1), along / left

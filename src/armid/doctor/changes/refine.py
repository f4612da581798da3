"""Fitted change within a log: residual, effect on the torque, error on left-out motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.scan import ChangeCandidate, block_of
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickFit, QuickRows, solve


@dataclass(frozen=True, eq=False)
class FittedChange:
    """Possible change within a log, fitted to a log.

    Attributes:
        state: The log.
        candidate: The change.
    """

    state: LogState
    candidate: ChangeCandidate

    @cached_property
    def size(self) -> Array:
        """Size of the change in each row, shape (M,), from 0 to 1."""
        rows = self.state.rows
        return self.candidate.shape.size[block_of(len(rows.torque))]

    @property
    def changed(self) -> NDArray[np.bool_]:
        """Mask of the rows that the change concerns at all, shape (M,)."""
        return self.size > 0.0

    @cached_property
    def factor(self) -> Array:
        """Factor on the torque of each joint in each row that takes the change of a gain back, shape (M, n)."""
        result = np.ones_like(self.state.rows.torque)
        if self.candidate.alternative.kind == "gain":
            step = 1.0 / float(self.candidate.values[0]) - 1.0
            result[:, list(self.candidate.alternative.joints)] += step * self.size[:, None]
        return result

    @cached_property
    def rows(self) -> QuickRows:
        """Rows in which the change is taken back, or can be taken back by additional columns."""
        rows, each = self.state.rows, self.candidate.alternative
        if each.kind == "gain":
            return replace(rows, torque=rows.torque * self.factor)
        if each.kind == "order":
            return replace(rows, torque=rows.torque + each.columns[0] * self.size[:, None])
        extra = each.columns * self.size[:, None]
        numbers = np.arange(rows.count, rows.count + len(extra), dtype=np.int32)
        concerned = np.atleast_1d(extra.any(axis=(0, 1)))
        columns = [np.vstack([x, extra[:, :, j]]) if concerned[j] else x for j, x in enumerate(rows.columns)]
        parameters = [np.append(p, numbers) if concerned[j] else p for j, p in enumerate(rows.parameters)]
        return replace(rows, columns=tuple(columns), parameters=tuple(parameters), count=rows.count + len(extra))

    @cached_property
    def fit(self) -> QuickFit:
        """Fit with the change."""
        return solve(self.rows)

    @cached_property
    def gain(self) -> float:
        """Decrease of the mean over the joints of the logarithm of the RMS residual by the change.

        A gain changes the unit of the residual of the changed part, which is taken into account.
        """
        mask = self.state.rows.mask
        unit = (np.log(np.abs(self.factor)) * mask).sum(axis=0) / np.maximum(mask.sum(axis=0), 1)
        return self.state.fit.cost - self.fit.cost + float(unit.mean())

    @cached_property
    def values(self) -> Array:
        """Coefficients of the alternative in this fit; for a gain, the factor."""
        if self.candidate.alternative.kind in ("gain", "order"):
            return self.candidate.values
        return self.fit.values[self.state.rows.count :]

    @cached_property
    def torque(self) -> Array:
        """Torque by which the changed part differs from the rest where the change is complete, shape (M, n)."""
        each, torque = self.candidate.alternative, self.state.rows.torque
        if each.kind == "gain":
            return torque * (1.0 - self.factor)
        values = -self.values if each.kind == "order" else self.values
        return np.tensordot(values, each.columns, 1) * self.size[:, None]

    @cached_property
    def share(self) -> Array:
        """RMS of this torque in the changed part over the standard deviation of the torque of each joint, (n,)."""
        rows = self.state.rows
        result = np.zeros(rows.n)
        for j in range(rows.n):
            inside, used = rows.mask[:, j] & self.changed, rows.mask[:, j]
            if inside.any():
                usual = float(rows.torque[used, j].std())
                result[j] = np.sqrt(np.mean(self.torque[inside, j] ** 2)) / (usual or 1.0)
        return result

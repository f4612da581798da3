"""Remedies tried on left-out motion before they are offered.

A model is fitted to some blocks of a log and judged on the others, with the remedy and without it. What makes the
error on these larger is no remedy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.doctor.quick_fit import QuickRows, solved, tables
from armid.measurement.remedy import BY_HAND

__all__ = ["BY_ERROR_ALONE", "UNTRIED", "RemedyTrial", "left_out", "needs_reason", "try_out"]

FOLDS = 5
"""Parts of a log, each left out once."""

BLOCK_ROWS = 24
"""Rows of a block; every fifth block is left out together: a second at the usual rate, longer than residuals last."""

RIDGE = 1e-6
"""Added to products of unit columns: what the other blocks hardly show must not decide."""

WORTH = 0.002
"""Change of the error, as a logarithm, below which left-out motion is indifferent."""

WORSE = 0.01
"""Rise of the error, as a logarithm, from which an explanation is not believed, whatever else speaks for it."""

UNTRIED: Mapping[str, str] = {
    "clock-missing": "without it the log cannot be read",
    "degrees": "as it stands the log lies outside all limits",
    "clock-unit": "without it the log cannot be read",
    "clock-rate": "without it the log cannot be read",
    "value-missing": "without it the log cannot be read",
    "channel-dead": "the rows that it leaves out hold no measurement",
    "saturation": "the rows that it leaves out hold no measurement",
    "standstill": "rows at rest are little of any error",
    "velocity-mismatch": "the comparison derives velocities from positions",
    "period-misaligned": "the comparison averages no repetitions",
    "rows-not-consecutive": "rows that do not follow each other leave no motion out",
}
"""By code: why left-out motion does not judge the remedy."""


BY_ERROR_ALONE = frozenset({"channel-delay", "degrees", "joint-order", "position-sign"})
"""Explanations that nothing but the error speaks for: left-out motion must show it, too. Signs of torques, zeros and
gravity also show in friction, inertias and weights."""


@dataclass(frozen=True, slots=True)
class RemedyTrial:
    """Error on left-out motion over its torque, as a logarithm: the mean over the joints.

    Attributes:
        before: As the log is read.
        after: With the remedy.
    """

    before: float
    after: float

    @property
    def helps(self) -> bool:
        """Tell whether the error falls."""
        return self.after < self.before - WORTH

    @property
    def harms(self) -> bool:
        """Tell whether the error rises by so much that nothing else can speak for the remedy."""
        return self.after > self.before + WORSE

    def __str__(self) -> str:
        told = f"{np.exp(self.before):.2%} of the torque without the remedy, {np.exp(self.after):.2%} with it"
        if abs(self.after - self.before) <= WORTH:
            return f"Left-out motion does not judge the remedy: the error is {told}."
        return f"On left-out motion the error is {told}."


def try_out(before: QuickRows, after: QuickRows) -> RemedyTrial:
    """Errors with and without a remedy, on the rows that count with both.

    Rows that a remedy leaves out are fitted to without it, and judged in neither.

    Args:
        before: As the log is read.
        after: With the remedy.
    """
    same = before.mask.shape == after.mask.shape
    return RemedyTrial(left_out(before, after.mask if same else None), left_out(after))


def left_out(rows: QuickRows, judged: NDArray[np.bool_] | None = None) -> float:
    """Error on rows that a model was not fitted to, over their torque: mean over the joints, as a logarithm.

    Args:
        rows: Columns and torque.
        judged: Rows that are judged, of those that count, shape (M, n); all if not given.
    """
    part = np.arange(len(rows.torque)) // BLOCK_ROWS % FOLDS
    inside = [part == k for k in range(FOLDS)]
    pairs = [[table[:, rows_of] @ table[:, rows_of].T for rows_of in inside] for table in tables(rows)]
    if judged is None or judged[rows.mask].all():
        seen = pairs
    else:
        few = tables(rows, mask=rows.mask & judged)
        seen = [[table[:, rows_of] @ table[:, rows_of].T for rows_of in inside] for table in few]
    left, size = np.zeros((2, rows.n))
    for k in range(FOLDS):
        counted = rows.mask[~inside[k]].sum(axis=0)
        others = tuple(sum(own) - own[k] for own in pairs)
        x, _ = solved(rows, others, np.maximum(counted, 1), ridge=RIDGE)
        for j, own in enumerate(seen):
            weights = np.append(-x[rows.parameters[j]], 1.0)
            left[j] += max(float(weights @ own[k] @ weights), 0.0)
            size[j] += own[k][-1, -1]
    tiny = np.finfo(float).tiny
    return float(np.mean(np.log(np.sqrt(np.maximum(left, tiny) / np.maximum(size, tiny)))))


def needs_reason(code: str, evidence: str, remedy: str) -> str:
    """Tell why a remedy was not tried, as a sentence; empty where it was, or is done by hand."""
    if not remedy or remedy.startswith(BY_HAND) or code not in UNTRIED or "eft-out motion" in evidence:
        return ""
    return f" Not tried on left-out motion: {UNTRIED[code]}."

"""Test of a remedy on held-out motion before it is offered.

A model is fitted to some blocks of a log and evaluated on the other blocks, with and without the remedy. A remedy
that increases the held-out error is rejected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.doctor.quick_fit import QuickRows, solve_products, tables
from armid.errors import Finding
from armid.remedy import Remedy

FOLDS = 5
"""Number of parts of a log; each part is left out once."""

BLOCK_ROWS = 24
"""Number of rows of a block: one second at the usual rate, which is longer than the correlation time of the
residuals. Every fifth block belongs to the same part."""

RIDGE = 1e-6
"""Number that is added to the products of unit columns, so that hardly determined parameters stay small."""

WORTH = 0.002
"""Change of the logarithm of the error below which held-out motion is no evidence."""

HELPS, WORSE, CERTAIN = -WORTH, 0.01, 0.05
"""Increase of the logarithm of the error from which an explanation is rejected: if a smaller error is the only
evidence, if it has other evidence, and if other evidence leaves no doubt."""


@dataclass(frozen=True, slots=True)
class RemedyTrial:
    """Errors on held-out motion with and without a remedy.

    Each error is the logarithm of the relative torque error, averaged over the joints.

    Attributes:
        before: Error of the log as it is read.
        after: Error with the remedy.
        independent: False if the correction was computed from all rows, so that the error with it is too small.
    """

    before: float
    after: float
    independent: bool = True

    @property
    def helps(self) -> bool:
        """True if the remedy reduces the error."""
        return self.after < self.before + HELPS

    @property
    def harms(self) -> bool:
        """True if the remedy increases the error so much that it is rejected."""
        return self.after > self.before + WORSE

    def __str__(self) -> str:
        if not self.independent:
            return "The correction was computed from all rows, so left-out motion is no test of it."
        if abs(self.after - self.before) <= WORTH:
            return f"The remedy does not change the error on left-out motion: {np.exp(self.after):.2%} of the torque."
        return (
            f"On left-out motion, the error is {np.exp(self.before):.2%} of the torque without the remedy and "
            f"{np.exp(self.after):.2%} with it."
        )


def try_remedy(before: QuickRows, after: QuickRows) -> RemedyTrial:
    """Computes the held-out errors with and without a remedy, on the rows that are used in both cases.

    Rows that the remedy leaves out are used in the fit without the remedy, but neither error includes them.

    Args:
        before: Rows of the log as it is read.
        after: Rows with the remedy.
    """
    same = before.mask.shape == after.mask.shape
    return RemedyTrial(heldout_error(before, after.mask if same else None), heldout_error(after))


def heldout_error(rows: QuickRows, judged: NDArray[np.bool_] | None = None) -> float:
    """Logarithm of the relative torque error on rows that were left out of the fit, averaged over the joints.

    Args:
        rows: Columns and torque.
        judged: Mask of the rows on which the error is computed, shape (M, n); if not given, all rows of `rows.mask`.
    """
    part = np.arange(len(rows.torque)) // BLOCK_ROWS % FOLDS
    inside = [part == k for k in range(FOLDS)]
    pairs = [[table[:, rows_of] @ table[:, rows_of].T for rows_of in inside] for table in tables(rows)]
    if judged is None or judged[rows.mask].all():
        evaluated = pairs
    else:
        counted_tables = tables(rows, mask=rows.mask & judged)
        evaluated = [[table[:, rows_of] @ table[:, rows_of].T for rows_of in inside] for table in counted_tables]
    error, size = np.zeros((2, rows.n))
    for k in range(FOLDS):
        counted = rows.mask[~inside[k]].sum(axis=0)
        others = tuple(sum(fold_pairs) - fold_pairs[k] for fold_pairs in pairs)
        x, _ = solve_products(rows, others, np.maximum(counted, 1), ridge=RIDGE)
        for j, fold_pairs in enumerate(evaluated):
            weights = np.append(-x[rows.parameters[j]], 1.0)
            error[j] += max(float(weights @ fold_pairs[k] @ weights), 0.0)
            size[j] += fold_pairs[k][-1, -1]
    tiny = np.finfo(float).tiny
    return float(np.mean(np.log(np.sqrt(np.maximum(error, tiny) / np.maximum(size, tiny)))))


def with_reason(finding: Finding, reasons: Mapping[str, str]) -> Finding:
    """Adds to a finding the reason why its remedy was not tested; remedies by hand need no reason.

    Args:
        finding: The finding.
        reasons: Reasons why a remedy is not tested, by code.
    """
    code, remedy = finding.code, finding.remedy
    if not isinstance(remedy, Remedy) or not remedy.keys or remedy.judged or code not in reasons:
        return finding
    evidence = f"{finding.evidence} The remedy was not tested on left-out motion: {reasons[code]}."
    return replace(finding, evidence=evidence, remedy=remedy.marked())

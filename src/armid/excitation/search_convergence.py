"""Finding for a search that ran out of time while its best plan was still improving."""

from __future__ import annotations

import math

from armid.errors import Finding
from armid.excitation.design.multistart import Search

STILL = 0.05
"""Relative improvement in the second half of the time from which a plan counts as still improving."""

LONGER = 60.0
"""Smallest wall time that the remedy proposes [s]."""

OF_VARIANCES = ("d-optimal", "a-optimal", "e-optimal", "prediction")
"""Criteria that are logarithms of variances; the others are logarithms of standard deviations or of their ratios."""


def unsettled(search: Search, criterion: str, budget: float | None) -> Finding | None:
    """Finding that a search ran out of time before its plan converged; `None` otherwise.

    A plan has not converged where no descent was completed in time, or where the second half of the time, counted
    from the first completed descent, still improved it by `STILL`, relative to the predicted standard deviations or
    the condition number.

    Args:
        search: The search.
        criterion: Name of the criterion.
        budget: Wall time of the search [s].
    """
    if budget is None or search.interrupted or search.seconds < budget:
        return None
    remedy = f"search longer, as with --budget {max(LONGER, 2.0 * budget):g}."
    ends = [(seconds, value) for seconds, value in search.history[1:] if seconds < budget]
    if not ends:
        evidence = (
            f"Time ended the search after {budget:g} s, before any descent had come to its end: the plan may be far "
            "from the best"
        )
        return Finding("search-unsettled", "warning", "", evidence, remedy)
    since = max(ends[0][0], 0.5 * budget)
    before = [value for seconds, value in ends if seconds <= since][-1]
    after = sum(seconds > since for seconds, _ in search.history[1:])
    change = (before - search.history[-1][1]) / (2.0 if criterion in OF_VARIANCES else 1.0)
    gain = -math.expm1(-change)
    if gain < STILL:
        return None
    measure = "condition number" if "condition" in criterion else "predicted standard deviations"
    descents = "descent" if after == 1 else f"{after} descents"
    evidence = (
        f"The plan was still improving when time ended the search after {budget:g} s: the last {descents} made its "
        f"{measure} smaller by {100.0 * gain:.0f} %"
    )
    return Finding("search-unsettled", "warning", "", evidence, remedy)

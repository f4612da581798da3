"""Account of a search that its time ended: whether its best plan was still becoming better."""

from __future__ import annotations

import math

from armid.errors import Finding
from armid.excitation.design.multistart import Search

__all__ = ["unsettled"]

STILL = 0.05
"""Relative change of the criterion's measure in the second half of the time from which a plan was still improving."""

LONGER = 60.0
"""Wall time that is proposed at least [s]."""

OF_VARIANCES = ("d-optimal", "a-optimal", "e-optimal", "prediction")
"""Criteria that are logarithms of variances; the others are of deviations or their ratios."""


def unsettled(search: Search, criterion: str, budget: float | None) -> Finding | None:
    """That time ended a search before its plan had settled; nothing where it had, or something else ended it.

    It had not where no descent came to its end, or where the second half of the time, counted from the first descent
    that did, still made the plan better by `STILL`: a predicted deviation or condition number by that share.

    Args:
        search: The search.
        criterion: What was made small.
        budget: Its wall time [s].
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

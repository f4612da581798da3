"""Finding for a search that ended at its time limit while its best plan was still improving."""

from __future__ import annotations

import math

from armid.errors import Finding
from armid.excitation.design.multistart import Search

STILL = 0.05
"""Smallest relative decrease of the standard deviations or the condition number in the second half of the search time
with which a plan counts as still improving."""

LONGER = 60.0
"""Shortest wall time that the remedy proposes [s]."""

OF_VARIANCES = ("d-optimal", "a-optimal", "e-optimal", "prediction")
"""Names of the criteria that are logarithms of variances; all other criteria are logarithms of standard deviations or
of ratios of standard deviations."""


def unsettled(search: Search, criterion: str, budget: float | None) -> Finding | None:
    """Finding that a search reached its time limit before its plan converged; `None` if the plan converged.

    A plan has not converged in two cases: no descent was completed in time; or in the second half of the time,
    counted from the first completed descent, the predicted standard deviations or the condition number still
    decreased by the share `STILL` or more.

    Args:
        search: Result of the search.
        criterion: Name of the criterion.
        budget: Largest wall time of the search [s]; `None` for no limit.
    """
    if budget is None or search.interrupted or search.seconds < budget:
        return None
    remedy = f"give the search more time, for instance --budget {max(LONGER, 2.0 * budget):g}."
    ends = [(seconds, value) for seconds, value in search.history[1:] if seconds < budget]
    if not ends:
        evidence = (
            f"The search reached its time limit of {budget:g} s before the first local search was completed: the "
            "plan may be far from the best one"
        )
        return Finding("search-unsettled", "warning", "", evidence, remedy)
    since = max(ends[0][0], 0.5 * budget)
    before = [value for seconds, value in ends if seconds <= since][-1]
    after = sum(seconds > since for seconds, _ in search.history[1:])
    change = (before - search.history[-1][1]) / (2.0 if criterion in OF_VARIANCES else 1.0)
    gain = -math.expm1(-change)
    if gain < STILL:
        return None
    measure = "condition number of the plan" if "condition" in criterion else "predicted standard deviations"
    measure += "" if "condition" in criterion else " of the parameters"
    descents = "local search" if after == 1 else f"{after} local searches"
    evidence = (
        f"The plan was still improving when the search reached its time limit of {budget:g} s: the last {descents} "
        f"reduced the {measure} by {100.0 * gain:.0f} %"
    )
    return Finding("search-unsettled", "warning", "", evidence, remedy)

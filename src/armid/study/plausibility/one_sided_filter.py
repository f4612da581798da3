"""Bias of an estimate for which only the torque was filtered, and not the columns of the regressor.

A filtered torque no longer has the jumps of Coulomb friction at the reversals, nor the fast part of the inertial
torque; columns without a filter still have them. The error on held-out motion is about the same as on the training
motion, so that a validation does not show it. Here the filter is applied to the columns too, and both estimates are
compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.errors import EstimationError, Finding
from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import residual_deviation, solve
from armid.estimation.problem import EstimationProblem
from armid.information.accumulate import accumulate_information
from armid.information.information import Information

CODE = "one-sided-filter"
"""Code of the finding that only the torque is filtered, and not the columns of the regressor."""

CHANGED = 0.1
"""The finding is an error if more than this share of the base parameters leave their 95 % intervals when the columns
are filtered, too. Without bias, half of this share would be outside."""

DOMINANT = 2.0
"""The finding is an error if the residual without the filter on the columns is more than this many times the residual
with it, because the bias is then most of the residual."""


def one_sided_filter_finding(information: Information, problem: EstimationProblem, fit: Fit) -> Finding | None:
    """Finding about the bias of an estimate for which only the torque was filtered, or `None` without such a filter.

    The severity is `error` if the filter causes most of the residual, or if more than a tenth of the base parameters
    leave their 95 % intervals when the columns of the regressor are filtered, too.

    Args:
        information: Information with one set of friction parameters for all recordings.
        problem: Estimation problem, with its samples.
        fit: The estimate.
    """
    model, base, observations = problem.require_samples("identify")
    band = observations.band
    if band.is_open or band.columns or not any(run.consecutive for run in observations.runs):
        return None
    both = replace(observations, band=replace(band, columns=True))
    weights = fit.weights
    try:
        one_sided = solve(information, weights)
        two_sided = solve(accumulate_information(model, base, both), weights)
    except EstimationError:
        return None  # the estimate itself says what the data do not determine
    change = np.abs(two_sided.values - one_sided.values)
    half: dict[str, float] = {}
    for name, ends in zip(fit.names, fit.intervals, strict=True):  # copies of recordings
        half[name.of_all] = min(half.get(name.of_all, np.inf), 0.5 * float(np.ptp(ends)))
    names = [str(name) for name in two_sided.whole.names]
    left = [name for name, by in zip(names, change, strict=True) if by > half.get(name, np.inf)]
    before, after = (float(np.linalg.norm(residual_deviation(each, each.whole))) for each in (one_sided, two_sided))
    relative = float(np.linalg.norm(change) / np.linalg.norm(two_sided.values))
    return Finding(
        CODE,
        "error" if before > DOMINANT * after or len(left) > CHANGED * len(names) else "warning",
        "",
        f"Only the torque is filtered ({band.cutoff:g} Hz), not the columns of the regressor (columns = false), so "
        "the estimate is biased. With the filter on both sides, the parameters change by "
        f"{100 * relative:.2g} % of their norm, {len(left)} of {len(names)} leave their 95 % intervals, and the "
        f"residual changes from {before:.3g} to {after:.3g} (root of the sum of squares over the joints). More "
        "friction laws or data do not remove the bias.",
        "set columns = true in [processing], without --preset thesis: torque and columns then pass the same filter.",
    )

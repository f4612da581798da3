"""Choice between two estimates of the bodies under selected friction: consistent bodies, or a Gaussian prior.

Both keep the bodies near the description. Consistent bodies predict other recordings better where data are weak,
because the cone excludes what no real body has; held-out blocks of the same recordings do not show this. Where data
are strong and no consistent body explains the torques, as with a description of another arm, the error on held-out
blocks decides for the Gaussian prior.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.catalogue import Estimator
from armid.estimation.crossvalidation import Fold, can_cross_validate, folds, held_out_squares, split
from armid.estimation.problem import EstimationProblem

MARGIN = 0.05
"""Mean over the joints of the logarithm of the ratio of squared held-out errors up to which the first estimator
counts as equal: 2.5 % of the error."""


def predicts_as_well(problem: EstimationProblem, first: Estimator, second: Estimator) -> bool:
    """Tests whether the held-out error of one estimator is about as small as that of another, or smaller.

    Args:
        problem: Data and standard parameters.
        first: Estimator that is preferred.
        second: The other estimator; it is not better where there are too few blocks to judge.
    """
    if not can_cross_validate(problem.information):
        return True
    parts = split(problem.information, folds(problem.information))
    if not parts:
        return True
    try:
        of_first, of_second = (
            np.sum([_held_out(problem, method, part) for part in parts], axis=0) for method in (first, second)
        )
    except EstimationError:
        return False
    counted = (of_first > 0.0) & (of_second > 0.0)
    return not counted.any() or float(np.log(of_first[counted] / of_second[counted]).mean()) <= MARGIN


def _held_out(problem: EstimationProblem, method: Estimator, part: Fold) -> Array:
    """Squared error of each joint on a fold that is left out, shape (n,)."""
    return held_out_squares(part.held_out, method.solve(replace(problem, information=part.training)).values)

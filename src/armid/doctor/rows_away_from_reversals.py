"""Rows of a log in which no reversal of the joint is near, so that static friction has no effect.

In the model, friction reverses with the velocity, so static friction at reversals causes a large part of the
residual. This part of the residual hides small effects of inertia, and it shifts estimates that depend on time, such
as delays.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from armid.doctor.check_input import ROWS
from armid.doctor.fitted_log import LogState
from armid.measurement.observations import ObservedRun

SLOW = 0.1
"""Share of the RMS speed of a joint below which the joint counts as near a reversal."""

SPREAD = 1.0
"""Time before and after slow rows that is also left out, in periods of the cut-off: the filter spreads the torque of
a reversal that far."""

SIGNIFICANT = 10.0
"""Smallest log-likelihood ratio of two models, for the number of independent rows, that unmodelled friction and noise
cannot cause. Some hundred models are compared at most, whose logarithm is 5."""


@lru_cache(maxsize=4)
def away_from_reversals(state: LogState) -> LogState:
    """The log without the rows in which a joint is near a reversal; each joint has its own mask of rows.

    While a joint sticks, its torque passes from one bound of static friction to the other, at a time that depends on
    the controller. In the model, friction reverses with the velocity, many milliseconds earlier or later. This
    difference is not a delay of the log. A joint with too few remaining rows for a fit keeps no rows.
    """
    rows = state.rows
    near = np.concatenate(rows_near_reversals(state.log.runs, state.log.cutoff))
    kept = (rows.mask & ~near).sum(axis=0)
    few = kept <= ROWS * np.array([len(parameters) for parameters in rows.parameters])
    return state.without(near | few)


def rows_near_reversals(runs: Sequence[ObservedRun], cutoff: float) -> list[NDArray[np.bool_]]:
    """Mask of each run: rows that are near a reversal or a rest of a joint, shape (M, n).

    Args:
        runs: Runs of one or several recordings; their RMS speeds define which speeds are low.
        cutoff: Cut-off of the band [Hz]; infinite if nothing is filtered.
    """
    slow = SLOW * np.sqrt(np.mean(np.concatenate([run.motion.dq for run in runs]) ** 2, axis=0))
    return [_any_within(np.abs(run.motion.dq) < slow, SPREAD / cutoff, run) for run in runs]


def judged_away_from_reversals(state: LogState) -> tuple[LogState, NDArray[np.bool_]]:
    """The log for the comparison of models, and a mask (n,) of the joints with enough rows away from reversals.

    The models do not contain stiction at reversals, which causes most of the residual of light arms. A wrong model
    may therefore have the smaller residual by chance. Joints without enough rows away from reversals keep all their
    rows.
    """
    moving = away_from_reversals(state)
    enough = moving.rows.mask.sum(axis=0) > 0
    if enough.all():
        return moving, enough
    return state.without(enough & ~moving.rows.mask), enough


def is_significant(judged: LogState, gain: float) -> bool:
    """True if the residual decreases by more than unmodelled friction and noise can explain.

    Args:
        judged: The log with the rows on which models are compared, and the model that has the larger residual.
        gain: Decrease of the logarithm of the RMS residual (mean over the joints) from this model to the other one.
    """
    return gain * float(np.sum(judged.rows.mask.sum(axis=0) / judged.fit.autocorrelation)) > SIGNIFICANT


def _any_within(flags: NDArray[np.bool_], seconds: float, run: ObservedRun) -> NDArray[np.bool_]:
    """Mask of the rows of a run, shape (M, n); true if any sample less than some seconds away is flagged."""
    reach, rows = int(np.ceil(seconds * run.rate)), run.rows
    counts = np.concatenate([np.zeros((1, flags.shape[1]), dtype=np.int64), flags.cumsum(axis=0)])
    return counts[np.minimum(rows + reach + 1, len(flags))] > counts[np.maximum(rows - reach, 0)]

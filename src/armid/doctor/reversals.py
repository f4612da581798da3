"""Rows of a log away from reversals of its joints, where friction is not that of rest.

Stiction at reversals is much of the residual of a model whose friction reverses with the velocity. It hides small
effects of inertia, and shifts what depends on time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.doctor.check_input import ROWS
from armid.doctor.log_interpretation import LogState
from armid.measurement.observations import ObservedRun

SLOW = 0.1
"""Speed over the RMS speed of a joint below which it is near a reversal."""

SPREAD = 1.0
"""Time around slow rows that is left out with them, in units of one over the cut-off: as far as the filter spreads
the torque of a reversal."""


def away_from_reversals(state: LogState) -> LogState:
    """The log without each joint's rows near its reversals.

    A joint that sticks stands still while its torque passes from one bound of friction to the other, and when it does
    so depends on the controller. Friction that reverses with the velocity misses this by a lead or lag of many
    milliseconds, which is no delay of the log. A joint that keeps too few rows for a fit keeps none.
    """
    runs, rows = state.log.runs, state.rows
    slow = SLOW * np.sqrt(np.mean(np.concatenate([run.motion.dq for run in runs]) ** 2, axis=0))
    near = np.concatenate([_any_within(np.abs(r.motion.dq) < slow, SPREAD / state.log.cutoff, r) for r in runs])
    kept = (rows.mask & ~near).sum(axis=0)
    few = kept <= ROWS * np.array([len(parameters) for parameters in rows.parameters])
    return state.without(near | few)


def _any_within(flags: NDArray[np.bool_], seconds: float, run: ObservedRun) -> NDArray[np.bool_]:
    """Flags at the rows of a run, set where any sample within some seconds is flagged."""
    reach, rows = int(np.ceil(seconds * run.rate)), run.rows
    counts = np.concatenate([np.zeros((1, flags.shape[1]), dtype=np.int64), flags.cumsum(axis=0)])
    return counts[np.minimum(rows + reach + 1, len(flags))] > counts[np.maximum(rows - reach, 0)]

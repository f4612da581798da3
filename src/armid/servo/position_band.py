"""Band of the position error of a simulated arm, from parts of the recordings that were left out of training."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.servo.closed_loop import simulate
from armid.servo.identify_servo import LEFT_OUT, ServoEstimate
from armid.servo.output_error import TRANSIENT, correlation_times
from armid.servo.servo_run import ServoRun

COVERED = 0.95
"""Share of the samples of another motion whose error is expected inside the band."""


def position_band(estimate: ServoEstimate, runs: Sequence[ServoRun]) -> Array:
    """Half width of the 95 % band of the measured position about the simulated one, shape (n,) [rad or m].

    The errors on the left-out parts, with parameters that were estimated without these parts, are the reference: the
    half width is their quantile of the level 0.95 (M + 1) / M, the largest error at most, where M is the number of
    independent errors [Vovk2005]. Errors are correlated, so M is the number of samples divided by the correlation
    time. The band holds for motion like that of the left-out parts.

    Args:
        estimate: The estimate.
        runs: Its training runs.
    """
    later = [run.part(round((1.0 - LEFT_OUT) * run.samples), run.samples) for run in runs]
    found = simulate(estimate.model, estimate.without_left_out, later)
    first = [min(round(TRANSIENT / run.step), run.samples // 2) for run in later]
    errors = [np.abs(run.q - each.q)[k:] for run, each, k in zip(later, found, first, strict=True)]
    independent = np.sum([len(each) / correlation_times(each - each.mean(axis=0)) for each in errors], axis=0)
    levels = np.minimum(1.0, COVERED * (independent + 1.0) / independent)
    every = np.concatenate(errors)
    return np.array([np.quantile(every[:, j], level) for j, level in enumerate(levels)])


def band_coverage(errors: Sequence[Array], band: Array) -> Array:
    """Share of the errors (N, n) of several runs, joint by joint, that are inside a band (n,); shape (n,)."""
    return np.mean(np.abs(np.concatenate(errors)) <= band, axis=0)

"""Other largest torques for joints whose simulated motion stays far from the measured one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.servo.output_error import OutputErrorFit, minimise_output_error, residuals_at
from armid.servo.servo_prior import LIMIT
from armid.servo.servo_run import FEWEST, ServoRun
from armid.servo.unknowns import Unknowns

FEW_STEPS = 8
"""Largest number of steps of a search whose result need not be exact."""

WINDOW = 1.0
"""Length of the windows of the first search for servos that reach their largest torque [s]. A saturated arm does not
come back to its command by itself, so a long simulated motion has little to do with the measured one at first."""

FAR = 1.5
"""Residual in RMS errors of the encoder from which a joint is far from its measured motion."""

CONCENTRATED = 0.6
"""Share of the squared residuals in the tenth of the rows with the largest ones from which they look like events. It
is 0.44 for normal residuals, at most 0.5 in legs with other errors of the model, and 0.9 and more where 1 to 4 % of
the rows of virtual arms were saturated against the model."""

CLEARLY = 0.1
"""Decrease of the sum of the logarithms of the RMS residuals from which other limits are taken."""

ROUNDS = 2
"""Largest number of times that other limits are taken."""

MOST_WINDOWS = 40
"""Largest number of windows; those of long recordings are spread over them."""

REACHED = 0.8
"""Share of the largest torque that position errors ask for at which the search for a largest torque begins: position
errors grow while a servo is saturated."""

SAME = 1e-9
"""Change of a position that is rounding [rad or m]."""


def with_other_limits(
    unknowns: Unknowns, runs: Sequence[ServoRun], fit: OutputErrorFit, progress: Callable[[float], None]
) -> tuple[Unknowns, OutputErrorFit]:
    """Unknowns and fit with the largest torques that make the smallest output error.

    The first estimate sees saturation only where many rows show it, and takes stiction for it at times. A search does
    not find a limit that no simulated row reaches. So, if residuals are far above the errors of the encoders, and
    most of them in few rows, the search begins again in windows: without the limit of a joint that reaches it, with a
    lower one where no row reaches it, and with that of the description where there is none.

    Args:
        unknowns: Unknowns of the fit.
        runs: Training runs.
        fit: Minimum with the largest torques of the first estimate.
        progress: Function that is called with the share of the steps that are done.
    """
    for _ in range(ROUNDS):
        own, other = _own_limits(unknowns, fit), _other_limits(unknowns, runs, fit)
        residuals = np.concatenate(residuals_at(unknowns, fit.x, runs))
        far = (fit.rms > FAR * encoder_errors(runs)) & (other != own)
        if not (far & (_concentration(residuals) > CONCENTRATED)).any():
            break
        limit = np.where(far, other, own)
        changed = _with_limits(unknowns, limit)
        start = _coordinates(changed, limit, unknowns, fit.x)
        found = search_from_windows(changed, runs, start, FEW_STEPS, progress)
        if found is None or np.sum(np.log(found.rms / fit.rms)) > -CLEARLY:
            break
        unknowns, fit = changed, found
        if not fit.settled:
            fit = minimise_output_error(unknowns, runs, start=fit.x, progress=progress)
    return unknowns, fit


def search_from_windows(
    unknowns: Unknowns,
    runs: Sequence[ServoRun],
    start: Array | None,
    most_steps: int,
    progress: Callable[[float], None],
) -> OutputErrorFit | None:
    """Minimum that is found by way of windows of the runs; `None` if the simulated motion diverges.

    Args:
        unknowns: Unknowns with their prior.
        runs: Training runs.
        start: Unknowns at which the search of the windows starts; the prior mean if not given.
        most_steps: Largest number of steps of the search of the whole runs.
        progress: Function that is called with the share of the steps that are done.
    """
    windows = windows_of(runs)
    try:
        if windows:
            start = minimise_output_error(unknowns, windows, start=start, most_steps=FEW_STEPS, progress=progress).x
        return minimise_output_error(unknowns, runs, start=start, most_steps=most_steps, progress=progress)
    except EstimationError:
        return None


def windows_of(runs: Sequence[ServoRun]) -> list[ServoRun]:
    """Windows of the runs, each of which begins with measured positions, `MOST_WINDOWS` at most."""
    found: list[ServoRun] = []
    for run in runs:
        rows = max(round(WINDOW / run.step), FEWEST)
        found += [run.part(k, k + rows) for k in range(0, run.samples - rows + 1, rows)]
    spread = np.linspace(0.0, len(found) - 1.0, min(len(found), MOST_WINDOWS))
    return [found[round(k)] for k in spread.tolist()]


def encoder_errors(runs: Sequence[ServoRun]) -> Array:
    """RMS error of encoders with steps of the smallest change of a position, shape (n,) [rad or m]."""
    every = [np.abs(np.diff(run.q, axis=0)) for run in runs]
    changes = np.concatenate(every)
    return np.min(np.where(changes > SAME, changes, np.inf), axis=0) / np.sqrt(12.0)


def _concentration(residuals: Array) -> Array:
    """Share of the squares of each column of residuals (N, n) in the tenth of the rows with the largest ones."""
    squares = np.sort(residuals**2, axis=0)[::-1]
    return np.asarray(squares[: len(squares) // 10].sum(axis=0) / squares.sum(axis=0), dtype=np.float64)


def _own_limits(unknowns: Unknowns, fit: OutputErrorFit) -> Array:
    """Largest torques of a fit, infinite where there is none, shape (n,)."""
    return np.where(np.isinf(unknowns.mean.limit), np.inf, fit.parameters.limit)


def _other_limits(unknowns: Unknowns, runs: Sequence[ServoRun], fit: OutputErrorFit) -> Array:
    """Other largest torque of each joint, shape (n,).

    It is infinite for a joint that reaches its own one, and `REACHED` of the torque that the position errors ask for
    if no row reaches the own one, which then cannot be searched for; that of the description if there is none.
    """
    parameters, own = fit.parameters, _own_limits(unknowns, fit)
    errors = [
        np.abs(run.held(run.time - float(parameters.delay.mean())) - run.q - parameters.offset).max(axis=0)
        for run in runs
    ]
    asked = parameters.stiffness * np.max(errors, axis=0)
    described = np.array([joint.effort_limit for joint in unknowns.model.robot.joints])
    other = np.where(np.isinf(own), described, np.where(asked > own, np.inf, REACHED * asked))
    return np.where(unknowns.deviations.limit > 0.0, other, own)


def _with_limits(unknowns: Unknowns, limit: Array) -> Unknowns:
    """The unknowns with or without largest torques; new ones have the deviation of described ones."""
    mean = unknowns.mean.limit
    same = np.isinf(mean) == np.isinf(limit)
    deviations = replace(unknowns.deviations, limit=np.where(same, unknowns.deviations.limit, LIMIT))
    return Unknowns(unknowns.model, replace(unknowns.mean, limit=np.where(same, mean, limit)), deviations)


def _coordinates(changed: Unknowns, limit: Array, unknowns: Unknowns, x: Array) -> Array:
    """Coordinates in `changed` of the largest torques `limit`, and of all else at coordinates x in `unknowns`."""
    known = dict(zip(unknowns.names(), x, strict=True))
    of_limits = {
        ("limit", k): float(np.log(each / changed.mean.limit[k])) for k, each in enumerate(limit) if np.isfinite(each)
    }
    return np.array([{**known, **of_limits}[name] for name in changed.names()])

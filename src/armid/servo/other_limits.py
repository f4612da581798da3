"""Other largest torques for joints whose simulated motion stays far from the measured one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.servo.closed_loop import simulate, with_initial_velocities
from armid.servo.output_error import OutputErrorFit, minimise_output_error, residuals_at
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_prior import LIMIT, UNKNOWN_LIMIT
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

SHARES = (0.9, 0.75, 0.6, 0.45)
"""Shares of the largest torque that position errors ask for that are tried as limits: position errors grow while a
servo is saturated."""

SAME = 1e-9
"""Change of a position that is rounding [rad or m]."""


def with_other_limits(
    unknowns: Unknowns, runs: Sequence[ServoRun], fit: OutputErrorFit, progress: Callable[[float], None]
) -> tuple[Unknowns, OutputErrorFit]:
    """Unknowns and fit with the largest torques that make the smallest output error.

    The first estimate sees saturation only where many rows show it, and takes stiction for it at times. A search does
    not find a limit that no simulated row reaches. So, if residuals are far above the errors of the encoders, and
    most of them in few rows, several limits of each such joint are tried in windows of the motion, and the search
    begins again with the best ones.

    Args:
        unknowns: Unknowns of the fit.
        runs: Training runs.
        fit: Minimum with the largest torques of the first estimate.
        progress: Function that is called with the share of the steps that are done.
    """
    for _ in range(ROUNDS):
        residuals = np.concatenate(residuals_at(unknowns, fit.x, runs))
        far = fit.rms > FAR * encoder_errors(runs)
        if not (far & (_concentration(residuals) > CONCENTRATED)).any():
            break
        limit = _best_limits(unknowns, runs, fit, far)
        if np.array_equal(limit, _own_limits(unknowns, fit)):
            break
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


def _best_limits(unknowns: Unknowns, runs: Sequence[ServoRun], fit: OutputErrorFit, far: NDArray[np.bool_]) -> Array:
    """Largest torques with which windows are simulated best, joint by joint from the one with the worst motion.

    Tried are no limit, that of the description, and shares of the torque that the position errors ask for.
    """
    model, parameters, limit = unknowns.model, fit.parameters, _own_limits(unknowns, fit)
    windows = with_initial_velocities(model, parameters, windows_of(runs))
    if not windows:
        return limit
    errors = [
        np.abs(run.held(run.time - float(parameters.delay.mean())) - run.q - parameters.offset).max(axis=0)
        for run in runs
    ]
    asked = parameters.stiffness * np.max(errors, axis=0)
    score = _misfit(model, replace(parameters, limit=limit), windows)
    ratio = fit.rms / encoder_errors(runs)
    for j in sorted(np.flatnonzero(far & (unknowns.deviations.limit > 0.0)).tolist(), key=lambda j: -ratio[j]):
        for value in (np.inf, model.robot.joints[j].effort_limit, *(share * asked[j] for share in SHARES)):
            other = limit.copy()
            other[j] = value
            found = _misfit(model, replace(parameters, limit=other), windows)
            if found < score - CLEARLY:
                limit, score = other, found
    return limit


def _misfit(model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun]) -> float:
    """Sum of the logarithms of the RMS errors of the joints, infinite where the motion diverges."""
    found = simulate(model, parameters, runs)
    squares = [np.mean((run.q - each.q) ** 2, axis=0) for run, each in zip(runs, found, strict=True)]
    total = float(np.sum(np.log(np.mean(squares, axis=0)))) / 2.0
    return total if np.isfinite(total) else np.inf


def _with_limits(unknowns: Unknowns, limit: Array) -> Unknowns:
    """The unknowns with or without largest torques; new ones have the deviation of their origin."""
    mean = unknowns.mean.limit
    described = np.array([joint.effort_limit for joint in unknowns.model.robot.joints])
    same = np.isinf(mean) == np.isinf(limit)
    new = np.where(np.isfinite(described), described, limit)
    deviations = np.where(same, unknowns.deviations.limit, np.where(np.isfinite(described), LIMIT, UNKNOWN_LIMIT))
    changed = replace(unknowns.mean, limit=np.where(same, mean, np.where(np.isinf(limit), np.inf, new)))
    return Unknowns(unknowns.model, changed, replace(unknowns.deviations, limit=deviations))


def _coordinates(changed: Unknowns, limit: Array, unknowns: Unknowns, x: Array) -> Array:
    """Coordinates in `changed` of the largest torques `limit`, and of all else at coordinates x in `unknowns`."""
    known = dict(zip(unknowns.names(), x, strict=True))
    of_limits = {
        ("limit", k): float(np.log(each / changed.mean.limit[k])) for k, each in enumerate(limit) if np.isfinite(each)
    }
    return np.array([{**known, **of_limits}[name] for name in changed.names()])

"""Output error of a servo model: Gauss-Newton on the difference of measured and simulated positions, under a prior.

The objective is Σ_j w_j Σ_k (q_jk - q̂_jk(x))² + Σ_i (x_i / s_i)² with the prior deviations s of the unknowns. The
weight of joint j is w_j = 1 / (σ_j² T_j), with the mean square σ_j² of its residuals and their correlation time T_j
in samples: N correlated samples say as much as N / T independent ones. Without T, a prior would hardly count.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.servo.closed_loop import SimulatedRun, columns_of, position_derivatives, simulate, with_initial_velocities
from armid.servo.parameters import ServoParameters
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import Unknowns

MOST_STEPS = 40
"""Largest number of Gauss-Newton steps."""

SETTLED = 0.02
"""Decrease of the objective below which the search ends: a step of one standard deviation changes it by 1."""

DAMPING = (1e-4, 1e8)
"""First damping, relative to the diagonal of the information, and the damping at which the search gives up."""

FEWER, MORE = 0.02, 5.0
"""Factors of the damping after a step that succeeded, and after one that failed."""

TRANSIENT = 1.0
"""Time at the beginning of a run whose residuals are not used [s]. The simulation starts from a measured position
with an error of the encoder and from an uncertain velocity; a servo forgets both within a second. With these
residuals, 45 to 85 % of the 95 % intervals of virtual arms with encoders of 12 bit held the truth; without them, 90
to 100 %."""

FINEST = 5e-3
"""Shortest time between two residuals that are used [s]. Positions of a servo hardly change in less, and the memory
for their derivatives grows with their number."""

PIECE = 2000
"""Number of rows whose derivatives are weighted at once."""

LEAST_DAMPING = 1e-11
"""Smallest damping, relative to the diagonal of the information."""

NOISE = 1e-5
"""Smallest deviation of the residuals of a joint [rad or m], far below the step of any encoder."""

FARTHEST = 2.0
"""Largest change of an unknown in one step, in prior deviations."""

REFERENCE = 0.25
"""Length of the steps of a reference motion, relative to the steps of the integration. The error of the motion is of
first order in the step, because dry friction changes its sign at the end of a step."""

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False, slots=True)
class OutputErrorFit:
    """Minimum of the output error.

    Attributes:
        x: Unknowns, shape (count,).
        parameters: Parameters at x.
        covariance: Covariance of x by prior and residuals, shape (count, count).
        information: Share of the information about each unknown that comes from the data, shape (count,).
        rms: RMS of the residuals of each joint, shape (n,) [rad or m].
        correlation: Correlation time of the residuals of each joint, shape (n,) [rows].
        steps: Number of steps.
        settled: True if the search ended by itself.
        unsettled: Number of integration steps that did not converge at the minimum.
        integration: Largest shift of an unknown by the finite steps of the integration, in its standard deviations.
    """

    x: Array
    parameters: ServoParameters
    covariance: Array
    information: Array
    rms: Array
    correlation: Array
    steps: int
    settled: bool
    unsettled: int
    integration: float


@dataclass(frozen=True, eq=False, slots=True)
class _Point:
    """Unknowns, simulated motion and residuals (rows, n) of each run."""

    x: Array
    simulated: tuple[SimulatedRun, ...]
    residuals: tuple[Array, ...]


def minimise_output_error(
    unknowns: Unknowns,
    runs: Sequence[ServoRun],
    *,
    start: Array | None = None,
    most_steps: int = MOST_STEPS,
    progress: Progress | None = None,
) -> OutputErrorFit:
    """Estimates the unknowns from recorded runs.

    Args:
        unknowns: Unknowns with their prior.
        runs: Training runs.
        start: Unknowns at which the search starts; the prior mean if not given.
        most_steps: Largest number of Gauss-Newton steps; with 0, the fit is the start.
        progress: Function that is called with the share of the steps that are done.

    Raises:
        EstimationError: The simulated motion diverges at the start.
    """
    point, runs = _begin(unknowns, np.zeros(unknowns.count) if start is None else start, runs)
    weight, rms, correlation = _weights(point.residuals)
    damping, settled, step = DAMPING[0], most_steps == 0, 0
    for step in range(1, most_steps + 1):
        information, slope = _normal_equations(unknowns, point, point.residuals, weight, runs)
        slope -= point.x * unknowns.deviation**-2
        cost, found = _cost(unknowns, point, weight), None
        while found is None and damping < DAMPING[1]:
            change = np.linalg.solve(information + damping * np.diag(np.diag(information)), slope)
            change *= min(1.0, FARTHEST / max(float(np.abs(change / unknowns.deviation).max(initial=0.0)), 1e-300))
            trial = _evaluate(unknowns, point.x + change, runs)
            lower = _cost(unknowns, trial, weight)
            found = trial if lower < cost else None
            damping *= FEWER if found is not None else MORE
            settled = cost - lower < SETTLED if found is not None else settled
        damping = max(damping, LEAST_DAMPING)
        settled, point = settled or found is None, found or point  # without a trial, no direction goes down any more
        if settled:  # with the initial velocities of the old parameters, perhaps
            point, runs, settled = _again(unknowns, point, runs, weight)
        weight, rms, correlation = _weights(point.residuals)
        if progress is not None:
            progress(step / most_steps)
        if settled:
            break
    errors = _integration_errors(unknowns, point, runs)
    information, slope = _normal_equations(unknowns, point, errors, weight, runs)
    covariance = np.linalg.inv(information)
    shift = np.abs(covariance @ slope) / np.sqrt(np.diag(covariance))
    return OutputErrorFit(
        point.x,
        unknowns.parameters(point.x),
        0.5 * (covariance + covariance.T),
        1.0 - np.clip(np.diag(covariance) / unknowns.deviation**2, 0.0, 1.0),
        rms,
        correlation,
        step,
        settled,
        sum(each.unsettled for each in point.simulated),
        float(shift.max(initial=0.0)),
    )


def residuals_at(unknowns: Unknowns, x: Array, runs: Sequence[ServoRun]) -> tuple[Array, ...]:
    """Residuals (rows, n) of each run at unknowns x, from the initial velocities that fit best.

    Raises:
        EstimationError: The simulated motion diverges.
    """
    return _begin(unknowns, x, runs)[0].residuals


def _begin(unknowns: Unknowns, x: Array, runs: Sequence[ServoRun]) -> tuple[_Point, Sequence[ServoRun]]:
    """Point at which a search starts, after a check that its motion does not diverge, and runs with velocities."""
    runs = with_initial_velocities(unknowns.model, unknowns.parameters(x), runs)
    point = _evaluate(unknowns, x, runs)
    if not all(np.isfinite(each).all() for each in point.residuals):
        raise EstimationError(
            "The simulated motion diverges with the first estimate of the servos.",
            remedy="check the units of command and position, and state the stiffness of the servos.",
        )
    return point, runs


def _again(
    unknowns: Unknowns, point: _Point, runs: Sequence[ServoRun], weight: Array
) -> tuple[_Point, Sequence[ServoRun], bool]:
    """Point and runs with new initial velocities, and true if these lower the objective by little."""
    others = with_initial_velocities(unknowns.model, unknowns.parameters(point.x), runs)
    other = _evaluate(unknowns, point.x, others)
    gain = _cost(unknowns, point, weight) - _cost(unknowns, other, weight)
    return (other, others, gain < SETTLED) if gain > 0.0 else (point, runs, True)


def _rows(run: ServoRun) -> slice:
    """Samples of a run, after its first one, whose residuals are used."""
    first = min(round(TRANSIENT / run.step), run.samples // 2)
    return slice(first, None, max(1, round(FINEST / run.step)))


def _evaluate(unknowns: Unknowns, x: Array, runs: Sequence[ServoRun]) -> _Point:
    """Residuals at unknowns x; NaN where the simulated motion diverges."""
    found = simulate(unknowns.model, unknowns.parameters(x), runs)
    residuals = tuple((run.q[1:] - simulated.q[1:])[_rows(run)] for run, simulated in zip(runs, found, strict=True))
    return _Point(x, found, residuals)


def _integration_errors(unknowns: Unknowns, point: _Point, runs: Sequence[ServoRun]) -> list[Array]:
    """Differences of the simulated motion from that with much shorter steps, at the rows of the residuals."""
    fine = replace(unknowns.model, longest_step=REFERENCE * min(each.step for each in point.simulated))
    found = simulate(fine, unknowns.parameters(point.x), runs)
    # (measured - simulated) - (measured - reference), for steps of length zero by proportion
    return [
        (residual - (run.q[1:] - reference.q[1:])[_rows(run)]) / (1.0 - REFERENCE)
        for run, residual, reference in zip(runs, point.residuals, found, strict=True)
    ]


def _cost(unknowns: Unknowns, point: _Point, weight: Array) -> float:
    """Objective at a point; infinite where the motion diverges."""
    with np.errstate(all="ignore"):
        misfit = sum(float(weight @ np.sum(r * r, axis=0)) for r in point.residuals)
    return misfit + float(np.sum((point.x / unknowns.deviation) ** 2)) if np.isfinite(misfit) else np.inf


def _normal_equations(
    unknowns: Unknowns, point: _Point, residuals: Sequence[Array], weight: Array, runs: Sequence[ServoRun]
) -> tuple[Array, Array]:
    """Information (count, count) of data and prior, and half the downward gradient of the misfit of residuals.

    Runs are differentiated one after another, and their derivatives are not kept.
    """
    parameters, root = unknowns.parameters(point.x), np.sqrt(weight)
    columns = columns_of(unknowns.model)["delay"].stop
    squares, slope = np.zeros((columns, columns)), np.zeros(columns)
    for run, simulated, residual in zip(runs, point.simulated, residuals, strict=True):
        derivatives = position_derivatives(unknowns.model, parameters, simulated)
        if derivatives is None:
            continue
        jacobian = derivatives[_rows(run)]
        for begin in range(0, len(jacobian), PIECE):
            part = slice(begin, begin + PIECE)
            scaled = (jacobian[part] * root[:, None]).reshape(-1, columns)
            squares += scaled.T @ scaled
            slope += scaled.T @ (residual[part] * root).ravel()
    chain = unknowns.chain(point.x)
    return np.diag(unknowns.deviation**-2) + chain.T @ squares @ chain, chain.T @ slope


def _weights(residuals: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Weight of each joint, RMS of its residuals and their correlation time [samples], shape (n,) each."""
    every = np.concatenate(residuals)
    rms = np.maximum(np.sqrt(np.mean(every**2, axis=0)), NOISE)
    samples = np.array([len(r) for r in residuals], dtype=np.float64)
    correlation = np.array([correlation_times(r) for r in residuals])
    mean = samples @ correlation / samples.sum()
    return 1.0 / (rms**2 * mean), rms, mean


def correlation_times(x: Array) -> Array:
    """Correlation time of each column of x (N, n) in samples: 1 + 2 Σ ρ(k) up to the first ρ(k) below zero.

    A constant that a column keeps is part of its correlation; the time is at most N.
    """
    size = len(x)
    spectrum = np.abs(np.fft.rfft(x, 2 * size, axis=0)) ** 2
    covariances = np.fft.irfft(spectrum, axis=0)[:size]
    rho = covariances / np.maximum(covariances[0], 1e-300)
    negative = rho < 0.0
    end = np.where(negative.any(axis=0), negative.argmax(axis=0), size)
    inside = np.arange(size)[:, None] < end
    return np.clip(2.0 * np.sum(rho * inside, axis=0) - 1.0, 1.0, size)

"""Certification of a plan: check of every limit on a fine grid, with bounds for the time between the grid points.

A finite Fourier series is band-limited: sums of its amplitudes are upper bounds of its derivatives. From these bounds
follows how far the utilisation of a limit can rise between two points of the grid. The certified utilisation is the
maximum on the grid plus this bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import Objective
from armid.excitation.design.sqp import DescentProblem, about_start
from armid.excitation.limits.constraint_channels import ConstraintChannel, RangeLimit, States
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.limits.workspace import SCALE, Workspace

RATE = 1000.0
"""Smallest rate of the grid on which a plan is certified [Hz]."""

CHUNK = 2000
"""Number of grid points that are evaluated at a time, to save memory."""

STEPS = 40
"""Largest number of reductions of the amplitudes of a plan, after which the plan counts as infeasible."""

BLOCK, STRIDE, FAR = 256, 16, 0.0
"""Parameters of the evaluation of distances: number of grid points that are evaluated at a time; stride of the grid
points that are evaluated first; and certified utilisation at these points above which a pair of bodies is evaluated
at all points. The utilisation is zero at the distance `SCALE` above the required one."""

SLACK = 2e-4
"""Smallest relative decrease of the amplitudes of a plan in the first step, if a limit is violated; it grows with the
number of steps."""


@dataclass(frozen=True, slots=True)
class Margin:
    """Utilisation of one limit by a plan, with the value and the limit.

    Attributes:
        limit: Kind of the limit, for instance `velocity`.
        label: Name of the joint, pair of bodies or plane to which the limit belongs.
        value: Value on the grid that is closest to the limit, in `unit`; a distance for collisions and workspace.
        bound: Limit of this value, in `unit`.
        unit: Unit of `value` and `bound`.
        time: Time of this value [s], from the start of the series; NaN for limits that do not depend on time.
        share: Utilisation of the limit on the grid: the value divided by the limit. For a distance it is 1 at the
            required distance, and decreases linearly to 0 at a distance that is larger by `SCALE`.
        certified: Utilisation on the grid plus the upper bound of its rise between the points of the grid; the limit
            counts as kept if this is at most 1.
    """

    limit: str
    label: str
    value: float
    bound: float
    unit: str
    time: float
    share: float
    certified: float


def fine_grid(problem: DescentProblem) -> tuple[Objective, ...]:
    """Grid over one period, in chunks: at least 1000 points per second and 40 per period of the highest harmonic."""
    basis = problem.basis
    samples = math.ceil(max(RATE * basis.period, 40.0 * basis.harmonics))
    times = basis.times(samples)
    return tuple(
        Objective(problem.goal, basis, len(part), times=part)
        for part in np.split(times, range(CHUNK, samples, CHUNK))
    )


Peaks = list[tuple[Array, Array, Array]]


def _peaks(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> Peaks:
    """Maximum utilisation, certified utilisation and time of the maximum [s], shape (m,) each, for each channel.

    The bound of the rise between points is computed for each chunk of the grid separately, and only roughly if the
    chunk is far from the limit. The bound is therefore added to the maximum of each chunk before the chunks are
    compared.
    """
    step = problem.basis.period / sum(len(chunk.times) for chunk in grid)
    by_channel: list[list[tuple[Array, Array, Array]]] = [[] for _ in problem.channels]
    for chunk in grid:
        states = States(chunk, x)
        for channel, parts in zip(problem.channels, by_channel, strict=True):
            if isinstance(channel, Clearance):
                blocks = np.split(chunk.times, range(BLOCK, len(chunk.times), BLOCK))
                parts += [_peaks_of_distances(problem, channel, times, x, step) for times in blocks]
            else:
                parts.append(_peaks_of(channel, states, step))
    result: Peaks = []
    for parts in by_channel:
        shares, totals, times = (np.array([part[k] for part in parts]) for k in range(3))
        best = shares.argmax(axis=0)
        every = np.arange(shares.shape[1])
        result.append((shares[best, every], totals.max(axis=0), times[best, every]))
    return result


def _peaks_of(channel: ConstraintChannel, states: States, step: float) -> tuple[Array, Array, Array]:
    """Maximum utilisation, certified utilisation and time of the maximum [s] of one channel, (m,) each.

    `step` is the step of the grid [s].
    """
    values = channel.values(states)
    at, highest = values.argmax(axis=0), values.max(axis=0)
    times = states.objective.times[at] if len(values) > 1 else np.full(len(at), np.nan)
    return highest, highest + channel.between(states, step), times


def _peaks_of_distances(
    problem: DescentProblem, channel: Clearance, times: Array, x: Array, step: float
) -> tuple[Array, Array, Array]:
    """Results of `_peaks_of` for distances of bodies; pairs that are far apart are evaluated at fewer grid points."""

    def states(times: Array) -> States:
        return States(Objective(problem.goal, problem.basis, len(times), times=times), x, rough=True)

    some = times[np.minimum(np.arange(STRIDE // 2, len(times) + STRIDE // 2, STRIDE), len(times) - 1)]
    result = _peaks_of(channel, states(some), (STRIDE + 1) * step)
    near = np.flatnonzero(result[1] > FAR)
    if len(near):
        for every, some in zip(result, _peaks_of(channel.only(near), states(times), step), strict=True):
            every[near] = some
    return result


def certified(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> tuple[Array, tuple[Margin, ...]]:
    """Reduces the amplitudes of a plan, with its start pose fixed, until the plan provably keeps every limit.

    Args:
        problem: Optimisation problem with the limits.
        grid: Grid that `fine_grid` returns.
        x: Unknowns of the plan, shape (n k,), with k unknowns of each joint.

    Returns:
        Unknowns (n k,) of the certified plan, and the margins between this plan and the limits.

    Raises:
        ArmidError: Even a very small motion violates a limit; the message names the limit and the joint.
    """
    factor, trial = 1.0, x
    for k in range(STEPS):
        trial = about_start(problem.basis, x, factor)
        peaks = _peaks(problem, grid, trial)
        worst = max((float(total.max()) for _, total, _ in peaks), default=0.0)
        if worst <= 1.0:
            return trial, _margins(problem, trial, peaks)
        # Most utilisations grow with the amplitude; for those that hardly do, the steps become larger and larger.
        factor *= max(0.7, 1.0 - max(0.5 * (1 + k) * (worst - 1.0), SLACK * (1 + k)))
    name, label, worst = max(
        (
            (channel.name, label, float(total))
            for channel, (_, totals, _) in zip(problem.channels, _peaks(problem, grid, trial), strict=True)
            for label, total in zip(channel.labels, totals, strict=True)
        ),
        key=lambda each: each[2],
    )
    raise ArmidError(
        f"The limit of {name} of {label} cannot be kept: even a very small motion about the start pose reaches "
        f"{100 * worst:.1f} % of it.",
        remedy=f"relax the limit of {name} of {label}, or choose another start pose with --start.",
    )


UNITS = {0: ("rad", "m"), 1: ("rad/s", "m/s"), 2: ("rad/s²", "m/s²"), 3: ("rad/s³", "m/s³")}


def margins(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> tuple[Margin, ...]:
    """Margins between the plan with unknowns x, shape (n k,), and every limit, on a grid from `fine_grid`."""
    return _margins(problem, x, _peaks(problem, grid, x))


def _margins(problem: DescentProblem, x: Array, peaks: Peaks) -> tuple[Margin, ...]:
    """Margins between the plan with unknowns x, shape (n k,), and every limit, from the result of `_peaks`."""
    result: list[Margin] = []
    robot = problem.goal.model.robot
    series = problem.basis.excitation(x)
    for channel, (shares, totals, times) in zip(problem.channels, peaks, strict=True):
        for k, label in enumerate(channel.labels):
            share, total, time = float(shares[k]), float(totals[k]), float(times[k])
            joint = robot.joints[robot.joint_index(label)] if label in robot.joint_names else None
            slides = joint is not None and joint.is_prismatic
            value, bound, unit = _physical(channel, k, share, slides)
            if isinstance(channel, RangeLimit) and channel.order == 0:
                value = float(series.at([time]).q[0, channel.joints[k]])
                bound = float(channel.middle[k] + math.copysign(channel.half[k], value - channel.middle[k]))
            result.append(Margin(channel.name, label, value, bound, unit, time, share, total))
    return tuple(result)


def _physical(channel: ConstraintChannel, k: int, share: float, slides: bool) -> tuple[float, float, str]:
    """Value, limit and unit of quantity k of a constraint channel.

    The value is computed from `share`, the utilisation of the limit.
    """
    if isinstance(channel, RangeLimit):
        bound, unit = float(channel.half[k]), UNITS[channel.order][slides]
    elif isinstance(channel, Torque):
        bound, unit = float(channel.limit[k]), "N" if slides else "N·m"
    elif isinstance(channel, Clearance):
        margin = float(channel.margins[k])
        return margin + SCALE * (1.0 - share), margin, "m"
    elif isinstance(channel, Workspace):
        return SCALE * (1.0 - share), 0.0, "m"
    else:
        limit = np.ravel(getattr(channel, "limit"))  # noqa: B009  (amplitudes and coefficients have one)
        order = getattr(channel, "order", 1)
        bound, unit = float(limit[k % len(limit)]), UNITS[order][slides]
    return share * bound, bound, unit

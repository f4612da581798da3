"""The last word on a plan: every limit on a fine grid, and what could hide between its points.

A series has a bandwidth, so its derivatives are bounded by the sums of its amplitudes, and a quantity cannot rise
between two points of a grid by more than these allow. What is certified is the highest value on the grid plus that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armid.errors import ArmidError
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import Objective
from armid.excitation.design.sqp import DescentProblem, about_start
from armid.excitation.limits.constraints import ConstraintChannel, RangeLimit, States
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.limits.workspace import SCALE, Workspace
from armid.values import Array

__all__ = ["Margin", "certified", "fine_grid", "margins"]

RATE = 1000.0
"""Points a second of the grid [Hz]."""

CHUNK = 2000
"""Points of the grid that are held at a time."""

STEPS = 40
"""How often a plan may be drawn together before it counts as infeasible."""

SLACK = 2e-4
"""Share of a limit that drawing together aims beyond the one that is missed."""


@dataclass(frozen=True, slots=True)
class Margin:
    """Margin of a plan to one limit.

    Attributes:
        limit: Which, for instance `velocity`.
        label: Joint, pair or place.
        value: Nearest to the limit on the grid; distances for what has to stay apart.
        bound: The limit.
        unit: Of both.
        time: When [s], from the start of the series; NaN for what has no time.
        share: Value over limit on the grid; one at the limit.
        certified: The same with what could hide between the points of the grid.
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
    """The grid in chunks, a thousand points a second and forty a period of the highest harmonic at least."""
    basis = problem.basis
    samples = math.ceil(max(RATE * basis.period, 40.0 * basis.harmonics))
    times = basis.times(samples)
    return tuple(
        Objective(problem.goal, basis, len(part), times=part)
        for part in np.split(times, range(CHUNK, samples, CHUNK))
    )


Peaks = list[tuple[Array, Array, Array]]


def _peaks(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> Peaks:
    """For each channel the highest shares (m,), these with what could hide between points (m,), and times (m,) [s].

    What hides is bounded chunk by chunk, roughly where a chunk is far from a limit, so it is added before chunks are
    compared.
    """
    step = problem.basis.period / sum(len(chunk.times) for chunk in grid)
    found: list[list[tuple[Array, Array, Array]]] = [[] for _ in problem.channels]
    for chunk in grid:
        states = States(chunk, x)
        for channel, parts in zip(problem.channels, found, strict=True):
            values = channel.values(states)
            at = values.argmax(axis=0)
            times = chunk.times[at] if len(values) > 1 else np.full(len(at), np.nan)
            highest = values.max(axis=0)
            parts.append((highest, highest + channel.between(states, step), times))
    result: Peaks = []
    for parts in found:
        shares, totals, times = (np.array([part[k] for part in parts]) for k in range(3))
        best = shares.argmax(axis=0)
        every = np.arange(shares.shape[1])
        result.append((shares[best, every], totals.max(axis=0), times[best, every]))
    return result


def certified(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> tuple[Array, tuple[Margin, ...]]:
    """The plan drawn together about its start pose until every limit is certified, and how near it comes to each.

    Raises:
        ArmidError: Not even a motion that hardly moves keeps them; the message names limit and joint.
    """
    factor, trial = 1.0, x
    for k in range(STEPS):
        trial = about_start(problem.basis, x, factor)
        peaks = _peaks(problem, grid, trial)
        worst = max((float(total.max()) for _, total, _ in peaks), default=0.0)
        if worst <= 1.0:
            return trial, _margins(problem, trial, peaks)
        # Most limits grow with the amplitude; those that hardly do are met with larger and larger steps.
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
        f"The limit of {name} of {label} cannot be kept: {100 * worst:.1f} % of it is reached however little the "
        "arm moves.",
        remedy=f"relax {name} of {label}, or choose another start pose.",
    )


UNITS = {0: ("rad", "m"), 1: ("rad/s", "m/s"), 2: ("rad/s²", "m/s²"), 3: ("rad/s³", "m/s³")}


def margins(problem: DescentProblem, grid: tuple[Objective, ...], x: Array) -> tuple[Margin, ...]:
    """Tell how near a plan comes to every limit."""
    return _margins(problem, x, _peaks(problem, grid, x))


def _margins(problem: DescentProblem, x: Array, peaks: Peaks) -> tuple[Margin, ...]:
    """The same from the peaks."""
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
    """Value, bound and unit of a channel's entry."""
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

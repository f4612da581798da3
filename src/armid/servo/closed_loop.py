"""Simulated motion of an arm under recorded commands, and its derivatives by the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.kernel import RollOutParameters, make_layout
from armid.servo.held_command import held_means
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_run import ServoRun

FIRST = 2.0
"""Length of the beginning of a run from which its initial velocities are estimated [s]."""

VELOCITY = 0.1
"""Deviation of the slope of the first positions from the initial velocity [rad/s or m/s]: an encoder of 12 bit at
50 Hz, or an acceleration of 2 rad/s² over the samples of the slope."""

LEAST_RESIDUAL = 1e-5
"""Smallest RMS of residuals by which they are weighted [rad or m], far below the step of any encoder."""

SMALL_VELOCITY = 0.01
"""Change of an initial velocity for derivatives by differences [rad/s or m/s]."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedRun:
    """Simulated motion of one run.

    Attributes:
        states_q: Positions at the beginning and after each step, shape (S + 1, n) [rad or m].
        states_dq: Velocities at the same times, shape (S + 1, n) [rad/s or m/s].
        means: Mean command of each step, shape (S, n) [rad or m].
        slopes: Derivatives of the means by the delays, shape (S, n) [rad/s or m/s].
        step: Step of the integration [s].
        substeps: Number of steps from one sample to the next.
        unsettled: Number of steps at which the iteration for the velocity did not converge; for runs that are
            simulated side by side, that of all of them, at the first one.
    """

    states_q: Array
    states_dq: Array
    means: Array
    slopes: Array
    step: float
    substeps: int
    unsettled: int

    @property
    def q(self) -> Array:
        """Positions at the samples of the run, shape (N, n) [rad or m]."""
        return self.states_q[:: self.substeps]


def columns_of(model: ServoModel) -> dict[str, slice]:
    """Columns of the derivatives, by the field of `ServoParameters` whose values they belong to."""
    sizes = {"inertial": 10 * model.n, "friction": len(model.laws)}
    sizes |= dict.fromkeys(("rotor_inertia", "stiffness", "damping", "limit", "offset", "delay"), model.n)
    ends = np.cumsum(list(sizes.values()))
    return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}


def simulate(model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun]) -> tuple[SimulatedRun, ...]:
    """Simulates the motion of each run from its first position, under its commands.

    Runs with the same step are simulated side by side.

    Args:
        model: Arm and friction laws.
        parameters: Links, friction and servos.
        runs: Commands and the initial state.
    """
    found: dict[int, SimulatedRun] = {}
    for each in _side_by_side(runs):
        substeps = steps_of_sample(model, runs[each[0]])
        step = runs[each[0]].step / substeps
        held = [
            held_means(run.command_time, run.command, parameters.delay, run.start, step, (run.samples - 1) * substeps)
            for run in (runs[k] for k in each)
        ]
        longest = max(len(means) for means, _ in held)
        commands = np.stack([_padded(means - parameters.offset, longest) for means, _ in held])
        starts = np.stack([runs[k].q[0] for k in each]), np.stack([runs[k].dq for k in each])
        servos = model.joints(parameters, step)
        q, dq, unsettled = kernel.roll_out(model.robot.tree, parameters.inertial, servos, commands, None, *starts)
        for k, (means, slopes), of_q, of_dq in zip(each, held, q, dq, strict=True):
            states = slice(0, len(means) + 1)
            first = unsettled if k == each[0] else 0
            found[k] = SimulatedRun(of_q[states], of_dq[states], means, slopes, step, substeps, first)
    return tuple(found[k] for k in range(len(runs)))


def steps_of_sample(model: ServoModel, run: ServoRun) -> int:
    """Number of steps of the integration from one sample of a run to the next."""
    return max(1, int(np.ceil(run.step / model.longest_step - 1e-9)))


def with_initial_velocities(
    model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun]
) -> list[ServoRun]:
    """Runs whose initial velocities fit the beginning of the measured motion best.

    The slope of the first positions is that in the middle of some samples. A heavy arm with little damping remembers
    the difference for seconds. So each run gets one Gauss-Newton step for its velocities from the slopes, whose
    deviation is `VELOCITY`, if the simulated motion then is nearer to the measured one.

    Args:
        model: Arm and friction laws.
        parameters: Links, friction and servos.
        runs: Commands and measured positions.
    """
    slopes = [run.part(0, run.samples).dq for run in runs]
    firsts = [_first_part(run, run.dq) for run in runs]
    changed = [
        _first_part(run, run.dq + change) for run in runs for change in (0.0, *(SMALL_VELOCITY * np.eye(model.n)))
    ]
    found, size = simulate(model, parameters, changed), model.n + 1
    velocities: list[Array] = []
    for k, (run, slope) in enumerate(zip(runs, slopes, strict=True)):
        still, *moved = (each.q for each in found[k * size : (k + 1) * size])
        residual = firsts[k].q - still
        jacobian = np.stack([(each - still) / SMALL_VELOCITY for each in moved], axis=2)
        if not (np.isfinite(jacobian).all() and np.isfinite(residual).all()):
            velocities.append(run.dq)
            continue
        root = 1.0 / np.maximum(np.sqrt(np.mean(residual**2, axis=0)), LEAST_RESIDUAL)
        rows = (jacobian * root[:, None]).reshape(-1, model.n)
        normal = rows.T @ rows + np.eye(model.n) * VELOCITY**-2
        right = rows.T @ (residual * root).ravel() + (slope - run.dq) * VELOCITY**-2
        velocities.append(run.dq + np.linalg.solve(normal, right))
    trials = [_first_part(run, dq) for run, dq in zip(runs, velocities, strict=True)]
    after = simulate(model, parameters, trials)
    better: list[ServoRun] = []
    for k, (run, dq) in enumerate(zip(runs, velocities, strict=True)):
        old, new = firsts[k].q - found[k * size].q, firsts[k].q - after[k].q
        scale = np.maximum(np.mean(old**2, axis=0), LEAST_RESIDUAL**2)
        better.append(replace(run, dq=dq) if np.sum(np.mean(new**2, axis=0) / scale) < model.n else run)
    return better


def _first_part(run: ServoRun, dq: Array) -> ServoRun:
    """Beginning of a run, with initial velocities dq (n,)."""
    return replace(run, q=run.q[: max(2, round(FIRST / run.step))], dq=dq)


def _side_by_side(runs: Sequence[ServoRun]) -> list[list[int]]:
    """Numbers of the runs with equal steps, one list for each step."""
    groups: dict[float, list[int]] = {}
    for k, run in enumerate(runs):
        groups.setdefault(run.step, []).append(k)
    return list(groups.values())


def _padded(commands: Array, steps: int) -> Array:
    """Commands (S, n) with the last one repeated up to a number of steps."""
    return np.concatenate([commands, np.repeat(commands[-1:], steps - len(commands), axis=0)])


def position_derivatives(model: ServoModel, parameters: ServoParameters, run: SimulatedRun) -> Array | None:
    """Derivatives of the positions at the samples after the first by the columns of `columns_of`.

    Args:
        model: Arm and friction laws.
        parameters: Parameters of the simulation.
        run: The simulated motion.

    Returns:
        Derivatives, shape (N - 1, n, columns); `None` if the motion diverges.
    """
    if not np.isfinite(run.states_q).all():
        return None
    n, columns = model.n, columns_of(model)
    layout = make_layout(model.robot.tree, np.arange(10 * n), np.zeros(0, dtype=int), np.zeros(0, dtype=int))

    def numbers(name: str) -> NDArray[np.int_]:
        return np.arange(columns[name].start, columns[name].stop)

    wanted = RollOutParameters(
        columns["delay"].stop,
        layout,
        numbers("friction"),
        np.stack([numbers("rotor_inertia"), numbers("stiffness"), numbers("damping"), numbers("limit")]),
        np.tile(np.arange(n), 2),
        np.concatenate([numbers("offset"), numbers("delay")]),
    )
    by_offset = np.tile(-parameters.stiffness[:, None], (1, len(run.means)))
    return kernel.roll_out_sensitivities(
        model.robot.tree,
        parameters.inertial,
        model.joints(parameters, run.step),
        wanted,
        run.means - parameters.offset,
        None,
        np.concatenate([by_offset, parameters.stiffness[:, None] * run.slopes.T]),
        run.states_q,
        run.states_dq,
        run.substeps,
    )

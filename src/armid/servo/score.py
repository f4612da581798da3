"""Closed-loop position error: measured positions against those that the simulated arm has under the same commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.servo.closed_loop import simulate
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_run import ServoRun


@dataclass(frozen=True, eq=False, slots=True)
class ClosedLoopError:
    """RMS position errors, all runs with equal weight.

    Attributes:
        joints: RMS error of each joint, shape (n,) [rad or m].
        runs: RMS over the joints of each run, shape (R,) [rad or m].
    """

    joints: Array
    runs: Array

    @property
    def total(self) -> float:
        """RMS over joints and runs [rad or m]."""
        return float(np.sqrt(np.mean(self.joints**2)))


def error_of(differences: Sequence[Array]) -> ClosedLoopError:
    """Error from the differences of positions (N, n) of each run."""
    squares = np.array([np.mean(each**2, axis=0) for each in differences])
    return ClosedLoopError(np.sqrt(squares.mean(axis=0)), np.sqrt(squares.mean(axis=1)))


def closed_loop_error(
    model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun], *, after: float = 0.0
) -> ClosedLoopError:
    """Error of a model on runs, each simulated from its first position to its end; NaN where the motion diverges.

    Args:
        model: Arm and friction laws.
        parameters: Links, friction and servos.
        runs: Commands and measured positions.
        after: Time at the beginning of each run that is not judged [s], at most half of it.
    """
    found = simulate(model, parameters, runs)
    first = [min(round(after / run.step), run.samples // 2) for run in runs]
    return error_of([(run.q - each.q)[k:] for run, each, k in zip(runs, found, first, strict=True)])


def command_error(runs: Sequence[ServoRun]) -> ClosedLoopError:
    """Error of a model in which each joint is where its command is."""
    return error_of([run.q - run.held(run.time) for run in runs])

"""Commands that a controller holds from one sample to the next."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array


def held_means(
    time: Array, command: Array, delay: Array, start: float, step: float, steps: int
) -> tuple[Array, Array]:
    """Means of a delayed, held command over successive steps, and their derivatives by the delay.

    The command of sample k acts from time[k] + delay to time[k + 1] + delay, the first one also before. The mean over
    a step changes continuously with the delay, so a delay shorter than a step can be estimated.

    Args:
        time: Times of the samples, shape (N,) [s].
        command: Commands, shape (N, n) [rad or m].
        delay: Delay of each joint, shape (n,) [s].
        start: Beginning of the first step [s].
        step: Length of a step [s].
        steps: Number of steps S.

    Returns:
        Means [rad or m] and derivatives [rad/s or m/s], shape (S, n) each.
    """
    borders = start + step * np.arange(steps + 1)
    lengths = np.diff(time)
    area = np.vstack([np.zeros(command.shape[1]), np.cumsum(command[:-1] * lengths[:, None], axis=0)])
    means, slopes = np.empty((steps, command.shape[1])), np.empty((steps, command.shape[1]))
    for j, late in enumerate(delay):
        at = borders - late
        sample = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)
        held = command[sample, j]
        means[:, j] = np.diff(area[sample, j] + held * (at - time[sample])) / step
        slopes[:, j] = -np.diff(held) / step
    return means, slopes

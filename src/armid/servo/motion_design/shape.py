"""Shape of a motion of commands: poses that are held, slow oscillations with reversals, and fast bursts.

Static poses under different loads show the stiffness, slow reversals the dry friction, and fast bursts rotor inertia,
viscous friction and delay. Each joint has `GENES` numbers from 0 to 1 that say where and how much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.command_motion import CommandMotion

POSES = 5
"""Number of poses."""

GENES = POSES + 6
"""Numbers of a joint: poses, and size, frequency and phase of the slow oscillation and of the bursts."""

MOVE = 0.4
"""Share of the time of a pose in which the joint moves to it."""

SLOW, FAST = (0.1, 0.5), (0.8, 4.0)
"""Frequencies of the slow oscillation and of the bursts [Hz]."""

SHARES = (0.3, 0.25)
"""Largest amplitude of both, over the range of the joint."""

PER_WAVE = 8.0
"""Smallest number of commands in a period of a burst."""


def commands_of_shape(genes: Array, limits: tuple[Array, Array, Array], seconds: float, rate: float) -> CommandMotion:
    """Motion of a shape, within limits of position and speed; it begins and ends at rest.

    Args:
        genes: Numbers from 0 to 1, shape (n, GENES).
        limits: Lowest and highest command [rad or m] and largest speed [rad/s or m/s], shape (n,) each.
        seconds: Duration [s].
        rate: Commands per second [Hz].
    """
    low, high, speed = limits
    t = np.arange(max(2, round(seconds * rate))) / rate
    span = high - low
    slow, fast = SHARES[0] * genes[:, POSES] * span, SHARES[1] * genes[:, POSES + 1] * span
    slow_at, fast_at = _frequency(genes[:, POSES + 2], SLOW), _frequency(genes[:, POSES + 3], FAST)
    fast_at = np.minimum(fast_at, rate / PER_WAVE)
    phases = 2.0 * np.pi * genes[:, POSES + 4 : POSES + 6]
    room = slow + fast
    poses = (low + room)[:, None] + genes[:, :POSES] * np.maximum(span - 2.0 * room, 0.0)[:, None]
    length = seconds / POSES
    stretch = np.minimum((t / length).astype(np.intp), POSES - 1)
    inside = t / length - stretch
    before = poses[:, np.maximum(stretch - 1, 0)].T
    path = before + _rise(np.minimum(inside / MOVE, 1.0))[:, None] * (poses[:, stretch].T - before)
    oscillation = slow * np.sin(2.0 * np.pi * slow_at * t[:, None] + phases[:, 0])
    burst = _window((inside - MOVE) / (1.0 - MOVE))[:, None]
    command = path + _ends(t)[:, None] * (
        oscillation + burst * fast * np.sin(2.0 * np.pi * fast_at * t[:, None] + phases[:, 1])
    )
    fastest = np.abs(np.diff(command, axis=0)).max(axis=0) * rate
    scale = np.minimum(1.0, speed / np.maximum(fastest, 1e-12))
    return CommandMotion(rate, command[0] + scale * (command - command[0]))


def _frequency(gene: Array, band: tuple[float, float]) -> Array:
    return band[0] * (band[1] / band[0]) ** gene


def _rise(s: Array) -> Array:
    """Smooth step from 0 to 1 with zero velocity and acceleration at both ends."""
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _window(s: Array) -> Array:
    """Window that is 0 before 0 and after 1."""
    return np.where((s > 0.0) & (s < 1.0), np.sin(np.pi * np.clip(s, 0.0, 1.0)) ** 2, 0.0)


def _ends(t: Array) -> Array:
    """Weight that rises from 0 within a second and falls to 0 at the end."""
    return _rise(np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0))


def mutated(genes: Array, rng: np.random.Generator) -> Array:
    """Genes of which some numbers of one to three joints are changed."""
    found, n = genes.copy(), len(genes)
    joints: NDArray[np.intp] = rng.permutation(n)[: rng.integers(1, min(3, n) + 1)]
    size = rng.choice([0.05, 0.2, 0.5])
    for j in joints:
        which = rng.random(genes.shape[1]) < 0.4
        found[j, which] += size * rng.normal(size=int(which.sum()))
    return np.abs(1.0 - np.abs(1.0 - np.abs(found)) % 2.0) if (found < 0.0).any() or (found > 1.0).any() else found

"""Motions other than those of the thesis: slower ones, and other parameterisations of the excitation.

The thesis closes with the hypothesis that its parameters might do better in slower motion, and with the question
whether another parameterisation of the trajectory would be better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from armid.checked_array import Array
from armid.excitation.limits.joint_limits import limits_of
from armid.hashes import digest
from armid.maths.linalg import condition, scaled_condition
from armid.maths.signals.fourier_transform import frequencies, inverse, spectrum
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.thesis.algorithm import NOISE, REPETITIONS, TEST_RATE, Fitted, errors_of, estimate, observed
from armid.thesis.setting import DESIGNED, PERIOD, Setting

SLOWER = (1, 2, 4, 8)
"""Factors by which the period of 27 s of Table A.2 of the thesis is multiplied."""


@dataclass(frozen=True, eq=False, slots=True)
class Slower:
    """Torque errors of three estimates along the motion of Table A.2 of the thesis, executed in several periods.

    Attributes:
        period: Period [s], shape (k,).
        torque: Root mean square of the true torque, over all joints [N·m], shape (k,).
        printed: Root mean square of predicted minus true torque for Algorithm 3 as printed [N·m], shape (k,).
        one_sided: Error as in `printed`, with the right sign of gravity and periodic edges, shape (k,).
        corrected: Error as in `printed`, with filtered columns, shape (k,).
    """

    period: Array
    torque: Array
    printed: Array
    one_sided: Array
    corrected: Array


def slower(setting: Setting, printed: Fitted, one_sided: Fitted, corrected: Fitted) -> Slower:
    """Compares the torque that estimates predict along Table A.2 with the true torque, for several periods."""
    periods = PERIOD * np.array(SLOWER, dtype=np.float64)
    found = np.zeros((4, len(periods)))
    for k, period in enumerate(periods):
        motion = setting.unseen.stretched(period).sample(TEST_RATE)
        torque = setting.hanging.dynamics.torque(motion, setting.theta)
        found[0, k] = np.sqrt(np.mean(torque**2))
        for row, fitted in enumerate((printed, one_sided, corrected), 1):
            predicted = fitted.model.dynamics.torque(motion, fitted.model.theta(fitted.fit.values))
            found[row, k] = np.sqrt(np.mean((predicted - torque) ** 2))
    return Slower(periods, *found)


@dataclass(frozen=True, slots=True)
class Family:
    """Best motion of one parameterisation that a random search of a given length finds.

    Attributes:
        name: Name of the parameterisation.
        unknowns: Number of parameters of all joints.
        condition: Condition number of the stacked base regressor Y_b, sampled at 100 Hz.
        scaled: Condition number for columns of unit length.
        highest: Frequency below which 99 % of the variance of a joint's velocity lies, maximum over the joints [Hz].
        printed: Torque error on Table A.2 after Algorithm 3 as printed [N·m].
        corrected: Torque error on Table A.2 with the right sign of gravity and filtered columns [N·m].
    """

    name: str
    unknowns: int
    condition: float
    scaled: float
    highest: float
    printed: float
    corrected: float


def families(setting: Setting, printed: ProcessingOptions, corrected: ProcessingOptions) -> tuple[Family, ...]:
    """Finds a motion for each parameterisation with the same number of tries, and identifies the virtual arm with it.

    Args:
        setting: Arm, true parameters and motions.
        printed: Processing of Algorithm 3 as printed.
        corrected: Processing with filtered columns.
    """
    found: list[Family] = []
    for name, (count, shape) in SHAPES.items():
        rng = np.random.default_rng(1)
        best = _searched(setting, count, shape, rng)
        motion = _motion(setting, shape(best, _grid(TEST_RATE)), TEST_RATE)
        R = _factor(setting, motion)
        recording = _recorded(setting, _motion(setting, shape(best, _grid(RATE)), RATE), rng)
        errors = [
            errors_of(setting, estimate(model, observed(setting, recording, processing, period))).unseen
            for model, processing, period in (
                (setting.literal, printed, None),
                (setting.hanging, corrected, DESIGNED),
            )
        ]
        found.append(
            Family(name, best.size, condition(R), scaled_condition(R), _highest(motion.dq, TEST_RATE), *errors)
        )
    return tuple(found)


def _grid(rate: float) -> Array:
    """Sample times of one period, divided by the period, shape (N,), at a sample rate [Hz]."""
    return np.arange(round(DESIGNED * rate)) / (DESIGNED * rate)


def _fourier(x: Array, s: Array) -> Array:
    """Fourier series of ten harmonics that begins at rest at the position zero, shape (N, 7).

    Args:
        x: Coefficients, shape (7, 20).
        s: Times divided by the period, shape (N,).
    """
    number = np.arange(1, HARMONICS + 1)
    angle = 2.0 * np.pi * number * s[:, None]
    a, b = np.split(x, 2, axis=1)
    a = a - a.mean(axis=1, keepdims=True)
    # rest at zero asks for Σ b / l = 0 and Σ b l = 0
    rows = np.stack([1.0 / number, number])
    b = b - b @ rows.T @ np.linalg.inv(rows @ rows.T) @ rows
    return (np.sin(angle) / number) @ a.T - (np.cos(angle) / number) @ b.T


def _spline(x: Array, s: Array) -> Array:
    """Spline of fifth degree that is at rest at the position zero at both ends, shape (N, 7).

    Args:
        x: Positions at 17 equidistant times for each joint, shape (7, 17).
        s: Times divided by the period, shape (N,).
    """
    knots = np.linspace(0.0, 1.0, x.shape[1] + 2)
    values = np.concatenate([np.zeros((len(x), 1)), x, np.zeros((len(x), 1))], axis=1)
    still = [(1, np.zeros(len(x))), (2, np.zeros(len(x)))]
    curve: Any = make_interp_spline(knots, values.T, k=5, bc_type=(still, still))
    return np.asarray(curve(s), dtype=np.float64)


def _polynomial(x: Array, s: Array) -> Array:
    """Polynomial of degree 22 that is at rest at the position zero at both ends, shape (N, 7).

    Args:
        x: Chebyshev coefficients, shape (7, 17).
        s: Times divided by the period, shape (N,).
    """
    return (s * (1.0 - s))[:, None] ** 3 * np.polynomial.chebyshev.chebval(2.0 * s - 1.0, x.T).T


def _chirp(x: Array, s: Array) -> Array:
    """Sine whose frequency changes linearly with time, shape (N, 7).

    Args:
        x: Logarithms of the first and the last frequency, and a phase, for each joint, shape (7, 3).
        s: Times divided by the period, shape (N,).
    """
    first, last = FREQUENCY * np.exp(0.5 * x[:, :2]).T
    window = np.minimum(1.0, np.minimum(s, 1.0 - s) / FADE)
    window = window**3 * (10.0 - 15.0 * window + 6.0 * window**2)  # C² at its ends
    angle = 2.0 * np.pi * DESIGNED * (first * s[:, None] + 0.5 * (last - first) * s[:, None] ** 2)
    return window[:, None] * np.sin(angle + x[:, 2])


HARMONICS = 10

FREQUENCY, FADE = 0.2, 0.1
"""Mean frequency of chirps [Hz], and share of the period in which a chirp fades in and out."""

SHAPES: dict[str, tuple[int, Callable[[Array, Array], Array]]] = {
    "Fourier series, 10 harmonics": (20, _fourier),
    "spline of fifth degree, 17 points": (17, _spline),
    "polynomial of degree 22": (17, _polynomial),
    "chirp": (3, _chirp),
}
"""Number of parameters of a joint, and function that gives the positions, for each parameterisation by its name. The
positions are scaled to the limits afterwards."""

TRIES, SEARCH_RATE = 60, 25.0
"""Number of tries for each start of Algorithm 2, and sample rate in the search [Hz]. A third of the tries are random;
the others change the best one."""

RATE = 1000.0
"""Sample rate of recordings [Hz]."""


def _searched(
    setting: Setting, count: int, shape: Callable[[Array, Array], Array], rng: np.random.Generator
) -> Array:
    """Parameters (7, count) of the motion with the smallest condition number in a random search.

    Args:
        setting: Arm, true parameters and motions.
        count: Number of parameters of a joint.
        shape: Function that gives the positions (N, 7) for parameters and times.
        rng: Generator of random numbers.
    """
    tries, joints = TRIES * setting.extent.starts, setting.hanging.dynamics.n
    best, smallest, width = np.zeros((joints, count)), np.inf, 0.5
    for k in range(tries):
        fresh = 3 * k < tries
        x = rng.standard_normal((joints, count)) * (1.0 if fresh else width) + (0.0 if fresh else best)
        found = condition(_factor(setting, _motion(setting, shape(x, _grid(SEARCH_RATE)), SEARCH_RATE)))
        better = found < smallest
        if better:
            best, smallest = x, found
        if not fresh:
            width *= 1.5 if better else 0.93
    return best


def _factor(setting: Setting, motion: Motion) -> Array:
    """Triangular factor of the stacked base regressor Y_b along a motion, shape (57, 57)."""
    columns = setting.hanging.columns(motion)
    return np.asarray(np.linalg.qr(columns.reshape(-1, columns.shape[2]), mode="r"))


def _motion(setting: Setting, q: Array, rate: float) -> Motion:
    """Periodic motion with positions in proportion to q (N, 7), at a sample rate [Hz].

    The positions of each joint are scaled so that the joint just reaches its limit of position or of velocity. The
    derivatives are computed from the spectrum, so they are exact for band-limited positions.
    """
    limits = limits_of(setting.hanging.dynamics.robot)
    turn = 2j * np.pi * rate * frequencies(len(q))[:, None]
    dq, ddq = (inverse(turn**k * spectrum(q), len(q)) for k in (1, 2))
    size = np.minimum(limits.upper / np.abs(q).max(axis=0), limits.velocity / np.abs(dq).max(axis=0))
    return Motion(np.arange(len(q)) / rate, size * q, size * dq, size * ddq)


def _highest(dq: Array, rate: float) -> float:
    """Frequency below which 99 % of the variance of a joint's velocity lies, maximum over the joints [Hz].

    Args:
        dq: Velocities, shape (N, 7) [rad/s].
        rate: Sample rate [Hz].
    """
    power = np.cumsum(np.abs(spectrum(dq)) ** 2, axis=0)
    return float(rate * frequencies(len(dq))[np.argmax(power >= 0.99 * power[-1], axis=0)].max())


def _recorded(setting: Setting, motion: Motion, rng: np.random.Generator) -> Recording:
    """Simulates the mean of five noisy repetitions of a motion at 1 kHz; the noise density is that of `NOISE`."""
    size = np.sqrt(RATE / NOISE.rate / REPETITIONS)
    torque = setting.hanging.dynamics.torque(motion, setting.theta)
    q = motion.q + size * NOISE.position * rng.standard_normal(motion.q.shape)
    effort = torque + size * NOISE.torque * rng.standard_normal(motion.q.shape)
    return Recording(
        time=motion.time,
        q=q,
        effort=effort,
        joint_names=setting.hanging.dynamics.robot.joint_names,
        consecutive=True,
        source="virtual iiwa",
        sha256=digest(q, effort),
    )

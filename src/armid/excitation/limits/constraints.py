"""Limits as numbers that are at most one, with exact gradients.

A channel has m values along N samples of a series, each a share of its limit: 1 is at the limit. A search needs one
smooth number for the highest of them; it is taken as

    max + log(Σ exp(p (u - max))) / p,

whose gradient is that of the channel, weighted along the samples by how near each comes to the highest. It lies above
the highest by at most log(N) / p; how far, at the point where a stage of the search begins, is taken off again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from armid.excitation.design.objective import Objective
from armid.robot.kinematics import forward_kinematics
from armid.values import Array

__all__ = ["AmplitudeLimit", "CoefficientLimit", "ConstraintChannel", "RangeLimit", "States", "soft_maximum"]

ROUND = 1e-8
"""Added under the root of an amplitude, so that it has a slope where a harmonic vanishes [(rad/s)²]."""


class States:
    """A series at one point of a search, on the grid of an objective; what several channels need is made once.

    Args:
        objective: Grid, matrices and columns.
        x: The unknowns (n k,).
        filled: Whether the objective's columns are those of x.
    """

    def __init__(self, objective: Objective, x: Array, *, filled: bool = False) -> None:
        self.objective = objective
        self.basis = objective.basis
        self.robot = objective.goal.model.robot
        self.tree = objective.tree
        self.x = x
        self.nearest: dict[int, tuple[Array, Array, Array, Array]] = {}
        self.distances: dict[int, Array] = {}
        self.hulls: dict[int, tuple[Array, Array, Array, Array]] = {}
        self._filled = filled

    @cached_property
    def derivatives(self) -> tuple[Array, Array, Array, Array]:
        """Position, velocity, acceleration and jerk, each (N, n)."""
        q, dq, ddq = self.objective.states(self.x)
        jerk = self.objective.matrices[3] @ self.x.reshape(self.basis.n, -1).T
        return q, dq, ddq, jerk

    @cached_property
    def coefficients(self) -> Array:
        """a, b and offset, shape (n, 2 L + 1)."""
        return self.basis.coefficients(self.x)

    @cached_property
    def poses(self) -> tuple[Array, Array]:
        """Rotations (N, n, 3, 3) and origins (N, n, 3) of the links."""
        return forward_kinematics(self.robot, self.derivatives[0])

    @cached_property
    def speed_bound(self) -> Array:
        """Return what the speed of each joint cannot exceed at any time, shape (n,) [rad/s or m/s]."""
        return np.minimum(
            self.basis.peaks_between(self.x, 1),
            np.abs(self.derivatives[1]).max(axis=0) + self._rise(1),
        )

    def _rise(self, order: int) -> Array:
        """Tell how far a derivative of the positions may rise between points of the grid, shape (n,)."""
        step = self.basis.period / len(self.derivatives[0])
        return step**2 / 8.0 * self.basis.peaks_between(self.x, order + 2)

    def pull_positions(self, by_q: Array) -> Array:
        """Gradients (m, n k) of m sums whose gradients by the positions are (N, m, n)."""
        matrix = self.objective.matrices[0]
        return np.tensordot(by_q, matrix, axes=(0, 0)).reshape(by_q.shape[1], -1)

    def torque(self, values: Array) -> Array:
        """Torque (N, n) of base parameters (b,)."""
        if not self._filled:
            self.objective.columns.fill(*self.derivatives[:3])
            self._filled = True
        return self.objective.columns.torque(values)


class ConstraintChannel(Protocol):
    """Something along a series that has a limit.

    Attributes:
        name: What it is, for instance `velocity`.
        labels: Which joint, pair or place each of its m values belongs to.
    """

    @property
    def name(self) -> str:
        """Return what it is."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Return what each value belongs to."""
        ...

    def values(self, states: States) -> Array:
        """Shares of the limits, shape (N, m); (1, m) for what has no time."""
        ...

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k) of the sums of values weighted by (N, m)."""
        ...

    def between(self, states: States, step: float) -> Array:
        """Tell how far each value may rise between points of the grid, whose step is given [s]; shape (m,)."""
        ...


def soft_maximum(values: Array, sharpness: float) -> tuple[Array, Array]:
    """Smooth highest of each column of (N, m), and its derivative by the values, shape (N, m)."""
    highest = values.max(axis=0)
    worth = np.exp(sharpness * (values - highest))
    total = worth.sum(axis=0)
    return highest + np.log(total) / sharpness, worth / total


@dataclass(frozen=True, eq=False, slots=True)
class RangeLimit:
    """A derivative of the joints' positions that stays within a middle and half a width.

    Attributes:
        name: What it is.
        order: 0 position, 1 velocity, 2 acceleration, 3 jerk.
        joints: Which joints have a limit.
        labels: Their names.
        middle: Shape (m,).
        half: Half the width, shape (m,), positive.
    """

    name: str
    order: int
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    middle: Array
    half: Array

    def _relative(self, states: States) -> Array:
        return (states.derivatives[self.order][:, self.joints] - self.middle) / self.half

    def values(self, states: States) -> Array:
        """Distance from the middle over half the width, shape (N, m)."""
        return np.abs(self._relative(states))

    def pull(self, states: States, weights: Array) -> Array:
        """Each joint's gradient by its own unknowns, shape (m, n k)."""
        slopes = weights * np.sign(self._relative(states)) / self.half
        own = slopes.T @ states.objective.matrices[self.order]
        gradient = np.zeros((len(self.joints), states.basis.n, states.basis.size))
        gradient[np.arange(len(self.joints)), list(self.joints)] = own
        return gradient.reshape(len(self.joints), -1)

    def between(self, states: States, step: float) -> Array:
        """A maximum between two points lies above both by at most step²/8 times the highest second derivative."""
        rise = step**2 / 8.0 * states.basis.peaks_between(states.x, self.order + 2)
        return rise[list(self.joints)] / self.half


@dataclass(frozen=True, eq=False, slots=True)
class AmplitudeLimit:
    """Sums of the harmonics' amplitudes, a bound of a motion whatever its phases: (3.55d) and (3.55e).

    Attributes:
        name: What it is.
        order: 0 for Σ √(a²+b²) / (ω l), a bound of the distance from the offset; 1 for Σ √(a²+b²), one of velocity.
        joints: Which joints have a limit.
        labels: Their names.
        limit: Shape (m,).
    """

    name: str
    order: int
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    limit: Array

    def _parts(self, states: States) -> tuple[Array, Array, Array]:
        L = states.basis.harmonics
        c = states.coefficients[list(self.joints)]
        amplitude = np.sqrt(c[:, :L] ** 2 + c[:, L : 2 * L] ** 2 + ROUND)
        number: Array = np.arange(1.0, L + 1.0)
        worth = np.ones(L) if self.order else 1.0 / (states.basis.base_frequency * number)
        return c, amplitude, worth

    def values(self, states: States) -> Array:
        """Sums over limits, shape (1, m)."""
        _, amplitude, worth = self._parts(states)
        return (amplitude @ worth / self.limit)[None]

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k)."""
        c, amplitude, worth = self._parts(states)
        L = states.basis.harmonics
        slopes = np.zeros_like(c)
        slopes[:, : 2 * L] = c[:, : 2 * L] * np.tile(worth / amplitude, 2)
        own = (weights[0] / self.limit)[:, None] * (slopes @ states.basis.null_space)
        gradient = np.zeros((len(self.joints), states.basis.n, states.basis.size))
        gradient[np.arange(len(self.joints)), list(self.joints)] = own
        return gradient.reshape(len(self.joints), -1)

    def between(self, states: States, step: float) -> Array:
        """Nothing: what is limited does not depend on time."""
        del states, step
        return np.zeros(len(self.labels))


@dataclass(frozen=True, eq=False, slots=True)
class CoefficientLimit:
    """Every coefficient by itself: (3.55f).

    Attributes:
        name: What it is.
        joints: Which joints have limits.
        labels: Joint of each coefficient, 2 L a joint.
        limit: Of a and b alike, shape (joints, L).
    """

    name: str
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    limit: Array

    def _relative(self, states: States) -> Array:
        L = states.basis.harmonics
        return (states.coefficients[list(self.joints), : 2 * L] / np.tile(self.limit, 2)).ravel()

    def values(self, states: States) -> Array:
        """Coefficients over limits, shape (1, m)."""
        return np.abs(self._relative(states))[None]

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k)."""
        L = states.basis.harmonics
        slopes = weights[0] * np.sign(self._relative(states)) / np.tile(self.limit, 2).ravel()
        gradient = np.zeros((len(self.labels), states.basis.n, states.basis.size))
        for at, joint in enumerate(self.joints):
            rows = slice(at * 2 * L, (at + 1) * 2 * L)
            gradient[rows, joint] = slopes[rows, None] * states.basis.null_space[: 2 * L]
        return gradient.reshape(len(self.labels), -1)

    def between(self, states: States, step: float) -> Array:
        """Nothing: what is limited does not depend on time."""
        del states, step
        return np.zeros(len(self.labels))

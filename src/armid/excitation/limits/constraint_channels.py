"""Constraint channels: utilisations of limits (values divided by their limits) along a series, with exact gradients.

A channel has m utilisations u at each of the N samples of a series; each must be at most one. A search needs a smooth
maximum over the samples. With an exponent p it is

    max + log(Σ exp(p (u - max))) / p.

The gradient of this maximum is the mean of the gradients at the samples, weighted by exp(p (u - max)). The smooth
maximum exceeds the maximum by at most log(N) / p; the search computes this excess at the start of each stage and
subtracts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from armid.checked_array import Array
from armid.excitation.design.objective import Objective
from armid.excitation.design.regressor_gradients import Columns
from armid.information.base_regressor_layout import ColumnSource
from armid.robot.kinematics import forward_kinematics

ROUND = 1e-8
"""Number that is added to a² + b² under the square root of an amplitude [(rad/s)² or (m/s)²], so that the amplitude
has a derivative if a harmonic vanishes."""


class States:
    """Motion of a series on the grid of an objective, with cached quantities that several channels use.

    Args:
        objective: Grid, matrices and columns.
        x: Unknowns of the series, shape (n k,).
        filled: True if the columns of the objective are already evaluated at `x`.
        rough: True if distances of bodies that are far apart may be replaced by lower bounds, which have no
            gradients.
    """

    def __init__(self, objective: Objective, x: Array, *, filled: bool = False, rough: bool = False) -> None:
        self.objective = objective
        self.basis = objective.basis
        self.robot = objective.goal.model.robot
        self.tree = objective.tree
        self.x = x
        self.nearest: dict[int, tuple[Array, Array, Array, Array]] = {}
        self.distances: dict[int, Array] = {}
        self.hulls: dict[int, tuple[Array, Array, Array, Array]] = {}
        self.rough = rough
        self._filled: set[Columns] = {objective.columns} if filled else set()

    @cached_property
    def derivatives(self) -> tuple[Array, Array, Array, Array]:
        """Positions, velocities, accelerations and jerks of the joints along the motion, each (N, n)."""
        q, dq, ddq = self.objective.states(self.x)
        jerk = self.objective.matrices[3] @ self.x.reshape(self.basis.n, -1).T
        return q, dq, ddq, jerk

    @cached_property
    def coefficients(self) -> Array:
        """Coefficients a, b and offset of the series, shape (n, 2 L + 1)."""
        return self.basis.coefficients(self.x)

    @cached_property
    def poses(self) -> tuple[Array, Array]:
        """Rotations (N, n, 3, 3) and origins (N, n, 3) of the links along the motion."""
        return forward_kinematics(self.robot, self.derivatives[0])

    @cached_property
    def speed_bound(self) -> Array:
        """Upper bound of the speed of each joint at all times, shape (n,) [rad/s or m/s]."""
        return np.minimum(
            self.basis.peaks_between(self.x, 1),
            np.abs(self.derivatives[1]).max(axis=0) + self._rise(1),
        )

    def _rise(self, order: int) -> Array:
        """Upper bound (n,) of the rise of a position's derivative of given order between neighbouring grid points."""
        step = self.basis.period / len(self.derivatives[0])
        return step**2 / 8.0 * self.basis.peaks_between(self.x, order + 2)

    def pullback_positions(self, by_q: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of m sums whose gradients by the positions are `by_q` (N, m, n)."""
        matrix = self.objective.matrices[0]
        return np.tensordot(by_q, matrix, axes=(0, 0)).reshape(by_q.shape[1], -1)

    def columns(self, source: ColumnSource | None = None) -> Columns:
        """Regressor columns along the motion, for the model of `source` or, if not given, of the design goal."""
        columns = self.objective.columns if source is None else self.objective.columns_of(source)
        if columns not in self._filled:
            columns.fill(*self.derivatives[:3])
            self._filled.add(columns)
        return columns

    def torque(self, values: Array) -> Array:
        """Torque (N, n) [N·m or N] along the motion, for base parameters (b,) of the goal."""
        return self.columns().torque(values)


class ConstraintChannel(Protocol):
    """Quantity along a series that has a limit (constraint channel), with m limited values at each sample.

    Attributes:
        name: Name of the quantity, for instance `velocity`.
        labels: Names of the joints, pairs of bodies or planes to which the m limits belong.
    """

    @property
    def name(self) -> str:
        """Name of the limited quantity, for instance `velocity`."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the joints, pairs of bodies or planes to which the m limits belong."""
        ...

    def values(self, states: States) -> Array:
        """Utilisations of the limits, shape (N, m); (1, m) for limits that do not depend on time."""
        ...

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m)."""
        ...

    def between(self, states: States, step: float) -> Array:
        """Upper bound of the rise of each utilisation between points of a grid with a given step [s], shape (m,)."""
        ...


def soft_maximum(values: Array, sharpness: float) -> tuple[Array, Array]:
    """Smooth maximum (m,) of each column of values (N, m), and its derivatives by the values, shape (N, m)."""
    highest = values.max(axis=0)
    weights = np.exp(sharpness * (values - highest))
    total = weights.sum(axis=0)
    return highest + np.log(total) / sharpness, weights / total


@dataclass(frozen=True, eq=False, slots=True)
class RangeLimit:
    """Constraint channel of the range of m joint positions, or of one of their derivatives.

    Attributes:
        name: Name of the limited quantity.
        order: Order of the derivative: 0 position, 1 velocity, 2 acceleration, 3 jerk.
        joints: Indices of the joints with a limit.
        labels: Names of these joints.
        middle: Middle of the range, shape (m,), in the unit of the quantity.
        half: Half the width of the range, positive, shape (m,), in the unit of the quantity.
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
        """Utilisations (N, m): distance from the middle of the range divided by half the width of the range."""
        return np.abs(self._relative(states))

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m)."""
        slopes = weights * np.sign(self._relative(states)) / self.half
        blocks = slopes.T @ states.objective.matrices[self.order]
        gradient = np.zeros((len(self.joints), states.basis.n, states.basis.size))
        gradient[np.arange(len(self.joints)), list(self.joints)] = blocks
        return gradient.reshape(len(self.joints), -1)

    def between(self, states: States, step: float) -> Array:
        """Upper bound (m,) of the rise of each utilisation between grid points, from its second time derivative."""
        rise = step**2 / 8.0 * states.basis.peaks_between(states.x, self.order + 2)
        return rise[list(self.joints)] / self.half


@dataclass(frozen=True, eq=False, slots=True)
class AmplitudeLimit:
    """Constraint channel of the sums of the amplitudes of the harmonics, equations (3.55d) and (3.55e) of the thesis.

    The sum bounds the motion for all phases of the harmonics.

    Attributes:
        name: Name of the limited quantity.
        order: 0 for Σ √(a²+b²) / (ω l), a bound of the distance from the offset; 1 for Σ √(a²+b²), a bound of the
            velocity. The sums are over the harmonics l with coefficients a and b and base frequency ω.
        joints: Indices of the joints with a limit.
        labels: Names of these joints.
        limit: Limits of the sums, shape (m,) [rad or m for order 0, rad/s or m/s for order 1].
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
        factors = np.ones(L) if self.order else 1.0 / (states.basis.base_frequency * number)
        return c, amplitude, factors

    def values(self, states: States) -> Array:
        """Sums of amplitudes divided by their limits, shape (1, m)."""
        _, amplitude, factors = self._parts(states)
        return (amplitude @ factors / self.limit)[None]

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the utilisations times weights (1, m)."""
        c, amplitude, factors = self._parts(states)
        L = states.basis.harmonics
        slopes = np.zeros_like(c)
        slopes[:, : 2 * L] = c[:, : 2 * L] * np.tile(factors / amplitude, 2)
        blocks = (weights[0] / self.limit)[:, None] * (slopes @ states.basis.null_space)
        gradient = np.zeros((len(self.joints), states.basis.n, states.basis.size))
        gradient[np.arange(len(self.joints)), list(self.joints)] = blocks
        return gradient.reshape(len(self.joints), -1)

    def between(self, states: States, step: float) -> Array:
        """Zeros, shape (m,): the values do not depend on time, so they do not rise between points of a grid."""
        del states, step
        return np.zeros(len(self.labels))


@dataclass(frozen=True, eq=False, slots=True)
class CoefficientLimit:
    """Constraint channel of every single coefficient of the series, equation (3.55f) of the thesis.

    Attributes:
        name: Name of the limited quantity.
        joints: Indices of the joints with a limit.
        labels: Name of the joint of each coefficient; 2 L coefficients for each joint.
        limit: Limits of the coefficients a and b, shape (joints, L) [rad/s or m/s].
    """

    name: str
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    limit: Array

    def _relative(self, states: States) -> Array:
        L = states.basis.harmonics
        return (states.coefficients[list(self.joints), : 2 * L] / np.tile(self.limit, 2)).ravel()

    def values(self, states: States) -> Array:
        """Absolute values of the coefficients divided by their limits, shape (1, m)."""
        return np.abs(self._relative(states))[None]

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the utilisations times weights (1, m)."""
        L = states.basis.harmonics
        slopes = weights[0] * np.sign(self._relative(states)) / np.tile(self.limit, 2).ravel()
        gradient = np.zeros((len(self.labels), states.basis.n, states.basis.size))
        for at, joint in enumerate(self.joints):
            rows = slice(at * 2 * L, (at + 1) * 2 * L)
            gradient[rows, joint] = slopes[rows, None] * states.basis.null_space[: 2 * L]
        return gradient.reshape(len(self.labels), -1)

    def between(self, states: States, step: float) -> Array:
        """Zeros, shape (m,): the values do not depend on time, so they do not rise between points of a grid."""
        del states, step
        return np.zeros(len(self.labels))

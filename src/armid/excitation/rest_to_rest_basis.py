"""Basis of all Fourier series that start and end at rest; coordinates in this basis are the unknowns of a design.

The series of equation (3.55b) of the thesis is at rest at t = 0 if its coefficients meet linear conditions:

    Σ a_l = 0  (velocity),   Σ l b_l = 0  (acceleration),   offset - Σ b_l / (ω l) = start  (position)        (3.55c)

The series is written in a basis of the null space of these conditions, so that no solver has to enforce them. The
thesis also requires Σ b_l / l = 0, so that the offset of each joint is its start position; the option `literal`
enforces this condition. Without it, each joint has one more unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.excitation.fourier import Excitation

ORDERS = 4
"""Number of matrices that `SeriesBasis.matrices` returns: for position, velocity, acceleration and jerk."""


@dataclass(frozen=True, eq=False)
class SeriesBasis:
    """Affine map from the unknowns x (n, k) to the series of n joints with L harmonics that are at rest at t = 0.

    Attributes:
        base_frequency: Angular frequency ω of the first harmonic [rad/s].
        harmonics: Number L of harmonics.
        start: Pose at t = 0, shape (n,) [rad or m]; if `free`, the pose that belongs to x = 0.
        free: True if the start pose is one of the unknowns.
        literal: True if the offset of each joint must be its start position, Σ b_l / l = 0, as in equation (3.55c) of
            the thesis.
    """

    base_frequency: float
    harmonics: int
    start: Array
    free: bool = False
    literal: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_frequency", float(self.base_frequency))
        object.__setattr__(self, "start", array(self.start, (None,), "start"))
        if not 0.0 < self.base_frequency < math.inf:
            raise ArmidError(
                f"The base frequency must be positive; found {self.base_frequency} rad/s.",
                remedy="give a duration above zero.",
            )
        fewest = 2
        if self.harmonics < fewest:
            raise ArmidError(
                f"A series with {self.harmonics} harmonics cannot start and end at rest: the conditions on velocity "
                "and acceleration leave no coefficients free.",
                possible=f"{fewest} harmonics or more",
                remedy="give more harmonics; about ten are usual.",
            )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.start)

    @property
    def period(self) -> float:
        """Duration of one period [s]."""
        return 2.0 * math.pi / self.base_frequency

    @cached_property
    def null_space(self) -> Array:
        """Orthonormal basis of the coefficients (a, b, offset) of a joint at rest at t = 0, shape (2 L + 1, k)."""
        number, L = np.arange(1.0, self.harmonics + 1.0), self.harmonics
        rows = np.zeros((4, 2 * L + 1))
        rows[0, :L] = 1.0
        rows[1, L : 2 * L] = number / L
        rows[2, L : 2 * L] = 1.0 / number
        rows[3, L : 2 * L] = -1.0 / (self.base_frequency * number)
        rows[3, -1] = 1.0
        wanted = np.array([True, True, self.literal, not self.free], dtype=np.bool_)
        if self.literal:  # then the position's row says that the offset is the start pose
            rows[3] = 0.0
            rows[3, -1] = 1.0
        chosen = rows[wanted]
        return np.linalg.svd(chosen)[2][len(chosen) :].T.copy()

    @property
    def size(self) -> int:
        """Number k of unknowns of one joint."""
        return self.null_space.shape[1]

    @property
    def unknowns(self) -> int:
        """Number n k of unknowns of all joints."""
        return self.n * self.size

    def coefficients(self, x: ArrayLike) -> Array:
        """Coefficients (a, b, offset), shape (n, 2 L + 1), of the series with unknowns x, shape (n k,)."""
        result = np.asarray(x, dtype=np.float64).reshape(self.n, self.size) @ self.null_space.T
        result[:, -1] += self.start
        return result

    def excitation(self, x: ArrayLike, robot: str = "") -> Excitation:
        """Series with the unknowns x, shape (n k,)."""
        c, L = self.coefficients(x), self.harmonics
        return Excitation(self.base_frequency, c[:, :L], c[:, L : 2 * L], c[:, -1], robot)

    def project(self, coefficients: ArrayLike) -> Array:
        """Unknowns (n k,) of the series nearest to coefficients (n, 2 L + 1), by orthogonal projection."""
        c = np.array(coefficients, dtype=np.float64)
        c[:, -1] -= self.start
        return (c @ self.null_space).ravel()

    def unknowns_of(self, excitation: Excitation) -> Array:
        """Unknowns (n k,) of an excitation, which must have as many joints and harmonics as the basis."""
        return self.project(np.hstack([excitation.a, excitation.b, excitation.offset[:, None]]))

    def matrices(self, time: ArrayLike) -> tuple[Array, ...]:
        """Matrices (N, k) that map unknowns of a joint to its position minus start, velocity, acceleration and jerk.

        `time` are the N times [s].
        """
        t = array(time, (None,), "time")
        f = self.base_frequency * np.arange(1, self.harmonics + 1)
        s, c = np.sin(np.outer(t, f)), np.cos(np.outer(t, f))
        one, none = np.ones((len(t), 1)), np.zeros((len(t), 1))
        rows = ((s / f, -c / f, one), (c, s, none), (-s * f, c * f, none), (-c * f**2, -s * f**2, none))
        return tuple(np.ascontiguousarray(np.hstack(row) @ self.null_space) for row in rows[:ORDERS])

    def times(self, samples: int) -> Array:
        """Uniform grid of one period, shape (samples,) [s]."""
        return np.arange(float(samples)) * (self.period / samples)

    def peaks_between(self, x: ArrayLike, order: int) -> Array:
        """Upper bound (n,) of a time derivative of each joint position at all times, for any phases of the harmonics.

        The bound is the sum of the amplitudes. If a quantity is sampled on a grid of step h, it rises between the
        points by at most h²/8 times the bound of its second derivative.

        Args:
            x: Unknowns of the series, shape (n k,).
            order: Order of the derivative: 0 position (without offset), 1 velocity, 2 acceleration, and so on.
        """
        c, L = self.coefficients(x), self.harmonics
        f: Array = self.base_frequency * np.arange(1.0, L + 1.0)
        return np.hypot(c[:, :L], c[:, L : 2 * L]) @ f ** (order - 1)

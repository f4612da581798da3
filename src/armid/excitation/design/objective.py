"""The number that a design makes small, with its exact gradient by the unknowns of the series.

The gradient takes one sweep: the criterion's derivative by G turns columns into what each of them is worth, the
kernel's adjoint turns that into worths of positions, velocities and accelerations, and these are linear in the
unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armid.errors import ArmidError
from armid.excitation.design.criteria import make_criterion
from armid.excitation.design.sensitivity import Columns
from armid.excitation.series_basis import SeriesBasis
from armid.information.column_source import ColumnSource, column_source
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array, array

__all__ = ["CriterionGoal", "Objective", "along", "information_along", "known_sizes"]


TOLD = 3.0
"""Deviations from zero from which on a parameter counts as told from it; three zeros in a thousand do by chance."""


@dataclass(frozen=True, eq=False, slots=True)
class CriterionGoal:
    """Purpose of a motion.

    Attributes:
        model: Arm and torque terms.
        base: Its base parameters; their columns make the information.
        criterion: Name, see `criteria.CRITERIA`.
        noise: Standard deviation of each joint's torque, shape (n,) [N·m or N]; one where not given.
        rate: Samples a second that will count [Hz].
        repetitions: Periods that will be recorded.
        prior: Information that is there already, shape (b, b), in units of the same noise; none where not given.
        prediction: Information matrix (b, b) of the motions whose torque is to be predicted.
        scale: Sizes of the base parameters, to which deviations are compared by `worst`, shape (b,); infinite for
            those that do not count.
    """

    model: DynamicsModel
    base: BaseParameters
    criterion: str = "d-optimal"
    noise: Array = field(default_factory=lambda: np.zeros(0))
    rate: float = 100.0
    repetitions: int = 1
    prior: Array | None = None
    prediction: Array | None = None
    scale: Array | None = None

    def __post_init__(self) -> None:
        noise = array(self.noise if np.size(self.noise) else np.ones(self.model.n), (self.model.n,), "noise")
        if (noise <= 0.0).any():
            raise ArmidError("The noise of every joint must be positive.", remedy="give standard deviations.")
        if not self.rate > 0.0 or self.repetitions < 1:
            raise ArmidError(f"rate and repetitions must be positive; found {self.rate} and {self.repetitions}.")
        object.__setattr__(self, "noise", noise)
        shape = (self.base.count, self.base.count)
        for name in ("prior", "prediction"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, shape, name))
        if self.scale is not None:
            object.__setattr__(self, "scale", array(self.scale, (self.base.count,), "scale", finite=False))
        make_criterion(self.criterion, 1.0, self.prediction)

    @property
    def source(self) -> ColumnSource:
        """Model and layout of the base parameters' columns."""
        return column_source(self.model, self.base)

    def value(self, G: Array) -> float:
        """The criterion itself, without smoothing."""
        return make_criterion(self.criterion, np.inf, self.prediction, self.scale)(G)[0]


class Objective:
    """The criterion of a goal along a series, on an even grid of one period.

    Args:
        goal: What the motion is for.
        basis: The unknowns.
        samples: Points of the grid; sums over them stand for those at the goal's rate.
        width: Width of tanh in the place of signs [rad/s or m/s]; 0 leaves the laws as they are.
        sharpness: p of the norms that stand for extremes of eigenvalues.
        times: Points of the grid where they are not even ones of a period, shape (samples,) [s].
    """

    def __init__(
        self,
        goal: CriterionGoal,
        basis: SeriesBasis,
        samples: int,
        *,
        width: float = 0.0,
        sharpness: float = np.inf,
        times: Array | None = None,
    ) -> None:
        self.goal = goal
        self.basis = basis
        self.tree = goal.model.tree
        self.times = basis.times(samples) if times is None else times
        self.matrices = basis.matrices(self.times)
        self._width = width
        self._criterion = make_criterion(goal.criterion, sharpness, goal.prediction, goal.scale)
        rows = goal.rate * basis.period * goal.repetitions
        self._weights = (rows / samples) / goal.noise**2
        self._shape = (basis.n, basis.size)

    @cached_property
    def columns(self) -> Columns:
        """The base parameters' columns, made when they are first asked for: limits of the motion need none."""
        return Columns(self.goal.source, len(self.times), self._width)

    def states(self, x: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (N, n) of unknowns (n k,)."""
        unknowns = np.asarray(x).reshape(self._shape).T
        q, dq, ddq = (matrix @ unknowns for matrix in self.matrices[:3])
        q += self.basis.start
        return q, dq, ddq

    def information(self, x: ArrayLike) -> Array:
        """G of a series, prior included, shape (b, b)."""
        self.columns.fill(*self.states(x))
        G = self.columns.information(self._weights)
        return G if self.goal.prior is None else G + self.goal.prior

    def value(self, x: ArrayLike) -> float:
        """The criterion."""
        return self._criterion(self.information(x))[0]

    def __call__(self, x: ArrayLike) -> tuple[float, Array]:
        """The criterion and its gradient (n k,)."""
        value, slopes = self._criterion(self.information(x))
        return value, self.pull(self.columns.information_gradient(slopes, self._weights))

    def pull(self, gradient: tuple[Array, ...]) -> Array:
        """Gradient (n k,) of what has gradients by positions, velocities, accelerations and so on, each (N, n)."""
        total = sum(matrix.T @ part for matrix, part in zip(self.matrices, gradient, strict=False))
        return np.asarray(total).T.ravel()


def information_along(goal: CriterionGoal, motion: Motion) -> Array:
    """G of any motion sampled at the goal's rate, with the laws as they are, once; shape (b, b)."""
    columns = Columns(goal.source, motion.samples)
    columns.fill(motion.q, motion.dq, motion.ddq)
    return columns.information(1.0 / goal.noise**2)


def along(goal: CriterionGoal, motion: Motion) -> Array:
    """G of a motion repeated as the goal says, with what is there already, shape (b, b)."""
    G = goal.repetitions * information_along(goal, motion)
    return G if goal.prior is None else G + goal.prior


def known_sizes(values: Array, deviations: Array) -> Array | None:
    """Sizes of parameters that deviations are put beside by the criterion `worst`, infinite where there are none.

    Relative is only the deviation of a parameter that is told from zero, `TOLD` deviations away. The others, which
    the arm's symmetry makes vanish or noise hides, have no size that a deviation could be compared with.

    Args:
        values: Estimates, shape (b,).
        deviations: Their standard deviations, shape (b,).

    Returns:
        Shape (b,), or `None` where no parameter is told from zero.
    """
    told = np.abs(values) > TOLD * deviations
    return np.where(told, np.abs(values), np.inf) if told.any() else None

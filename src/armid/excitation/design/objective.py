"""Objective function of a design, with its exact gradient by the unknowns of the series.

The gradient is computed in reverse mode. The criterion's derivative by G gives the derivative by each column of the
regressor; the adjoint of the kernel turns that into derivatives by positions, velocities and accelerations; these are
linear in the unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armid.errors import ArmidError
from armid.excitation.design.criteria import make_criterion
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.information.column_source import ColumnSource, column_source
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array, array

SIGNIFICANT = 3.0
"""Standard deviations from zero from which a parameter counts as significant; by chance three in a thousand
parameters that are zero exceed it."""


@dataclass(frozen=True, eq=False, slots=True)
class CriterionGoal:
    """Criterion of a motion, with the model and the noise that its information depends on.

    Attributes:
        model: Arm and torque terms.
        base: Its base parameters; their columns make the information.
        criterion: Name, see `criteria.CRITERIA`.
        noise: Standard deviation of each joint's torque, shape (n,) [N·m or N]; one where not given.
        rate: Independent samples per second [Hz].
        repetitions: Periods that will be recorded.
        prior: Information from earlier data, shape (b, b), with the same noise; none where not given.
        prediction: Information matrix (b, b) of the motions whose torque is to be predicted.
        scale: Sizes of the base parameters, to which the criterion `worst` compares their standard deviations, shape
            (b,); infinite for those to be ignored.
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
        """Criterion of an information matrix, without smoothing."""
        return make_criterion(self.criterion, np.inf, self.prediction, self.scale)(G)[0]


class Objective:
    """Criterion of a series, on a uniform grid of one period.

    Args:
        goal: Criterion, model and noise.
        basis: The unknowns.
        samples: Points of the grid; sums over them are scaled to the goal's rate.
        width: Width of the tanh that replaces signs [rad/s or m/s]; 0 keeps the laws as they are.
        sharpness: Exponent p of the norms that replace extreme eigenvalues.
        times: Points of the grid where it is not uniform over a period, shape (samples,) [s].
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
        """Columns of the base parameters, allocated at first use because limits of the motion do not need them."""
        return Columns(self.goal.source, len(self.times), self._width)

    def states(self, x: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (N, n) at unknowns (n k,)."""
        unknowns = np.asarray(x).reshape(self._shape).T
        q, dq, ddq = (matrix @ unknowns for matrix in self.matrices[:3])
        q += self.basis.start
        return q, dq, ddq

    def information(self, x: ArrayLike) -> Array:
        """Information matrix G (b, b) of a series, prior included."""
        self.columns.fill(*self.states(x))
        G = self.columns.information(self._weights)
        return G if self.goal.prior is None else G + self.goal.prior

    def value(self, x: ArrayLike) -> float:
        """Criterion at unknowns (n k,)."""
        return self._criterion(self.information(x))[0]

    def __call__(self, x: ArrayLike) -> tuple[float, Array]:
        """Criterion and its gradient (n k,) at unknowns (n k,)."""
        value, slopes = self._criterion(self.information(x))
        return value, self.pullback(self.columns.information_gradient(slopes, self._weights))

    def pullback(self, gradient: tuple[Array, ...]) -> Array:
        """Gradient (n k,) by the unknowns from gradients by positions and their derivatives in order, each (N, n)."""
        total = sum(matrix.T @ part for matrix, part in zip(self.matrices, gradient, strict=False))
        return np.asarray(total).T.ravel()


def information_along(goal: CriterionGoal, motion: Motion) -> Array:
    """Information matrix G (b, b) of one pass of a motion that is sampled at the goal's rate, without smoothing."""
    columns = Columns(goal.source, motion.samples)
    columns.fill(motion.q, motion.dq, motion.ddq)
    return columns.information(1.0 / goal.noise**2)


def along(goal: CriterionGoal, motion: Motion) -> Array:
    """Information matrix G (b, b) of a motion with the goal's repetitions and prior."""
    G = goal.repetitions * information_along(goal, motion)
    return G if goal.prior is None else G + goal.prior


def known_sizes(values: Array, deviations: Array) -> Array | None:
    """Sizes of parameters to which the criterion `worst` compares standard deviations.

    A parameter has a size if its estimate is at least `SIGNIFICANT` standard deviations from zero. The others vanish
    by symmetry of the arm or are hidden by noise, so that a relative deviation has no meaning for them; their size is
    infinite.

    Args:
        values: Estimates, shape (b,).
        deviations: Their standard deviations, shape (b,).

    Returns:
        Shape (b,), or `None` where no parameter differs significantly from zero.
    """
    significant = np.abs(values) > SIGNIFICANT * deviations
    return np.where(significant, np.abs(values), np.inf) if significant.any() else None

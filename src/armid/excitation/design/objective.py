"""Objective function of a design, with its exact gradient with respect to the unknowns of the series.

The gradient is computed in reverse mode. The derivative of the criterion with respect to G gives its derivative with
respect to each column of the regressor. The adjoint of the kernel converts this to derivatives with respect to
positions, velocities and accelerations, which are linear functions of the unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.excitation.design.criteria import make_criterion
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.information.base_regressor_layout import ColumnSource, column_source
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

SIGNIFICANT = 3.0
"""Ratio of an estimate to its standard deviation above which a parameter counts as significant. By chance, the ratio
is larger for three of a thousand parameters whose true value is zero."""


@dataclass(frozen=True, eq=False, slots=True)
class CriterionGoal:
    """Criterion of a motion, with the model, the noise and the prior that determine the information matrix.

    Attributes:
        model: Arm and torque terms.
        base: Base parameters of the model; the information matrix is computed from their columns.
        criterion: Name of the criterion, one of `criteria.CRITERIA`.
        noise: Standard deviation of the torque of each joint, shape (n,) [N·m or N]; 1 if it is not given.
        rate: Number of independent samples per second [Hz].
        repetitions: Number of periods that will be recorded.
        prior: Information matrix of earlier data with the same noise, shape (b, b); `None` if there are no earlier
            data.
        prediction: Information matrix (b, b) of the motions whose torque the model must predict well.
        scale: Typical values of the base parameters, shape (b,), by which the criterion `worst` divides their
            standard deviations; infinite for parameters to be ignored.
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
            raise ArmidError(
                "The noise of every joint must be positive.", remedy="give positive standard deviations of torque."
            )
        if not self.rate > 0.0 or self.repetitions < 1:
            raise ArmidError(
                f"The arguments `rate` and `repetitions` must be positive; found {self.rate} and {self.repetitions}.",
                remedy="give positive numbers.",
            )
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
        """Source of the regressor columns of the base parameters: the model, and the layout of the columns."""
        return column_source(self.model, self.base)

    def value(self, G: Array) -> float:
        """Criterion of an information matrix (b, b), computed with exact eigenvalues."""
        return make_criterion(self.criterion, np.inf, self.prediction, self.scale)(G)[0]


class Objective:
    """Criterion of a series, on a uniform grid of one period.

    Args:
        goal: Criterion, model and noise.
        basis: Basis of the series; its coordinates are the unknowns.
        samples: Number of points of the grid. The information of the grid points is scaled to the number of samples
            at the rate of the goal.
        width: Width of the tanh that replaces signs [rad/s or m/s]; if 0, the laws are not smoothed.
        sharpness: Exponent p of the norms that replace extreme eigenvalues.
        times: Points of the grid, shape (samples,) [s]; a uniform grid of one period if not given.
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
        self._of_others: dict[ColumnSource, Columns] = {}

    @cached_property
    def columns(self) -> Columns:
        """Regressor columns of the base parameters on the grid; allocated on first use."""
        return Columns(self.goal.source, len(self.times), self._width)

    def columns_of(self, source: ColumnSource) -> Columns:
        """Regressor columns of another model on the grid, smoothed like those of the goal; allocated on first use."""
        if source not in self._of_others:
            self._of_others[source] = Columns(source, len(self.times), self._width)
        return self._of_others[source]

    def states(self, x: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations, each (N, n), of the series with unknowns x, shape (n k,)."""
        unknowns = np.asarray(x).reshape(self._shape).T
        q, dq, ddq = (matrix @ unknowns for matrix in self.matrices[:3])
        q += self.basis.start
        return q, dq, ddq

    def information(self, x: ArrayLike) -> Array:
        """Information matrix G (b, b) of the series with unknowns x, shape (n k,); it includes the prior."""
        self.columns.fill(*self.states(x))
        G = self.columns.information(self._weights)
        return G if self.goal.prior is None else G + self.goal.prior

    def value(self, x: ArrayLike) -> float:
        """Criterion of the series with unknowns x, shape (n k,): k for each joint."""
        return self._criterion(self.information(x))[0]

    def __call__(self, x: ArrayLike) -> tuple[float, Array]:
        """Criterion of the series with unknowns x, shape (n k,), and the gradient (n k,) of the criterion."""
        value, slopes = self._criterion(self.information(x))
        return value, self.pullback(self.columns.information_gradient(slopes, self._weights))

    def pullback(self, gradient: tuple[Array, ...]) -> Array:
        """Gradient (n k,) by the unknowns, from gradients (N, n) by positions, velocities and higher derivatives."""
        total = sum(matrix.T @ part for matrix, part in zip(self.matrices, gradient, strict=False))
        return np.asarray(total).T.ravel()


def information_along(goal: CriterionGoal, motion: Motion) -> Array:
    """Information matrix G (b, b) of a motion that is sampled at the goal's rate, without repetitions and prior."""
    columns = Columns(goal.source, motion.samples)
    columns.fill(motion.q, motion.dq, motion.ddq)
    return columns.information(1.0 / goal.noise**2)


def along(goal: CriterionGoal, motion: Motion) -> Array:
    """Information matrix G (b, b) of a motion, with the repetitions and the prior of the goal."""
    G = goal.repetitions * information_along(goal, motion)
    return G if goal.prior is None else G + goal.prior


def known_sizes(values: Array, deviations: Array) -> Array | None:
    """Typical values of parameters, for the criterion `worst`, which divides standard deviations by them.

    The typical value of a parameter is its estimate if this is more than `SIGNIFICANT` standard deviations from zero.
    The other parameters are zero because of a symmetry of the arm, or cannot be distinguished from noise. A relative
    deviation has no meaning for them, so their typical value is infinite.

    Args:
        values: Estimates, shape (b,).
        deviations: Standard deviations of the estimates, shape (b,).

    Returns:
        Typical values, shape (b,); `None` if no parameter differs significantly from zero.
    """
    significant = np.abs(values) > SIGNIFICANT * deviations
    return np.where(significant, np.abs(values), np.inf) if significant.any() else None

"""Torque limits of the joints as a constraint channel, for given base parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armid.checked_array import Array
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.torque_curvature import ORDERS, torque_curvature
from armid.information.base_regressor_layout import ColumnSource, column_source
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel


@dataclass(frozen=True, eq=False)
class TorqueModel:
    """Model that computes the torque to be limited, if it differs from the model of the criterion.

    Attributes:
        model: Arm and torque terms.
        base: Base parameters of the model.
    """

    model: DynamicsModel
    base: BaseParameters

    @cached_property
    def source(self) -> ColumnSource:
        """Source of the regressor columns of the base parameters: the model, and the layout of the columns."""
        return column_source(self.model, self.base)


@dataclass(frozen=True, eq=False, slots=True)
class EstimatedTorque:
    """Estimate with which the torque of a plan is computed.

    Attributes:
        model: Model of the estimate.
        values: Base parameters of the model, shape (b,).
        origin: Name of the estimate, for messages.
        terms: Names of the torque terms of the estimate.
    """

    model: TorqueModel
    values: Array
    origin: str
    terms: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Torque:
    """Constraint channel of the joint torques, computed with given base parameters.

    Attributes:
        name: Name of the limited quantity.
        joints: Indices of the joints with a limit.
        labels: Names of these joints.
        base: Base parameters (of the description or identified), shape (b,).
        limit: Torque limits after subtraction of the margin, shape (m,) [N·m or N].
        described: Model to which the base parameters belong; `None` if it is the model of the design's criterion.
    """

    name: str
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    base: Array
    limit: Array
    described: TorqueModel | None = None

    def source(self, goal: CriterionGoal) -> ColumnSource:
        """Source of the regressor columns of the base parameters: the model, and the layout of the columns."""
        return goal.source if self.described is None else self.described.source

    def along(self, goal: CriterionGoal, q: Array, dq: Array, ddq: Array) -> Array:
        """Utilisations (N, m) of the torque limits at states q, dq, ddq, (N, n) each: |torque| / limit."""
        columns = Columns(self.source(goal), len(q))
        columns.fill(q, dq, ddq)
        return np.abs(columns.torque(self.base)[:, self.joints]) / self.limit

    def values(self, states: States) -> Array:
        """Utilisations of the torque limits, |torque| / limit, shape (N, m)."""
        return np.abs(self._columns(states).torque(self.base)[:, self.joints]) / self.limit

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m)."""
        columns = self._columns(states)
        torque = columns.torque(self.base)
        rows: list[Array] = []
        for k, joint in enumerate(self.joints):
            slopes = weights[:, k] * np.sign(torque[:, joint]) / self.limit[k]
            rows.append(states.objective.pullback(columns.torque_gradient(self.base, joint, slopes)))
        return np.array(rows)

    def between(self, states: States, step: float) -> Array:
        """Estimate of the largest rise of |torque| / limit between neighbouring points of a grid, shape (m,).

        The torque of the rigid links rises by at most step²/8 times the bound of its second derivative. The torque of
        the other terms may jump when a joint reverses. Therefore the torque of the links at each point is also
        combined with the torque of the other terms at the two neighbouring points. The result is a margin, but not a
        proven bound.
        """
        goal, basis = states.objective.goal, states.basis
        model, base = (
            (goal.model, goal.base) if self.described is None else (self.described.model, self.described.base)
        )
        bodies = np.isin(base.kept, model.inertial_columns)
        standard = np.zeros(len(model.parameters))
        standard[base.kept[bodies]] = self.base[bodies]
        positions = np.abs(states.coefficients[:, -1]) + basis.peaks_between(states.x, 0)
        bounds = [positions, *(basis.peaks_between(states.x, order) for order in range(1, ORDERS + 1))]
        inertial = standard[model.inertial_columns].reshape(-1, 10)
        rise = np.zeros(basis.n)
        if len(inertial):
            rise = step**2 / 8.0 * torque_curvature(states.tree, inertial, np.array(bounds))
        terms = np.where(bodies, 0.0, self.base)
        if terms.any():
            columns = self._columns(states)
            torque, others = columns.torque(self.base), columns.torque(terms)
            steps = np.diff(others, axis=0)
            beside = np.vstack([torque[:-1] + steps, torque[1:] - steps])
            rise += np.maximum(0.0, np.abs(beside).max(axis=0, initial=0.0) - np.abs(torque).max(axis=0))
        return rise[list(self.joints)] / self.limit

    def _columns(self, states: States) -> Columns:
        return states.columns(None if self.described is None else self.described.source)

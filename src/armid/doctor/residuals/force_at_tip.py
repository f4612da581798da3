"""Explanation of a misfit by a force at the tip that may change at any time: a hand, a hose, foam, a loose tool.

A force at the tip acts on all joints together, each with its lever. What else a model lacks differs from joint to
joint: with another sign of the residual of some joints, a force at the tip explains as much of it. The decrease of
the residual is therefore compared with that for such signs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armid.checked_array import Array
from armid.doctor.changes.alternatives import weights_by_axis
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import HELPS, try_remedy
from armid.doctor.residuals.added_columns import AddedColumns

STEP = 0.5
"""Time between two values of the force, which is linear in between [s]."""

JOINTS = 4
"""Smallest number of joints: a force has three components, which explain the residuals of three joints."""

SIGNS = 12
"""Number of sets of random signs of the residuals with which the decrease is compared."""

POINTS, FARTHEST = 3, 0.5
"""Number of points beside the tip at which the force is tried, and their largest distance from the origin of the last
link [m]."""

WEAK = 1e-3
"""Share of the power of a column that is added to it, so that a force that hardly acts stays small."""

SLOW, MOVING = 0.06, 0.5
"""Velocity below which a joint may stick [rad/s or m/s], and smallest share of the rows in which not all joints do.
An arm at rest sticks with any torque, which a force explains."""

GAIN_AT_TIP, GAIN = 0.1, 0.3
"""Decrease at the tip from which other points are tried, and smallest one at the best point: decrease of the mean
logarithm of the RMS residuals beyond that for other signs. On recordings of eight
arms, whole and in halves, it is at most 0.24. A hand that holds the flange with 10 % of the arm's weight gives 0.5
to 1.9, foam that is pressed with 20 % of it 0.1 to 1.0."""


class Nodes:
    """Linear interpolation between B values that are `STEP` apart in time; times without rows have no values."""

    def __init__(self, time: Array) -> None:
        place = (time - time[0]) / STEP
        step = np.floor(place)
        used = np.unique(np.concatenate([step, step + 1.0]))
        self.first = np.searchsorted(used, step)
        """Number of the value before each row, shape (M,)."""
        self.share = place - step
        """Share of the value after each row, shape (M,)."""
        self.count = len(used)
        """Number B of values."""

    def sums(self, columns: Array) -> Array:
        """Scalar products of columns (k, M) with the functions of the values, shape (k, B)."""
        result = np.zeros((len(columns), self.count))
        starts = np.flatnonzero(np.diff(self.first, prepend=-1))
        own = self.first[starts]
        later = np.add.reduceat(columns * self.share, starts, axis=1)
        result[:, own] += np.add.reduceat(columns, starts, axis=1) - later
        result[:, own + 1] += later
        return result

    def products(self, weights: Array) -> Array:
        """Scalar products of the functions with each other, for weights (3, 3, M) of two axes, shape (3 B, 3 B)."""
        result = np.zeros((3, self.count, 3, self.count))
        starts = np.flatnonzero(np.diff(self.first, prepend=-1))
        own = self.first[starts]
        s = self.share
        for k, shape in enumerate(((1.0 - s) ** 2, s * (1.0 - s), s**2)):
            part = np.moveaxis(np.add.reduceat(weights * shape, starts, axis=2), 2, 0)
            for a, b in {0: ((0, 0),), 1: ((0, 1), (1, 0)), 2: ((1, 1),)}[k]:
                result[:, own + a, :, own + b] += part
        return result.reshape(3 * self.count, 3 * self.count)

    def interpolated(self, values: Array) -> Array:
        """Values (k, B) at the rows, shape (k, M)."""
        return values[:, self.first] * (1.0 - self.share) + values[:, self.first + 1] * self.share


@dataclass(frozen=True, eq=False)
class _Equations:
    """Normal equations of a force with B values along each axis, behind the model, in units of the residuals.

    Attributes:
        unit: Torque of each joint for a force of 1 N along each axis of the base, shape (3, M, n).
        nodes: Interpolation of the force in time.
        matrix: Matrix, shape (3 B, 3 B).
        sides: Right side from the residual of each joint, shape (n, 3 B).
        rows: Number of residuals.
    """

    unit: Array
    nodes: Nodes
    matrix: Array
    sides: Array
    rows: int

    @classmethod
    def of(cls, state: LogState, added_columns: AddedColumns, unit: Array) -> _Equations:
        """Equations of a force with the given torques (3, M, n) of unit forces."""
        rows, fit, inverse, nodes = state.rows, state.fit, added_columns.inverse, Nodes(state.rows.motion.time)
        e = 3 * nodes.count
        beside, along, sides = np.zeros((rows.count, e)), np.zeros((rows.n, rows.count)), np.zeros((rows.n, e))
        weight = rows.mask / fit.sigma
        for j, own in enumerate(rows.parameters):
            added, model = unit[:, :, j] * weight[:, j], rows.columns[j] * weight[:, j]
            residual = fit.residual[:, j] / fit.sigma[j]
            beside[own] += np.hstack([nodes.sums(model * each) for each in added])
            sides[j], along[j, own] = nodes.sums(added * residual).ravel(), model @ residual
        whole = nodes.products(np.einsum("amj,bmj,mj->abm", unit, unit, weight**2))
        scale = max(float(whole.diagonal().mean()), np.finfo(float).tiny)
        left = whole - beside.T @ inverse @ beside + np.diag(WEAK * whole.diagonal() + 10.0 * WEAK * scale)
        return cls(unit, nodes, left, sides - along @ inverse @ beside, max(int(rows.mask.sum()), 1))

    @cached_property
    def decrease_by_all(self) -> float:
        """Share of the squared residuals that a force explains."""
        return float(self.decrease(np.ones((1, len(self.sides))))[0])

    @cached_property
    def gain(self) -> float:
        """Decrease of the logarithm of the RMS residual by a force, beyond that with other signs of some joints."""
        other = float(self.decrease(_other_signs(len(self.sides))).mean())
        tiny = np.finfo(float).eps
        return 0.5 * float(np.log(max(1.0 - other, tiny) / max(1.0 - self.decrease_by_all, tiny)))

    @property
    def force(self) -> Array:
        """Force at each row, shape (M, 3) [N]."""
        values = np.linalg.solve(self.matrix, self.sides.sum(axis=0)).reshape(3, -1)
        return self.nodes.interpolated(values).T

    def decrease(self, signs: Array) -> Array:
        """Shares of the squared residuals that a force explains, for sets of signs of the joints, (s, n) to (s,)."""
        sides = signs @ self.sides
        return np.sum(sides * np.linalg.solve(self.matrix, sides.T).T, axis=1) / self.rows


def explain(code: str, state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a force at the tip; `None` if there is none.

    Args:
        code: Code of the finding.
        state: The log.
    """
    rows = state.rows
    if rows.n < JOINTS or state.log.band.is_open or len(rows.motion.time) < 2:
        return None
    moving = state.without(np.abs(rows.motion.dq).max(axis=1) < SLOW)
    if float(moving.rows.mask.mean()) < MOVING:
        return None
    found = _at_best_point(moving)
    gain = -np.inf if found is None else found.gain
    if found is None or gain < GAIN:
        return None
    force = found.force
    after = moving.without_torque(np.einsum("ma,amj->mj", force, found.unit))
    size = np.linalg.norm(force, axis=1)
    return Explanation(
        code,
        gain,
        "warning",
        "",
        f"A force on the last link explains what the model lacks: {np.sqrt(np.mean(size**2)):.3g} N (RMS), at most "
        f"{size.max():.3g} N at t = {rows.motion.time[int(np.argmax(size))]:.1f} s. The residual with it is "
        f"{1 - np.exp(-gain):.0%} smaller than if the residuals of some joints had the opposite sign, which measures "
        "what chance would explain. The arm touched something, or something pulled at it: a hand, a hose, a cable, "
        "or a load that moves.",
        lambda evidence: "remove what touches the arm or pulls at it, fix the tool, and record again",
        after,
        worse=HELPS,
        trial=replace(try_remedy(moving.rows, after.rows), independent=False),
    )


def _other_signs(n: int) -> Array:
    """Random signs of n joints, not all of them equal, shape (`SIGNS`, n)."""
    signs = np.random.default_rng(n).choice((-1.0, 1.0), (4 * SIGNS, n))
    return signs[np.abs(signs.sum(axis=1)) < n][:SIGNS]


def _at_best_point(state: LogState) -> _Equations | None:
    """Equations of the force at the best point of the last link; `None` if a force at the tip explains little."""
    tip, added = state.model.robot.tip, AddedColumns(state)
    lever = tip.placement[:3, 3]
    bodies = np.zeros((5, state.rows.n, 10))
    bodies[range(4), tip.parent, range(4)] = 1.0
    bodies[4, tip.parent, :4] = 1.0, *lever
    best = _Equations.of(state, added, weights_by_axis(state, bodies[4]))
    if best.gain < GAIN_AT_TIP:
        return None
    parts = [weights_by_axis(state, each) for each in bodies[:4]]
    for _ in range(POINTS):
        columns = np.stack([np.einsum("ma,amj->mj", best.force, each) for each in parts])
        size, *moments = added.decrease_of_all(columns)[1]
        if size <= 0.0 or np.linalg.norm(moments) > FARTHEST * size:
            break
        found = _Equations.of(state, added, parts[0] + np.tensordot(np.array(moments) / size, parts[1:], 1))
        if found.decrease_by_all < best.decrease_by_all:
            break
        best = found
    return best

"""Gravity in another direction than the study says: an arm that hangs, stands on a wall or is tilted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.information.setup import column_source
from armid.model.base import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.rows import Rows, cost_of, make_rows, products, solve
from armid.validation.doctor.state import Explanation, State
from armid.validation.gravity_sign import gravity_sign_finding
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "gravity-direction"

ASKEW = (1.0, 2.0, -9.0)
"""A gravity along no axis: the base parameters that it shows are all that any gravity shows [m/s²]."""

CONFLICT = 0.15
"""Conflict between joints from which other directions than the opposite one are looked for."""

GAIN = 0.15
"""Fall of the residual, as a logarithm, that another direction must bring; recorded arms and clean logs lose by
every one of them."""

OPPOSITE = 0.01
"""The same for the opposite direction, which first moments of the other sign nearly make good: clean logs lose
0.03 and more by it."""

ANGLE = np.radians(8.0)
"""Tilt below which nothing is said: links that are not modelled, such as cables, look like some degrees."""

STEPS = 8
"""Gauss-Newton steps from the best axis; four are usual."""


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if another gravity explains the log, or the parameters that follow from it are suspicious."""
    found, state = evidence.explained(CODE), evidence.understood
    geometry = any(each.code != "contact" for each in evidence.explanations)
    if found or geometry or state is None or state.nominal is not None:
        return found
    suspicion = gravity_sign_finding(state.base, state.fit.values[: state.base.count])
    return [] if suspicion is None or suspicion.code != CODE else [suspicion]


def explain(state: State) -> Explanation | None:
    """The gravity that explains the log, or `None` if it is the one that it has."""
    g0 = np.asarray(state.model.robot.gravity)
    strength = float(np.linalg.norm(g0))
    if strength == 0.0:
        return None
    begin = cost_of(state.rows, products(state.rows))
    g, cost = _searched(state, g0, strength, begin) if state.conflict > CONFLICT else (-g0, _under(state, -g0))
    gain = begin - cost
    cosine = float(np.clip(g @ g0 / strength**2, -1.0, 1.0))
    angle = float(np.arccos(cosine))
    if angle < ANGLE or gain < (OPPOSITE if cosine < -0.99 else GAIN):
        return None
    numbers = ", ".join(f"{x + 0.0:.4g}" for x in np.round(g, 2))
    model = _turned(state, g)
    return Explanation(
        CODE,
        gain,
        "error",
        "",
        f"Gravity along ({numbers}) m/s², {np.degrees(angle):.0f}° from the study's, leaves "
        f"{1 - np.exp(-gain):.0%} less of the torque.",
        f"gravity = [{numbers}]",
        State(model, find_base_parameters(model), state.log),
    )


def _turned(state: State, g: Array) -> DynamicsModel:
    """The model under another gravity."""
    return DynamicsModel(state.model.robot.with_gravity((float(g[0]), float(g[1]), float(g[2]))), state.model.terms)


def _under(state: State, g: Array) -> float:
    """What is left under gravity of the same line, which shows the same base parameters."""
    rows = make_rows(column_source(_turned(state, g), state.base), state.log)
    return cost_of(rows, products(rows))


def _searched(state: State, g0: Array, strength: float, begin: float) -> tuple[Array, float]:
    """The gravity that leaves least, and what it leaves; the one that the log has leaves `begin`."""
    wide = _Wide(state)
    axes = np.vstack([np.eye(3), -np.eye(3)]) * strength
    costs = [wide.cost(g) for g in axes]
    better = [k for k in np.argsort(costs)[:2] if costs[k] < begin]
    starts = [g0, *(axes[k] for k in better)]
    g, cost = min((wide.refined(g, strength) for g in starts), key=lambda each: each[1])
    return _rounded(wide, g, cost, axes)


def _rounded(wide: _Wide, g: Array, cost: float, axes: Array) -> tuple[Array, float]:
    """The axis itself where it explains as much."""
    nearest = axes[int(np.argmax(axes @ g))]
    straight = wide.cost(nearest)
    return (nearest, straight) if straight < cost + 0.02 else (g, cost)


class _Wide:
    """Rows for any gravity: columns are linear in it."""

    def __init__(self, state: State) -> None:
        robot, terms = state.model.robot, state.model.terms
        base = find_base_parameters(DynamicsModel(robot.with_gravity(ASKEW), terms))

        def rows(gravity: tuple[float, float, float]) -> Rows:
            return make_rows(column_source(DynamicsModel(robot.with_gravity(gravity), terms), base), state.log)

        self.still = rows((0.0, 0.0, 0.0))
        units = [rows(g) for g in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        self.units = [tuple(unit.columns[j] - self.still.columns[j] for unit in units) for j in range(self.still.n)]

    def rows(self, g: Array) -> Rows:
        """Rows under a gravity (3,)."""
        columns = tuple(
            own + sum(x * unit for x, unit in zip(g, units, strict=True))
            for own, units in zip(self.still.columns, self.units, strict=True)
        )
        return replace(self.still, columns=columns)

    def cost(self, g: Array) -> float:
        """What is left under a gravity."""
        rows = self.rows(g)
        return cost_of(rows, products(rows))

    def refined(self, g: Array, strength: float) -> tuple[Array, float]:
        """Gauss-Newton over the direction, the strength being known."""
        cost = self.cost(g)
        for _ in range(STEPS):
            rows = self.rows(g)
            values = solve(rows).values
            side = np.linalg.svd(g[None])[2][1:]  # two directions at right angles
            per_axis = np.stack([self._slope(rows, values, k) for k in range(3)])
            tangent = np.einsum("ak,kmj->amj", side, per_axis)
            step = solve(rows, extra=tangent).values[rows.count :] @ side
            step *= min(1.0, 0.5 * strength / max(float(np.linalg.norm(step)), 1e-12))
            moved = g + step
            moved *= strength / np.linalg.norm(moved)
            found = self.cost(moved)
            if found > cost - 1e-3:
                break
            g, cost = moved, found
        return g, cost

    def _slope(self, rows: Rows, values: Array, axis: int) -> Array:
        """Torque (M, n) that a unit of gravity along an axis adds."""
        joints = zip(rows.parameters, self.units, strict=True)
        return np.column_stack([values[own] @ units[axis] for own, units in joints])

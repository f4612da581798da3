"""Gravity in another direction than the study says: an arm that hangs, stands on a wall or is tilted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products, solve
from armid.errors import Finding
from armid.information.column_source import column_source
from armid.measurement.remedy import lines
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.validation.gravity_sign import gravity_sign_finding
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "gravity-direction"

ASKEW = (1.0, 2.0, -9.0)
"""A gravity along no axis: the base parameters that it shows are all that any gravity shows [m/s²]."""

CONFLICT = 0.15
"""Conflict between joints from which other directions than the opposite one are looked for."""

UNEXPLAINED = 0.5
"""Share of a joint's torque that is left by parameters of its own from which they are looked for, too: where axes are
parallel, no joint contradicts another."""

FEW = 3
"""Joints up to which they are looked for anyway: it costs little then."""

BRAKES = 2.0
"""Standard deviations from which friction brakes as it should, so that the sign of the torque is right."""

UNLIKE, ALIKENESS = 0.6, 0.9
"""Correlation with the description below which, and above which under another gravity, the description decides."""

GAIN = 0.15
"""Fall of the residual, as a logarithm, that another direction must bring; recorded arms and clean logs lose by
every one of them."""

OPPOSITE = 0.01
"""The same for the opposite direction, which first moments of the other sign nearly make good: clean logs lose
0.03 and more by it."""

ANGLE = np.radians(8.0)
"""Tilt below which nothing is said: links that are not modelled, such as cables, look like some degrees."""

ALIKE = 0.02
"""Difference of what two directions leave, as a logarithm, below which the log does not say which of them it has."""

STEPS = 8
"""Gauss-Newton steps from the best axis; four are usual."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if another gravity explains the log, or the parameters that follow from it are suspicious."""
    found, state = evidence.explained(CODE), evidence.understood
    geometry = any(each.code != "contact" for each in evidence.explanations)
    if found or geometry or state is None or state.nominal is not None:
        return found
    suspicion = gravity_sign_finding(state.base, state.fit.values[: state.base.count])
    return [] if suspicion is None or suspicion.code != CODE else [suspicion]


def explain(state: LogState) -> Explanation | None:
    """The gravity that explains the log, or `None` if it is the one that it has."""
    g0 = np.asarray(state.model.robot.gravity)
    strength = float(np.linalg.norm(g0))
    if strength == 0.0:
        return None
    begin = cost_of(state.rows, products(state.rows))
    searched = state.rows.n <= FEW or state.conflict > CONFLICT or _unexplained(state) > UNEXPLAINED
    g, cost, rivals = _searched(state, g0, strength, begin) if searched else (-g0, _under(state, -g0), ())
    gain = begin - cost
    cosine = float(np.clip(g @ g0 / strength**2, -1.0, 1.0))
    angle = float(np.arccos(cosine))
    if angle < ANGLE or gain < (OPPOSITE if cosine < -0.99 else GAIN):
        return _described(state, strength)
    numbers = ", ".join(f"{x + 0.0:.4g}" for x in np.round(g, 2))
    model = _turned(state, g)
    return Explanation(
        CODE,
        gain,
        "error",
        "",
        f"Gravity along ({numbers}) m/s², {np.degrees(angle):.0f}° from the study's, leaves "
        f"{1 - np.exp(-gain):.0%} less of the torque" + ("." if not rivals else "; other directions as much."),
        lambda _: _remedy((g, *rivals)),
        LogState(model, find_base_parameters(model), state.log),
    )


def _described(state: LogState, strength: float) -> Explanation | None:
    """The axis under which the torque is the description's, where it is not as the study says.

    One joint alone fits its moments to any gravity across its axis; only the description tells them apart.
    """
    if state.nominal is None or state.rows.n > FEW:
        return None
    loaded = int(np.argmax(state.nominal.size))
    now = float(state.nominal.correlation[loaded])
    if now > UNLIKE or (now < -UNLIKE and state.dissipation[loaded] < BRAKES):  # then its sign may be the torque's
        return None
    found: list[tuple[float, tuple[float, ...], LogState]] = []
    for g in np.vstack([np.eye(3), -np.eye(3)]) * strength:
        after = LogState(_turned(state, g), state.base, state.log)
        after.__dict__["rows"] = state.rows  # torque and friction, which no gravity changes
        if after.nominal is not None:
            found.append((float(after.nominal.correlation[int(np.argmax(after.nominal.size))]), tuple(g), after))
    best, g, after = max(found, key=lambda each: each[0])
    if best < ALIKENESS:
        return None
    rivals = [np.array(other) for correlation, other, _ in found if other != g and correlation > ALIKENESS]
    model = after.model
    return Explanation(
        CODE,
        OPPOSITE,
        "error",
        "",
        f"The torque has correlation {now:.2f} with the description's, under gravity along "
        f"({', '.join(f'{x + 0.0:.4g}' for x in g)}) m/s² it has {best:.2f}; zeros turned as far would do the same.",
        lambda _: _remedy((np.array(g), *rivals)),
        LogState(model, find_base_parameters(model), state.log),
    )


def _remedy(directions: Sequence[Array]) -> str:
    """The direction, or those between which the log does not decide."""
    told = [lines(gravity=[float(f"{x + 0.0:.4g}") for x in np.round(g, 2)]) for g in directions]
    return f"{told[0]}  # in [robot]" if len(told) == 1 else f"find out how the arm stands: {' or '.join(told)}"


def _unexplained(state: LogState) -> float:
    """Largest share of a joint's torque that parameters of its own leave."""
    size = [np.sqrt(np.mean(state.rows.torque[state.rows.mask[:, j], j] ** 2)) for j in range(state.rows.n)]
    left = [fit.sigma[0] for fit in state.own_fits]
    return max((a / b for a, b in zip(left, size, strict=True) if b > 0.0), default=0.0)


def _turned(state: LogState, g: Array) -> DynamicsModel:
    """The model under another gravity."""
    return DynamicsModel(state.model.robot.with_gravity((float(g[0]), float(g[1]), float(g[2]))), state.model.terms)


def _under(state: LogState, g: Array) -> float:
    """Return what is left under gravity of the same line, which shows the same base parameters."""
    rows = make_rows(column_source(_turned(state, g), state.base), state.log)
    return cost_of(rows, products(rows))


def _searched(state: LogState, g0: Array, strength: float, begin: float) -> tuple[Array, float, tuple[Array, ...]]:
    """The gravity that leaves least, what it leaves, and axes that leave as little; the log's own leaves `begin`."""
    wide = _Wide(state)
    axes = np.vstack([np.eye(3), -np.eye(3)]) * strength
    costs = [wide.cost(g) for g in axes]
    better = [k for k in np.argsort(costs)[:2] if costs[k] < begin]
    starts = [g0, *(axes[k] for k in better)]
    g, cost = min((wide.refined(g, strength) for g in starts), key=lambda each: each[1])
    g, cost = _rounded(wide, g, cost, axes)
    apart = [axis @ g < np.cos(ANGLE) * strength**2 for axis in axes]
    rivals = (axis for axis, own, far in zip(axes, costs, apart, strict=True) if far and own < cost + ALIKE)
    return g, cost, tuple(rivals)


def _rounded(wide: _Wide, g: Array, cost: float, axes: Array) -> tuple[Array, float]:
    """The axis itself where it explains as much."""
    nearest = axes[int(np.argmax(axes @ g))]
    straight = wide.cost(nearest)
    return (nearest, straight) if straight < cost + ALIKE else (g, cost)


class _Wide:
    """Rows for any gravity: columns are linear in it."""

    def __init__(self, state: LogState) -> None:
        robot, terms = state.model.robot, state.model.terms
        base = find_base_parameters(DynamicsModel(robot.with_gravity(ASKEW), terms))

        def rows(gravity: tuple[float, float, float]) -> QuickRows:
            return make_rows(column_source(DynamicsModel(robot.with_gravity(gravity), terms), base), state.log)

        self.still = rows((0.0, 0.0, 0.0))
        units = [rows(g) for g in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        self.units = [tuple(unit.columns[j] - self.still.columns[j] for unit in units) for j in range(self.still.n)]

    def rows(self, g: Array) -> QuickRows:
        """Rows under a gravity (3,)."""
        columns = tuple(
            own + sum(x * unit for x, unit in zip(g, units, strict=True))
            for own, units in zip(self.still.columns, self.units, strict=True)
        )
        return replace(self.still, columns=columns)

    def cost(self, g: Array) -> float:
        """Return what is left under a gravity."""
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

    def _slope(self, rows: QuickRows, values: Array, axis: int) -> Array:
        """Torque (M, n) that a unit of gravity along an axis adds."""
        joints = zip(rows.parameters, self.units, strict=True)
        return np.column_stack([values[own] @ units[axis] for own, units in joints])

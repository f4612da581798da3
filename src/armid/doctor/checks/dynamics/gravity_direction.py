"""Check for gravity in another direction than in the study, as for a hanging, wall-mounted or tilted arm.

On a base that sways, the direction swings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products, solve_coarsely
from armid.doctor.remedy_trial import try_remedy
from armid.doctor.residuals import swaying_base
from armid.doctor.rows_away_from_reversals import is_significant, judged_away_from_reversals
from armid.errors import Finding
from armid.information.base_regressor_layout import column_source
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot
from armid.validation.gravity_sign import gravity_sign_finding

CODE = "gravity-direction"

ASKEW = (1.0, 2.0, -9.0)
"""Vector of gravity along no axis [m/s²]. The base parameters for this gravity include the base parameters for every
other gravity."""

CONFLICT = 0.15
"""Conflict between the joints from which all directions are searched, and not only the opposite one."""

UNEXPLAINED = 0.5
"""Relative residual of the separate fit of a joint from which all directions are searched, too. If the axes are
parallel, the joints cannot contradict each other."""

FEW = 3
"""Number of joints up to which all directions are always searched, because this takes little time."""

BRAKES = 2.0
"""Number of standard deviations from which friction counts as positive; the sign of the torque is then right."""

UNLIKE, ALIKENESS = 0.6, 0.9
"""Correlation of the torque with the torque of the description below which another gravity is considered, and above
which another gravity is accepted."""

GAIN = 0.15
"""Smallest decrease of the mean logarithm of the RMS residuals for another direction; in logs without fault, every
one increases it."""

OPPOSITE = 0.01
"""Smallest decrease, as `GAIN`, for the opposite direction. First moments of the opposite sign nearly compensate this
fault, so the limit is lower where all joints have enough rows away from reversals. In logs without fault, the
residual increases by 0.03 or more; on light arms that stick, it decreases by 0.005 at most."""

ANGLE, SLIGHT = np.radians(4.0), np.radians(2.2)
"""Tilts from which an error and a warning are reported [rad]. On 18 recordings of seven arms without a tilt,
unmodelled parts such as cables have the effect of up to 1.9°."""

GAIN_OF_SLIGHT = 0.1
"""The limit that is used instead of `GAIN` for a slight tilt. On recordings of eight arms, whole, in halves and in
thirds, tilts of more than 2.2° give at most 0.083; a tilt of 3° gives 0.05 to 0.5."""

ALIKE = 0.02
"""Difference of the mean logarithms of the RMS residuals for two directions, below which the directions cannot be
distinguished."""

STEPS = 8
"""Largest number of Gauss-Newton steps from the best axis; usually four are enough."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports another direction of gravity if the model fits better with this direction.

    If the description has no inertias, an opposite gravity is also reported if the fitted parameters have the wrong
    sign.
    """
    found, state = evidence.explained(CODE), evidence.corrected
    geometry = any(each.code != "contact" for each in evidence.explanations)
    if found or geometry or state is None or state.nominal is not None:
        return found
    suspicion = gravity_sign_finding(state.base, state.fit.values[: state.base.count])
    return [] if suspicion is None or suspicion.code != CODE else [suspicion]


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by another direction of gravity, or by one that swings with the base.

    The result is `None` if the gravity of the study is right.
    """
    found = [each for each in (_by_direction(state), swaying_base.explain(CODE, state)) if each is not None]
    return max(found, key=lambda each: each.gain, default=None)


def _by_direction(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by another constant direction of gravity.

    The result is `None` if the gravity of the study is right.
    """
    g0 = np.asarray(state.model.robot.gravity)
    strength = float(np.linalg.norm(g0))
    if strength == 0.0:
        return None
    judged, moving = judged_away_from_reversals(state)
    begin = cost_of(judged.rows, products(judged.rows))
    searched = state.rows.n <= FEW or state.conflict > CONFLICT or _unexplained(state) > UNEXPLAINED
    g, cost, rivals = _searched(judged, g0, strength, begin) if searched else (-g0, _opposite_cost(judged, -g0), ())
    gain = begin - cost
    cosine = float(np.clip(g @ g0 / strength**2, -1.0, 1.0))
    angle = float(np.arccos(cosine))
    least = OPPOSITE if cosine < -0.99 and moving.all() else GAIN_OF_SLIGHT if angle < ANGLE else GAIN
    if angle < SLIGHT or gain < least or not is_significant(judged, gain):
        return _by_description(state, judged, strength)
    numbers = ", ".join(f"{x + 0.0:.4g}" for x in np.round(g, 2))
    model = _turned(state, g)
    after = LogState(model, find_base_parameters(model), state.log, state.known)
    return Explanation(
        CODE,
        max(state.fit.cost - after.fit.cost, OPPOSITE),
        "warning" if angle < ANGLE else "error",
        "",
        f"If gravity is ({numbers}) m/s², {np.degrees(angle):.2g}° from the gravity of the study, the residual is "
        f"{1 - np.exp(-gain):.0%} smaller"
        + ("." if not rivals else "; with other directions, the model fits as well."),
        lambda _: _remedy((g, *rivals)),
        after,
        trial=try_remedy(judged.rows, after.on(judged.log).rows),
    )


def _by_description(state: LogState, judged: LogState, strength: float) -> Explanation | None:
    """Explains the misfit by gravity along another axis, with which measured and described torque agree.

    The result is `None` if there is no such axis.

    For a single joint, first moments can be fitted for any gravity perpendicular to the axis of the joint. The
    description is therefore needed for the decision.

    Args:
        state: The log.
        judged: The log with the rows on which directions are compared.
        strength: Norm of gravity [m/s²].
    """
    if judged.nominal is None or judged.rows.n > FEW or judged.known is not None:  # a load agrees with any gravity
        return None
    loaded = int(np.argmax(judged.nominal.size))
    now = float(judged.nominal.correlation[loaded])
    if now > UNLIKE or (now < -UNLIKE and judged.dissipation[loaded] < BRAKES):  # then its sign may be the torque's
        return None
    candidates: list[tuple[float, tuple[float, ...], LogState]] = []
    for g in np.vstack([np.eye(3), -np.eye(3)]) * strength:
        after = LogState(_turned(judged, g), judged.base, judged.log)
        after.__dict__["rows"] = judged.rows  # torque and friction, which no gravity changes
        if after.nominal is not None:
            candidates.append((float(after.nominal.correlation[int(np.argmax(after.nominal.size))]), tuple(g), after))
    best, g, after = max(candidates, key=lambda each: each[0])
    if best < ALIKENESS:
        return None
    rivals = [np.array(other) for correlation, other, _ in candidates if other != g and correlation > ALIKENESS]
    model = after.model
    return Explanation(
        CODE,
        OPPOSITE,
        "error",
        "",
        f"The correlation of the torque with the torque of the description is {now:.2f}, but {best:.2f} if gravity "
        f"is ({', '.join(f'{x + 0.0:.4g}' for x in g)}) m/s²; joint zeros that are rotated by the same angle would "
        "have the same effect.",
        lambda _: _remedy((np.array(g), *rivals)),
        LogState(model, find_base_parameters(model), state.log),
    )


def _remedy(directions: Sequence[Array]) -> Remedy:
    """Remedy: the line `gravity` of a study, or one such line for each direction that the log cannot distinguish."""
    options = [setting("gravity", [float(f"{x + 0.0:.4g}") for x in np.round(g, 2)]) for g in directions]
    if len(options) == 1:
        return Remedy(options[0], table="robot")
    alternatives = [part for each in options for part in (" or ", each)]
    return Remedy("find out how the arm is mounted: ", *alternatives[1:])


def _unexplained(state: LogState) -> float:
    """Largest ratio of RMS residual to RMS torque of a joint, if each joint is fitted with separate parameters."""
    rows = state.rows
    size = np.sqrt(np.sum((rows.torque * rows.mask) ** 2, axis=0) / np.maximum(rows.mask.sum(axis=0), 1))
    residual = [fit.sigma[0] for fit in state.joint_fits]
    return max((a / b for a, b in zip(residual, size, strict=True) if b > 0.0), default=0.0)


def _turned(state: LogState, g: Array) -> DynamicsModel:
    """Model of the state with another vector of gravity (3,) [m/s²]."""
    return DynamicsModel(state.model.robot.with_gravity((float(g[0]), float(g[1]), float(g[2]))), state.model.terms)


def _opposite_cost(state: LogState, g: Array) -> float:
    """Mean logarithm of the RMS residuals with a gravity that is parallel to the gravity of the study.

    Parallel directions have the same base parameters, so those of the state are used.
    """
    rows = make_rows(column_source(_turned(state, g), state.base), state.log)
    return cost_of(rows, products(rows))


def _searched(state: LogState, g0: Array, strength: float, begin: float) -> tuple[Array, float, tuple[Array, ...]]:
    """Vector of gravity with the smallest cost (`QuickFit.cost`), this cost, and axes with about equal costs.

    Args:
        state: The log.
        g0: Gravity of the study, shape (3,) [m/s²].
        strength: Norm of `g0` [m/s²].
        begin: Cost of `g0`.
    """
    wide = _GravityRows(state)
    axes = np.vstack([np.eye(3), -np.eye(3)]) * strength
    costs = [wide.cost(g) for g in axes]
    better = [k for k in np.argsort(costs)[:2] if costs[k] < begin]
    starts = [g0, *(axes[k] for k in better)]
    g, cost = min((wide.refined(g, strength) for g in starts), key=lambda each: each[1])
    g, cost = _rounded(wide, g, cost, axes)
    apart = [axis @ g < np.cos(ANGLE) * strength**2 for axis in axes]
    rivals = (axis for axis, each, far in zip(axes, costs, apart, strict=True) if far and each < cost + ALIKE)
    return g, cost, tuple(rivals)


def _rounded(wide: _GravityRows, g: Array, cost: float, axes: Array) -> tuple[Array, float]:
    """Vector of gravity and its cost.

    The vector is moved to the nearest axis if the model then fits about as well.
    """
    nearest = axes[int(np.argmax(axes @ g))]
    straight = wide.cost(nearest)
    return (nearest, straight) if straight < cost + ALIKE else (g, cost)


@lru_cache(maxsize=4)
def _askew(robot: Robot) -> Robot:
    """The arm with the gravity `ASKEW`; the result is cached, so that all logs of an arm use the same object."""
    return robot.with_gravity(ASKEW)


class _GravityRows:
    """Regressor columns of a log for any vector of gravity.

    Columns are a constant plus a linear function of the vector, so they are computed for four vectors only.
    """

    def __init__(self, state: LogState) -> None:
        robot, terms = state.model.robot, state.model.terms
        base = find_base_parameters(DynamicsModel(_askew(robot), terms))

        def rows(gravity: tuple[float, float, float]) -> QuickRows:
            return make_rows(column_source(DynamicsModel(robot.with_gravity(gravity), terms), base), state.log)

        self.still = rows((0.0, 0.0, 0.0))
        units = [rows(g) for g in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        self.units = [tuple(unit.columns[j] - self.still.columns[j] for unit in units) for j in range(self.still.n)]

    def rows(self, g: Array) -> QuickRows:
        """Rows of the log with the columns for a vector of gravity (3,) [m/s²]."""
        columns = tuple(
            own + sum(x * unit for x, unit in zip(g, units, strict=True))
            for own, units in zip(self.still.columns, self.units, strict=True)
        )
        return replace(self.still, columns=columns)

    def cost(self, g: Array) -> float:
        """Mean over the joints of the logarithm of the RMS residual with a vector of gravity (3,) [m/s²]."""
        rows = self.rows(g)
        return cost_of(rows, products(rows))

    def refined(self, g: Array, strength: float) -> tuple[Array, float]:
        """Refines the direction of gravity with Gauss-Newton steps, and returns the vector (3,) and its cost.

        Args:
            g: Vector of gravity from which the steps begin, shape (3,) [m/s²].
            strength: Norm of gravity, which does not change [m/s²].
        """
        cost = self.cost(g)
        for _ in range(STEPS):
            rows = self.rows(g)
            values = solve_coarsely(rows)[0]
            side = np.linalg.svd(g[None])[2][1:]  # two directions at right angles
            per_axis = np.stack([self._slope(rows, values, k) for k in range(3)])
            tangent = np.einsum("ak,kmj->amj", side, per_axis)
            step = solve_coarsely(rows, tangent)[0][rows.count :] @ side
            step *= min(1.0, 0.5 * strength / max(float(np.linalg.norm(step)), 1e-12))
            moved = g + step
            moved *= strength / np.linalg.norm(moved)
            moved_cost = self.cost(moved)
            if moved_cost > cost - 1e-3:
                break
            g, cost = moved, moved_cost
        return g, cost

    def _slope(self, rows: QuickRows, values: Array, axis: int) -> Array:
        """Derivative of the modelled torque, shape (M, n), by a component of gravity.

        `axis` is 0, 1 or 2 for x, y or z.
        """
        joints = zip(rows.parameters, self.units, strict=True)
        return np.column_stack([values[own] @ units[axis] for own, units in joints])


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "gravity-direction": "First moments and inertias get wrong signs or directions that compensate for the "
        "fault.",
    },
    explain=explain,
)

"""Explanation of a misfit by a spring over two joints: a cable, hose or dress pack that is taut if both are turned.

Its torque depends on the sum or on the difference of the two angles, from an angle on at which it becomes taut. Each
of the two joints feels it, with a lever of its own. No weight does that on both joints in the same rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import HELPS, RemedyTrial, heldout_error
from armid.doctor.residuals.added_columns import AddedColumns

FELT = 0.08
"""Smallest residual of both joints, relative to the standard deviation of their torques."""

TAUT = (0.05, 0.3, 0.55, 0.8)
"""Shares of the rows that lie beyond the angle from which the spring is taut, on either side."""

EXPLAINED = 1.25
"""Smallest decrease of the squared residuals, in squared residuals of one joint. In recordings of eight arms, whole
and in halves, it is at most 1.12; a dress pack of one standard deviation of the torques gives 1.3 to 2.0."""

FALLS = 0.75
"""Largest ratio of the residual with the spring to that without it, of the joint that is helped less."""

GAIN = 0.14
"""Smallest decrease of the mean logarithm of the RMS residuals. In the same recordings it is at most 0.13 where
`FALLS` holds."""

FITTED = 3
"""Number of springs that are fitted: those that explain most of the residual."""


@dataclass(frozen=True, slots=True, eq=False)
class Spring:
    """Spring over two joints.

    Attributes:
        joints: Indices of the two joints.
        sense: 1 for the sum of the angles, -1 for their difference.
        stretch: Angle beyond that from which the spring is taut, shape (M,) [rad or m].
        decrease: Decrease of the squared residuals, in squared residuals of one joint.
    """

    joints: tuple[int, int]
    sense: int
    stretch: Array
    decrease: float


def explain(code: str, state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a spring over two joints; `None` if there is none.

    Args:
        code: Code of the finding.
        state: The log.
    """
    if state.log.band.is_open:
        return None
    springs = sorted((each for each in _springs(state) if each.decrease > EXPLAINED), key=lambda each: -each.decrease)
    found = [each for spring in springs[:FITTED] if (each := _explanation(code, state, spring)) is not None]
    return max(found, key=lambda each: each.gain, default=None)


def _springs(state: LogState) -> list[Spring]:
    """The spring that explains most of the residual for each pair of joints and each sense."""
    rows, q = state.rows, state.rows.motion.q
    whole = [float(np.std(rows.torque[rows.mask[:, j], j])) if rows.mask[:, j].any() else 0.0 for j in range(rows.n)]
    felt = [j for j in range(rows.n) if state.fit.sigma[j] > FELT * whole[j] > 0.0]
    added = AddedColumns(state)
    result: list[Spring] = []
    for i, j in ((i, j) for k, j in enumerate(felt) for i in felt[:k]):
        for sense in (1, -1):
            turned = q[:, j] + sense * q[:, i]
            ends = np.quantile(turned, [*TAUT, *(1.0 - share for share in TAUT)])
            up, down = turned - ends[: len(TAUT), None], ends[len(TAUT) :, None] - turned
            stretch = np.maximum(np.concatenate([up, down]), 0.0)
            decrease = added.decreases_of_two((i, j), stretch)
            best = int(np.argmax(decrease))
            result.append(Spring((i, j), sense, stretch[best], float(decrease[best])))
    return result


def _explanation(code: str, state: LogState, spring: Spring) -> Explanation | None:
    """Explanation of the misfit by a spring; `None` if it does not help both joints enough."""
    i, j = spring.joints
    columns = np.zeros((2, *state.rows.torque.shape))
    columns[0, :, i] = columns[1, :, j] = spring.stretch
    fit = solve(state.rows, extra=columns)
    gain, ratio = state.fit.cost - fit.cost, fit.sigma[[i, j]] / state.fit.sigma[[i, j]]
    if gain < GAIN or ratio.max() > FALLS:
        return None
    torque = np.tensordot(fit.values[-2:], columns, 1)
    after = state.without_torque(torque)
    robot = state.model.robot
    names, units = [[robot.joint_names[k] for k in (i, j)], [robot.joints[k].effort_unit for k in (i, j)]]
    sizes = [f"{np.abs(torque[:, k]).max():.3g} {unit}" for k, unit in zip((i, j), units, strict=True)]
    falls = [f"{1.0 - each:.0%}" for each in ratio]
    word = "sum" if spring.sense > 0 else "difference"
    return Explanation(
        code,
        gain,
        "warning",
        ", ".join(names),
        f"The torques of {names[0]} and {names[1]} contain a part that depends on the {word} of their positions, as "
        f"that of a cable, hose or spring over both joints: up to {sizes[0]} and {sizes[1]}. With it, the residuals "
        f"of the two joints are {falls[0]} and {falls[1]} smaller.",
        lambda evidence: "find out the cause (dress pack, cable, hose, spring) and loosen it, or subtract its torque",
        after,
        worse=HELPS,
        trial=RemedyTrial(heldout_error(state.rows), heldout_error(after.rows)),
    )

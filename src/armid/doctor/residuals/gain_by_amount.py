"""Explanation of a misfit by a gain of one torque that depends on the amount of the torque.

A sensor that is not linear, or a drive whose magnets saturate, adds a multiple of the square of the torque, with the
sign of the torque. The other joints, which carry the same links, show it.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import HELPS, RemedyTrial, heldout_error
from armid.doctor.residuals.added_columns import AddedColumns

EXPLAINED = 0.85
"""Smallest decrease of the squared residuals by the square of the torque, relative to the squared residual of the
joint. On 16 recordings of eight arms it is at most 0.63; where the gain falls by a half from zero to the largest
torque, it is 1.0 to 1.6 on joints that carry others."""

GAIN = 0.04
"""Smallest decrease of the mean logarithm of the RMS residuals; a smaller misfit is not explained."""

CHANGE = 0.1
"""Smallest change of the gain from zero to the largest torque."""


def explain(code: str, state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a gain that depends on the amount of one torque; `None` if none does.

    Args:
        code: Code of the finding.
        state: The log.
    """
    if state.rows.n < 2 or state.log.band.is_open:
        return None
    added = AddedColumns(state)
    squares = [_square(state, j) for j in range(state.rows.n)]
    explained = [added.decrease_together(j, square[None]) for j, square in enumerate(squares)]
    j = int(np.argmax(explained))
    if explained[j] < EXPLAINED:
        return None
    column = np.zeros((1, *state.rows.torque.shape))
    column[0, :, j] = squares[j]
    fit = solve(state.rows, extra=column)
    gain = state.fit.cost - fit.cost
    change = float(fit.values[-1]) * float(np.abs(_modelled(state, j)).max(initial=0.0))
    if gain < GAIN or abs(change) < CHANGE:
        return None
    after = state.without_torque(fit.values[-1] * column[0])
    name = state.model.robot.joint_names[j]
    word = "falls" if change < 0.0 else "rises"
    return Explanation(
        code,
        gain,
        "warning",
        name,
        f"The gain of the torque of {name} {word} with the amount of the torque, by about {abs(change):.0%} from "
        f"zero to the largest one; without this, the residual of one model for all joints is {1 - np.exp(-gain):.0%} "
        "smaller.",
        lambda evidence: "calibrate the torque of the joint, or the current of its drive, over its whole range",
        after,
        worse=HELPS,
        trial=RemedyTrial(heldout_error(state.rows), heldout_error(after.rows)),
    )


def _modelled(state: LogState, j: int) -> Array:
    """Torque of joint j by the fitted model, shape (M,); zero in rows that are not used."""
    return np.where(state.rows.mask[:, j], state.rows.torque[:, j] - state.fit.residual[:, j], 0.0)


def _square(state: LogState, j: int) -> Array:
    """Square of the modelled torque of joint j, with the sign of the torque, shape (M,)."""
    modelled = _modelled(state, j)
    return modelled * np.abs(modelled)

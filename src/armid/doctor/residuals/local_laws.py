"""Laws of damage at one angle of a joint, and of a gain that swings with its angle.

A damaged tooth, a bearing with a dent or a bent shaft brakes where the joint passes one angle. A wrong commutation
angle, an eccentric wheel of a torque sensor or cogging under load makes the gain of the torque swing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import WIDTH
from armid.doctor.fitted_log import LogState
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.residuals.missing_law import ANGLE, MissingLaw
from armid.measurement.observations import ObservedRun

SPREADS = (0.05, 0.1, 0.2)
"""Widths of the friction about an angle that are tried [rad or m]; wider ones look like friction of a load."""

MOST_ANGLES = 40
"""Largest number of angles that are tried for each width."""

FELT = 0.08
"""Smallest residual of a joint that is examined, relative to the standard deviation of its torque."""

SCREENED = 0.5
"""Decrease of the squared residuals, without the filter of the log, from which a law is computed exactly."""

WAVES = np.arange(6.0, 40.5, 0.5)
"""Numbers of waves of the gain in a turn of the joint that are tried; fewer look like wrong weights."""

HINT = 0.3
"""Share of the squared residual that a wave must explain so that its law is tried."""

TURNS = 1.5
"""Smallest number of waves within the range of the joint."""

WORN = "find out the cause in the joint (damaged tooth, bearing or seal, a cable that rubs), or leave out this angle"
UNEVEN = "calibrate the commutation of the motor, or the torque sensor, over a turn, and record again"


def local_laws(state: LogState) -> Iterator[MissingLaw]:
    """Laws of friction at one angle, and of a gain that swings, for joints with a large residual."""
    rows, added = state.rows, AddedColumns(state)
    for j in range(rows.n):
        used = rows.mask[:, j]
        if not used.any() or state.fit.sigma[j] < FELT * float(np.std(rows.torque[used, j])):
            continue
        yield from _friction_at_an_angle(state, added, j)
        if not state.model.robot.joints[j].is_prismatic:
            yield from _gain_that_swings(state, j)


def _friction_at_an_angle(state: LogState, added: AddedColumns, j: int) -> Iterator[MissingLaw]:
    """Friction about the angle that explains most of the residual of joint j; nothing if none explains enough."""
    q, dq = state.rows.motion.q[:, j], state.rows.motion.dq[:, j]
    low, high = float(q.min()), float(q.max())
    count = [min(MOST_ANGLES, 1 + int((high - low) / spread)) for spread in SPREADS]
    tried = [(angle, s) for s, c in zip(SPREADS, count, strict=True) for angle in np.linspace(low, high, c + 2)[1:-1]]
    angles, spreads = np.array(tried).T[:, :, None]
    columns = np.tanh(dq / WIDTH) * np.exp(-(((q - angles) / spreads) ** 2))
    decreases, _ = added.decreases(j, columns)
    best = int(np.argmax(decreases))
    if decreases[best] < SCREENED:
        return
    angle, spread = tried[best]

    def braking(run: ObservedRun) -> Array:
        m = run.motion
        near = np.exp(-(((m.q[:, j] - angle) / spread) ** 2))
        return (np.tanh(m.dq[:, j] / WIDTH) * near)[:, None]

    unit = state.model.robot.joints[j].unit
    text = f"its position, as friction does that acts at {angle:.2f} ± {spread:g} {unit} only"
    yield MissingLaw(j, ANGLE, text, state.at_rows(braking).T, "", {}, WORN)


def _gain_that_swings(state: LogState, j: int) -> Iterator[MissingLaw]:
    """Gain with the number of waves in a turn that explains most of the residual of joint j."""
    rows = state.rows
    q, residual = rows.motion.q[:, j], state.fit.residual[:, j]
    modelled = np.where(rows.mask[:, j], rows.torque[:, j] - residual, 0.0)
    tried = WAVES[WAVES * np.ptp(q) > 2.0 * np.pi * TURNS]
    power = float(residual @ residual) * float(modelled @ modelled)
    if not len(tried) or power <= 0.0:
        return
    share = 2.0 * np.abs(np.exp(1j * np.outer(tried, q)) @ (residual * modelled)) ** 2 / power
    best = int(np.argmax(share))
    if share[best] < HINT:
        return
    wave = float(tried[best])
    columns = modelled * np.stack([np.sin(wave * q), np.cos(wave * q)])
    text = f"its position in proportion to the torque: the gain swings, with {wave:g} waves in a turn"
    yield MissingLaw(j, ANGLE, text, columns, "", {}, UNEVEN)

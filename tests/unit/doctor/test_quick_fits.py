"""Quick fits: another torque leaves the columns, products give the same fit, a change gains what its fit gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.doctor import LogEvidence
from armid.doctor.changes.alternatives import Alternative
from armid.doctor.changes.scan import scan
from armid.doctor.changes.shapes import shapes
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import make_rows, solve, solve_coarsely
from armid.measurement.convention_conversion import to_robot_convention
from sick import sound

UR10E, PANDA = 4, 51
"""Seeds of logs of these arms."""

ROUNDING = 1e-12
"""Relative difference of two filters of the same torque."""

COARSE = 1e-5
"""Largest relative difference of residuals of a fit from products, whose rounding and ridge are 1e-9 of columns of
unit length, for a condition number of a thousand."""


def state_of(seed: int) -> LogState:
    case = sound(seed)
    read = to_robot_convention(case.recording, case.reading, case.robot).recording
    state = LogEvidence(case.robot, case.recording, case.reading, read).state
    assert state is not None
    return state


@pytest.mark.parametrize("seed", [UR10E, PANDA])
def test_another_torque_gives_the_rows_that_would_be_computed_anew(seed: int):
    state = state_of(seed)
    torques = [np.roll(run.torque, 3, axis=0) for run in state.log.runs]
    reused, anew = state.with_torques(torques), state.with_torques(torques).log
    rows = make_rows(state.source, anew)
    assert np.abs(reused.rows.torque - rows.torque).max() <= ROUNDING * np.abs(rows.torque).max()
    for found, known in zip(reused.rows.columns, rows.columns, strict=True):
        assert np.abs(found - known).max() <= ROUNDING * np.abs(known).max()
    assert np.abs(reused.rows.torque - state.rows.torque).max() > 1e-3 * np.abs(rows.torque).max()


@pytest.mark.parametrize("extras", [0, 2])
def test_a_fit_from_products_has_the_residuals_of_the_fit_from_columns(extras: int):
    rows = state_of(PANDA).rows
    extra = np.random.default_rng(0).normal(size=(extras, *rows.torque.shape)) if extras else None
    exact = solve(rows, extra=extra)
    values, sigma = solve_coarsely(rows, extra)
    assert values.shape == exact.values.shape
    np.testing.assert_allclose(sigma, exact.sigma, rtol=COARSE)
    if extras:
        np.testing.assert_allclose(
            values[-extras:], exact.values[-extras:], rtol=0.0, atol=COARSE * exact.sigma.max()
        )


def test_an_offset_within_a_log_decreases_the_residuals_as_a_fit_with_it_does():
    """The search keeps the weights of the joints, so an offset that is small against the noise is compared."""
    state = state_of(PANDA)
    rows, step = state.rows, next(k for k, each in enumerate(shapes()[0]) if (each.first, each.stop) == (5, 14))
    size = shapes()[2][step][np.minimum(np.arange(len(rows.torque)) * 20 // len(rows.torque), 19)]
    torque = rows.torque.copy()
    torque[:, 1] += 3.0 * state.fit.sigma[1] * size
    changed = LogState(state.model, state.base, state.log)
    changed.__dict__["rows"] = replace(rows, torque=torque)
    column = np.zeros((1, *torque.shape))
    column[0, :, 1] = 1.0
    (best,) = scan(changed, [Alternative("offset", (1,), column)])
    assert (best.shape.form, best.shape.first, best.shape.stop) == ("step", 5, 14)
    weights = 1.0 / changed.fit.sigma
    before = np.sum((changed.fit.residual * weights) ** 2)
    after = solve(changed.rows, extra=column * size[:, None])
    left = np.sum((after.residual * weights) ** 2)
    # The fit of all joints weights them anew, which decreases its own residual more than this sum.
    assert best.gain * rows.mask.sum() == pytest.approx(before - left, rel=0.2)

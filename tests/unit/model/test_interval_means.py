"""Means of torque laws over the interval of a sample."""

from __future__ import annotations

import numpy as np
import pytest

from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Viscous
from armid.robot import load_robot

SECONDS = 0.01
FINE = 20_000
QUADRATURE = 2.0 / FINE  # a step of the sign lies inside of one of the fine intervals


def test_laws_of_dry_friction_are_averaged_over_a_reversal():
    """The mean of the column is that of very many instants, with the velocity that changes linearly."""
    model = DynamicsModel(load_robot("iiwa14-r820"), (Coulomb(), Viscous()))
    rng = np.random.default_rng(0)
    ddq = rng.uniform(1.0, 20.0, (60, 7)) * rng.choice([-1.0, 1.0], (60, 7))
    dq = 0.7 * SECONDS * ddq * rng.uniform(-1.0, 1.0, (60, 7))  # reversals within and just outside of the interval
    q = np.zeros((60, 7))
    motion = Motion(SECONDS * np.arange(60.0), q, dq, ddq)
    moments = (np.arange(FINE) + 0.5) / FINE * SECONDS - 0.5 * SECONDS
    expected = np.stack(
        [
            model.term_columns(
                Motion(moments, np.zeros((FINE, 7)), v + moments[:, None] * a, np.broadcast_to(a, (FINE, 7)).copy())
            ).values.mean(axis=1)
            for v, a in zip(dq, ddq, strict=True)
        ],
        axis=1,
    )
    found = model.term_columns(motion.with_means(SECONDS)).values
    assert np.abs(found - expected).max() < QUADRATURE
    inside = np.abs(dq) < 0.5 * SECONDS * np.abs(ddq)
    assert 10 < inside.sum() < 410
    assert np.abs(model.term_columns(motion).values - expected).max() > 0.5  # the sign at an instant is no mean


def test_parts_of_a_motion_have_means_over_the_same_interval():
    motion = Motion.of_states(np.zeros((9, 2)), np.zeros((9, 2)), np.zeros((9, 2))).with_means(0.25)
    assert motion[2:5].mean_over == motion.with_memory(np.zeros((9, 1))).mean_over == 0.25
    with pytest.raises(AttributeError):
        motion.mean_over = 1.0  # type: ignore[misc]


def test_a_motion_without_means_is_that_of_instants():
    model = DynamicsModel(load_robot("iiwa14-r820"), (Coulomb(),))
    dq = np.full((3, 7), [[1e-9], [0.0], [-1e-9]])
    column = model.term_columns(Motion.of_states(np.zeros((3, 7)), dq, np.ones((3, 7)))).values[0]
    assert column.tolist() == [1.0, 0.0, -1.0]

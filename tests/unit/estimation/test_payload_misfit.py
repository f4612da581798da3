"""Test of fit of a payload: which link carries it shows in the residual, and a sound one raises no alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.update.payload_misfit import PayloadMisfit, misfit_of
from armid.estimation.update.stacked_problem import stack_problems
from armid.estimation.whitened_system import whiten
from armid.maths.inertia import com_inertia_to_vector
from carried import LOAD, Carrying, arm, carrying, changing, known

DRAWS = 24
"""Sound loads. With a probability of 1e-3 of a false alarm, one alarm in so many has a probability of 2 %."""

HAND = com_inertia_to_vector(2.0, np.array([0.03, -0.02, 0.12]), np.diag([0.012, 0.015, 0.009]))
"""A load in the frame of another link."""


def on_link(k: int) -> Array:
    """Columns of a load on link k, shape (b, 10)."""
    model, base = arm()
    return base.regrouping[:, model.inertial_columns.reshape(-1, 10)[k]]


def with_load_on(carried: Carrying, k: int, load: Array) -> Carrying:
    """The recording with the torque of a load on link k added."""
    shift = on_link(k) @ load
    joints = []
    for joint in carried.information.joints:
        R = np.array(joint.R)
        R[:, :, -1] += R[:, :, :-1] @ shift[joint.parameters]
        joints.append(type(joint)(joint.parameters, R))
    return carried._replace(information=replace(carried.information, joints=tuple(joints)))


def misfit(
    unloaded: Carrying, loaded: Carrying, link: int = -1, deviation: float = 0.0, mass: float | None = None
) -> PayloadMisfit:
    new = loaded.information
    stacked = stack_problems(unloaded.information, known(unloaded.information), new, changing(), on_link(link))
    given = None if mass is None else np.append(mass, np.full(9, np.nan))
    return misfit_of(stacked, new, whiten(new), np.full(6, deviation), given)


@pytest.fixture(scope="module")
def unloaded() -> Carrying:
    return carrying(1, np.random.default_rng(1))


@pytest.mark.parametrize("seconds", [16.0, 5.0])
def test_a_sound_load_raises_no_alarm_although_friction_has_changed(unloaded: Carrying, seconds: float):
    found = [
        misfit(unloaded, carrying(2, np.random.default_rng(seed), LOAD, friction=1.5, seconds=seconds))
        for seed in range(DRAWS)
    ]
    assert not any(each.significant.any() for each in found)
    if seconds > 5.0:  # of so many rows both residuals are the noise, to 10 %
        for each in found:
            np.testing.assert_allclose(each.residual / each.alone, 1.0, atol=0.1)


@pytest.mark.parametrize("link", [2, 3, 4])
def test_a_load_on_another_link_is_noticed_and_found(unloaded: Carrying, link: int):
    loaded = with_load_on(carrying(2, np.random.default_rng(2)), link, 3.0 * HAND)
    assert misfit(unloaded, loaded).significant.any()
    each = {k: misfit(unloaded, loaded, k) for k in range(6)}
    assert min(each, key=lambda k: each[k].cost) == link
    assert not each[link].significant.any()


def test_wrong_gains_of_stated_deviation_are_no_load_on_another_link(unloaded: Carrying):
    gains = np.array([0.05, -0.08, 0.1, 0.03, -0.04, 0.06])
    before = carrying(1, np.random.default_rng(1), correction=gains)
    after = carrying(2, np.random.default_rng(3), LOAD, correction=gains)
    assert not misfit(before, after, deviation=0.1).significant.any()
    assert not misfit(before, after, deviation=0.1, mass=LOAD[0]).significant.any()


def test_without_noise_nothing_is_noticed():
    assert not misfit(carrying(1, None), carrying(2, None, LOAD)).significant.any()

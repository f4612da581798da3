"""Velocity laws that the band resolves: narrow ones on slow motion, and no others as candidates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.estimation.friction.candidates import Candidate, allowed_candidates
from armid.estimation.friction.laws_resolved_by_band import RESOLVED, passed_height, passed_transition
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Hysteresis, Sigmoid, Stribeck
from problems import one_run
from trees import robot_of, structured_tree

RATE, SECONDS, CUTOFF, WIDTH = 200.0, 40.0, 5.0, 0.02
"""Samples a second, length, cut-off of the band [Hz] and width of Coulomb friction [rad/s]."""

HALF = 0.5
"""Amplitude of the motion [rad]."""


def observed(period: float, band: Band | None = None) -> tuple[DynamicsModel, Observations]:
    """Two joints that swing as a sine, the second ten times as slowly."""
    model = DynamicsModel(
        robot_of(structured_tree(np.random.default_rng(1), 2, prismatic=0.0)), (Coulomb(width=WIDTH),)
    )
    t = np.arange(int(SECONDS * RATE)) / RATE
    w = 2.0 * np.pi / np.array([period, 10.0 * period])
    q = HALF * np.sin(w * t[:, None] + 0.3)
    motion = Motion(t, q, HALF * w * np.cos(w * t[:, None] + 0.3), -(w**2) * q)
    run = one_run(motion, np.zeros_like(q), RATE, block_rows=50)
    return model, Observations((run,), band or Band(family="butterworth", order=4, cutoff=CUTOFF))


@pytest.mark.parametrize("term", [Stribeck(0.02, 2.0, WIDTH), Sigmoid(2.0 / 0.05, 0.0)])
def test_narrow_laws_pass_the_band_on_slow_motion_alone(term):
    """The fast joint passes 0.02 rad/s in 13 ms, the slow one in 1.3 s; the band averages over 0.1 s."""
    model, observations = observed(2.0)
    fast, slow = passed_height(model, term, WIDTH, observations)
    assert fast < 0.3 < 0.9 < slow < 1.2


def test_without_a_band_every_row_shows_the_law():
    model, observations = observed(2.0, Band())
    shown = passed_height(model, Stribeck(0.1, 2.0, WIDTH), WIDTH, observations)
    np.testing.assert_allclose(shown, 1.0, atol=0.05)  # a row lies that near to the height


def test_rows_that_do_not_count_show_nothing():
    model, observations = observed(2.0)
    (run,) = observations.runs
    dark = replace(run, mask=np.zeros_like(run.mask))
    assert (passed_height(model, Stribeck(0.4, 2.0, WIDTH), WIDTH, replace(observations, runs=(dark,))) == 0.0).all()


def test_candidates_are_resolved_shapes():
    """A law that only a reversal within milliseconds would show is no candidate, however large a height fits."""
    model, observations = observed(2.0)
    fast, slow = allowed_candidates(model, observations)
    narrow, wide = Candidate("stribeck", 0.02), Candidate("stribeck", 0.4)
    assert narrow not in fast and wide in fast
    assert narrow in slow
    for j, own in enumerate((fast, slow)):
        for piece in own:
            if piece.term == "stribeck":
                height = passed_height(model, Stribeck(piece.shape, 2.0, WIDTH), WIDTH, observations)
                assert height[j] >= RESOLVED


def test_transitions_of_hysteresis_pass_where_reversals_take_their_time():
    """Two milliradians take 20 ms after a reversal of the fast joint, and ten times as long on the slow one."""
    model, observations = observed(1.0)
    fast, slow = passed_transition(model, Hysteresis((0.001,)), WIDTH, observations)
    assert fast < RESOLVED < slow
    wide = passed_transition(model, Hysteresis((0.1,)), WIDTH, observations)
    assert (wide > 0.7).all()
    narrow = Candidate("hysteresis", 0.001)
    assert [narrow in own for own in allowed_candidates(model, observations)] == [False, True]

"""Steps of torque laws at reversals in filtered and decimated recordings."""

from __future__ import annotations

import numpy as np
import pytest

from armid.kernel.channels.passes import decimate
from armid.maths.signals.decimation import decimation_filter
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Stribeck, Viscous
from armid.model.terms.filtered_steps import sign_deviations
from armid.robot import load_robot

RATE = 8000.0
SECONDS = 60.0
SAMPLED = 2e-4
"""Error of the columns at the full rate, whose signs step between samples of 8 kHz, too."""

FRICTION = {
    "coulomb": (Coulomb(), Viscous()),
    "smooth": (Coulomb(width=0.02),),
    "stribeck": (Stribeck(velocity=0.05),),
}


def velocity(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and accelerations of seven joints with reversals at all places between samples."""
    frequency, phase = 0.31 + 0.17 * np.arange(7), 0.3 * np.arange(7)
    angle = 2.0 * np.pi * np.outer(t, frequency) + phase
    return np.sin(angle) + 0.4, 2.0 * np.pi * frequency * np.cos(angle)


def of_arm(t: np.ndarray) -> Motion:
    dq, ddq = velocity(t)
    return Motion(t, np.zeros_like(dq), dq, ddq)


@pytest.mark.parametrize("step", [8, 32, 80])
@pytest.mark.parametrize(("name", "better"), [("coulomb", 10.0), ("smooth", 0.999), ("stribeck", 4.0)])
def test_columns_are_those_of_the_filtered_full_rate(name: str, better: float, step: int):
    """In the band of an estimation, the columns agree with the filtered and decimated columns of all samples.

    The comparison is made after a further low-pass filter. `better` is the ratio of the errors without and with
    filtered steps: a smooth sign has no step, and beside its step, Stribeck friction has a narrow peak.
    """
    model = DynamicsModel(load_robot("iiwa14-r820"), FRICTION[name])
    t = np.arange(round(SECONDS * RATE)) / RATE
    taps = decimation_filter(step)
    rows = (len(t) - len(taps)) // step + 1
    full = decimate(np.ascontiguousarray(model.term_columns(of_arm(t)).values.T), taps, step, 0, rows)
    motion = of_arm(t[len(taps) // 2 :: step][:rows])
    filtered = motion.with_sign_deviation(sign_deviations(motion.dq, taps, step))
    later = round(RATE / step / 10.0)
    low, count = decimation_filter(later), (rows - len(decimation_filter(later))) // later + 1

    def error(with_steps: Motion) -> float:
        off = model.term_columns(with_steps).values.T - full
        return float(np.sqrt(np.mean(decimate(np.ascontiguousarray(off), low, later, 0, count) ** 2)))

    assert error(filtered) <= max(error(motion) / better, SAMPLED)


def test_parts_of_a_motion_keep_the_filtered_signs():
    motion = of_arm(np.arange(50) / 100.0)
    filtered = motion.with_sign_deviation(sign_deviations(motion.dq, decimation_filter(8), 8))
    part = filtered[10:20].with_memory(np.zeros((10, 1)))
    assert filtered.sign_deviation is not None and part.sign_deviation is not None
    assert np.array_equal(part.sign_deviation, filtered.sign_deviation[10:20])


def test_a_rest_and_a_sample_of_zero_are_no_jumps():
    """A joint that stops for a while does not reverse at an instant; one that reverses at a sample does."""
    taps = decimation_filter(8)
    rest = np.concatenate([-np.ones(30), np.zeros(10), np.ones(30)])[:, None]
    assert not sign_deviations(rest, taps, 8).any()
    at_a_sample = (np.arange(71.0) - 35.0)[:, None]
    found = sign_deviations(at_a_sample, taps, 8)[:, 0]
    assert found[35] == pytest.approx(0.0, abs=1e-12) and np.allclose(found, -found[::-1], rtol=0.0, atol=1e-12)
    between = sign_deviations(at_a_sample + 0.5, taps, 8)[:, 0]
    # The sum over the samples is that of a step at its instant: half a sample later here than between samples.
    assert abs(between.sum()) < 1e-9


def test_a_motion_of_instants_has_steps_between_samples():
    model = DynamicsModel(load_robot("iiwa14-r820"), (Coulomb(),))
    dq = np.full((3, 7), [[1e-9], [0.0], [-1e-9]])
    column = model.term_columns(Motion.of_states(np.zeros((3, 7)), dq, np.ones((3, 7)))).values[0]
    assert column.tolist() == [1.0, 0.0, -1.0]

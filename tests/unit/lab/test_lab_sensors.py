"""Sensors and faults: each does what it says, and nothing else."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from armid.errors import LabError
from armid.lab.faults import (
    FAULTS,
    DeadChannel,
    Degrees,
    Delayed,
    Filtered,
    Gap,
    LostRows,
    NoClock,
    PositionOffset,
    RepeatedRows,
    Saturated,
    Scaled,
    ShuffledRows,
    StuckChannel,
    SwappedJoints,
    TorqueSign,
    WrappedPosition,
    spoil,
)
from armid.lab.sensors import Sensing, SensorChannel, sense
from armid.lab.simulated_motion import MARGIN, TrueMotion, inverse_dynamics
from armid.measurement.recording import Recording
from plants import short_plan, small_arm

RATE = 1000.0
NAMES = ("a", "b", "c")


def trace(rate: float = RATE) -> TrueMotion:
    return inverse_dynamics(small_arm(), short_plan(), rate, 1)


def logged(seed: int = 0, truth_rate: float = RATE, **changes) -> Recording:
    sensing = Sensing(**{"rate": RATE, "position": SensorChannel(), "effort": SensorChannel()} | changes)
    return sense(trace(truth_rate), sensing, NAMES, "lab", np.random.default_rng(seed))


TRUE = trace().from_time(0.0)


def test_perfect_sensors_say_what_is():
    found = logged(velocity=SensorChannel())
    np.testing.assert_array_equal(found.q, TRUE.q)
    np.testing.assert_array_equal(found.dq, TRUE.dq)
    np.testing.assert_array_equal(found.effort, TRUE.effort)
    np.testing.assert_allclose(found.time, np.arange(8000) / RATE, atol=1e-12)
    assert (found.joint_names, found.source, found.consecutive) == (NAMES, "lab", True)


def test_a_slower_log_takes_every_so_many_instants():
    found = logged(truth_rate=4000.0)
    assert found.samples == 8000
    np.testing.assert_allclose(found.q, TRUE.q, atol=1e-12)
    np.testing.assert_allclose(logged(rate=250.0).effort, TRUE.effort[::4], atol=1e-12)


def test_noise_is_white_and_as_large_as_said():
    noise = logged(effort=SensorChannel(noise=0.5)).effort - TRUE.effort
    assert noise.std() == pytest.approx(0.5, rel=0.02)  # 24000 samples
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.05
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.05


def test_resolution_bias_and_drift():
    stepped = logged(position=SensorChannel(resolution=1e-3)).q
    np.testing.assert_allclose(np.rint(stepped / 1e-3), stepped / 1e-3, atol=1e-9)
    assert np.abs(stepped - TRUE.q).max() <= 0.5e-3 + 1e-12
    off = logged(effort=SensorChannel(bias=2.0, drift=0.25)).effort - TRUE.effort
    np.testing.assert_allclose(off, 2.0 + 0.25 * TRUE.time[:, None] * np.ones(3), atol=1e-12)


@pytest.mark.parametrize("late", [0.004, 0.0123])
def test_a_delayed_channel_says_what_was(late: float):
    exact = short_plan().at(np.arange(8000) / RATE - late).q
    np.testing.assert_allclose(logged(position=SensorChannel(delay=late)).q, exact, atol=1e-8)


def test_a_low_pass_before_logging_is_causal():
    """Far below its corner it delays by its group delay: √2 / ω of a Butterworth filter of second order."""
    found = logged(position=SensorChannel(cutoff=20.0)).q
    late = np.sqrt(2.0) / (2.0 * np.pi * 20.0)
    np.testing.assert_allclose(found, short_plan().at(np.arange(8000) / RATE - late).q, atol=2e-3)
    assert np.abs(found - TRUE.q).max() > 5e-3


def test_jitter_moves_rows_and_stamps_may_hide_it():
    jitter = 5e-5
    told = logged(jitter=jitter)
    assert told.time is not None
    shift = told.time - np.arange(8000) / RATE
    assert shift.std() == pytest.approx(jitter, rel=0.05) and (np.diff(told.time) > 0).all()
    np.testing.assert_allclose(told.q, short_plan().at(told.time).q, atol=1e-9)
    hidden = logged(jitter=jitter, stamps="even")
    np.testing.assert_array_equal(hidden.q, told.q)
    np.testing.assert_allclose(hidden.time, np.arange(8000) / RATE, atol=1e-12)
    bare = logged(stamps="none")
    assert bare.time is None and bare.rate == RATE


def test_the_link_side_feels_no_friction():
    np.testing.assert_array_equal(logged(side="link").effort, TRUE.transmitted)
    np.testing.assert_allclose(TRUE.transmitted + TRUE.friction, TRUE.effort, atol=1e-12)


def test_the_seed_makes_the_log():
    noisy = {"position": SensorChannel(noise=1e-4), "jitter": 1e-5}
    assert logged(1, **noisy).sha256 == logged(1, **noisy).sha256 != logged(2, **noisy).sha256


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: SensorChannel(noise=-1.0),
        lambda: SensorChannel(delay=2.0 * MARGIN),
        lambda: Sensing(rate=8001.0),
        lambda: Sensing(rate=0.0),
        lambda: Sensing(side="moon"),  # pyright: ignore[reportArgumentType]
        lambda: Sensing(stamps="odd"),  # pyright: ignore[reportArgumentType]
        lambda: Sensing(jitter=-1.0),
        lambda: LostRows(1.5),
        lambda: Scaled((1.0, 2.0)).apply(logged(), np.random.default_rng(0)),
        lambda: DeadChannel(7).apply(logged(), np.random.default_rng(0)),
        lambda: Delayed(quantity="colour").apply(logged(), np.random.default_rng(0)),
    ],
)
def test_what_cannot_be_is_refused(wrong):
    with pytest.raises(LabError):
        wrong()


# Faults ----------------------------------------------------------------------------------------------------------

CLEAN = logged(velocity=SensorChannel())


def same_but(found: Recording, *names: str) -> None:
    """Everything but these fields is untouched."""
    for field in fields(Recording):
        if field.name not in (*names, "sha256"):
            np.testing.assert_equal(getattr(found, field.name), getattr(CLEAN, field.name), err_msg=field.name)


def spoilt(fault) -> Recording:
    found = spoil(CLEAN, [fault], 5)
    assert found.sha256 == spoil(CLEAN, [fault], 5).sha256 != CLEAN.sha256
    return found


ROWS = ("time", "q", "dq", "effort", "valid")


def test_lost_rows():
    found = spoilt(LostRows(0.1))
    assert found.samples == pytest.approx(7200, abs=150)
    kept = np.rint(found.time * RATE).astype(int)  # pyright: ignore[reportOptionalOperand]
    np.testing.assert_array_equal(found.effort, CLEAN.effort[kept])  # pyright: ignore[reportOptionalSubscript]
    assert kept[0] == 0 and kept[-1] == 7999
    same_but(found, *ROWS)


def test_gap():
    found = spoilt(Gap(0.25, 0.5))
    assert found.samples == 7500 and np.diff(found.time).max() == pytest.approx(0.501, abs=1e-6)  # pyright: ignore
    same_but(found, *ROWS)


@pytest.mark.parametrize("stamps", [False, True])
def test_repeated_rows(stamps: bool):
    found = spoilt(RepeatedRows(0.05, stamps))
    again = (np.diff(found.q, axis=0) == 0.0).all(axis=1)
    assert again.mean() == pytest.approx(0.05, abs=0.01)
    assert (np.diff(found.time)[again] == 0.0).all() == stamps  # pyright: ignore[reportArgumentType]
    rows = np.flatnonzero(~again) + 1
    np.testing.assert_array_equal(found.q[rows], CLEAN.q[rows])
    same_but(found, *ROWS)


def test_delayed():
    found = spoilt(Delayed(0.01, "q"))
    np.testing.assert_allclose(found.q[10:], CLEAN.q[:-10], atol=1e-9)
    same_but(found, "q")


def test_filtered():
    found = spoilt(Filtered(5.0))
    assert found.effort is not None and CLEAN.effort is not None
    assert np.abs(np.diff(found.effort, axis=0)).max() < 0.2 * np.abs(np.diff(CLEAN.effort, axis=0)).max()
    same_but(found, "effort")


@pytest.mark.parametrize(
    ("fault", "law"),
    [
        (DeadChannel(1), lambda x: 0.0 * x),
        (Saturated(1, 0.5), lambda x: np.clip(x, -0.5 * np.abs(x).max(), 0.5 * np.abs(x).max())),
        (StuckChannel(1, start=0.5), lambda x: np.where(np.arange(8000) < 4000, x, x[4000])),
        (StuckChannel(1, start=0.5, seconds=1.0), lambda x: np.where(np.arange(8000) // 1000 == 4, x[4000], x)),
        (TorqueSign((1,)), lambda x: -x),
    ],
)
def test_faults_of_one_torque(fault, law):
    found = spoilt(fault)
    assert found.effort is not None and CLEAN.effort is not None
    np.testing.assert_allclose(found.effort[:, 1], law(CLEAN.effort[:, 1]), atol=1e-12)
    np.testing.assert_array_equal(found.effort[:, [0, 2]], CLEAN.effort[:, [0, 2]])
    same_but(found, "effort")


def test_faults_of_columns():
    assert CLEAN.effort is not None and CLEAN.dq is not None
    np.testing.assert_array_equal(spoilt(TorqueSign()).effort, -CLEAN.effort)
    swapped = spoilt(SwappedJoints(0, 2))
    np.testing.assert_array_equal(swapped.effort, CLEAN.effort[:, [2, 1, 0]])
    same_but(swapped, "effort")
    degrees = spoilt(Degrees())
    np.testing.assert_allclose(degrees.q * np.pi / 180.0, CLEAN.q, atol=1e-12)
    np.testing.assert_allclose(degrees.dq * np.pi / 180.0, CLEAN.dq, atol=1e-12)
    same_but(degrees, "q", "dq")
    off = spoilt(PositionOffset(2, 0.25))
    np.testing.assert_allclose(off.q - CLEAN.q, [[0.0, 0.0, 0.25]] * 8000, atol=1e-12)
    same_but(off, "q")


def test_scaled():
    assert CLEAN.effort is not None
    found = spoilt(Scaled((1.0, 2.0, -3.0)))
    np.testing.assert_array_equal(found.effort, CLEAN.effort * [1.0, 2.0, -3.0])
    same_but(found, "effort")
    np.testing.assert_array_equal(spoilt(Scaled((0.5,), "q")).q, 0.5 * CLEAN.q)


def test_no_clock_and_shuffled_rows():
    bare = NoClock().apply(CLEAN, np.random.default_rng(0))
    assert bare.time is None and bare.rate is None
    same_but(bare, "time")
    found = spoilt(ShuffledRows())
    rows = np.argsort(found.q[:, 0], kind="stable")
    right = np.argsort(CLEAN.q[:, 0], kind="stable")
    np.testing.assert_array_equal(found.q[rows, 0], CLEAN.q[right, 0])
    # Rows stay whole: what stood beside a position stands there still.
    where = {tuple(q): k for k, q in enumerate(CLEAN.q)}
    back = [where[tuple(q)] for q in found.q]
    np.testing.assert_array_equal(found.dq, CLEAN.dq[back])  # pyright: ignore[reportOptionalSubscript]
    assert found.time is None and found.consecutive is None and back != sorted(back)
    same_but(found, "consecutive", *ROWS)


def test_wrapped_positions():
    far = replace(CLEAN, q=CLEAN.q + 3.0)
    found = WrappedPosition().apply(far, np.random.default_rng(0)).q
    assert (found <= np.pi).all() and (found > -np.pi).all() and np.abs(np.diff(found, axis=0)).max() > 6.0
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * far.q), atol=1e-12)


def test_every_fault_is_known_by_its_name():
    assert {kind.name: kind for kind in FAULTS.values()} == FAULTS
    for kind in FAULTS.values():
        assert spoil(replace(CLEAN, q=CLEAN.q + 3.0), [kind()], 1).samples > 0

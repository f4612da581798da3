"""Standstill between motion: found where a joint sticks, and nowhere else; its rows left out and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.doctor import examine, explanations_of
from armid.doctor.check_input import LogEvidence
from armid.lab.controller import Controller
from armid.lab.friction import Friction
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import Simulated, simulate
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.options import THESIS, ProcessingOptions
from armid.measurement.processing.standstill import BESIDE, SLIDING, standing, sticks_and_rests
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.study.diagnosis import diagnose_recording
from labs import FRICTION
from motions import clock, codes, motion, one, recording
from plants import short_plan, small_arm

RATE = 1000.0
SLACK = 0.03  # s: half the span of a measured speed, and how far a joint has moved before it is faster than slow
NOISE = 1e-5  # rad, of an encoder
COARSE = 0.01  # rad, of a joint angle that is logged with two decimals
FEW = 0.1  # a median of 15000 differences that overlap errs by some percent
CREEP = 0.005  # rad: 4.5 mrad/s at most, less than a hundredth of the speed in motion


def stuck(seconds: float, pause: float, rate: float = RATE) -> np.ndarray:
    """A joint that swings, and stands for a while whenever it turns round; positions (N, 1)."""
    t = clock(seconds, rate)
    cycle = 2.0 * (1.0 + pause)
    half, inside = np.divmod(t % cycle, 1.0 + pause)
    angle = np.pi * np.minimum(inside, 1.0)
    # Speed sin: the joint leaves and reaches rest with an acceleration of π²/4 rad/s².
    return np.where(half == 0, -np.cos(angle), np.cos(angle))[:, None] / 4.0


def truly(seconds: float, pause: float) -> np.ndarray:
    return (clock(seconds, RATE) % (1.0 + pause)) > 1.0


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("pause", [0.08, 0.2, 0.7])
def test_pauses_at_reversals_are_found(pause: float, noise: float):
    q = stuck(12.0, pause) + noise * np.random.default_rng(1).normal(size=(12000, 1))
    found, right = standing(q, RATE)[:, 0], truly(12.0, pause)
    assert found[right].mean() > 0.98
    reach = int(SLACK * RATE)
    near = np.convolve(right, np.ones(2 * reach + 1), "same") > 0
    assert not found[~near].any()


@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_smooth_motion_never_stands(rate: float, noise: float):
    assert not standing(recording(clock(30.0, rate), noise=noise).q, rate).any()


def test_a_joint_that_never_moves_and_one_hidden_by_noise_have_no_standstill():
    q = np.hstack([np.full((12000, 1), 0.3), stuck(12.0, 0.2)])
    assert not standing(q, RATE)[:, 0].any()
    assert standing(q, RATE)[:, 1].any()
    assert not standing(q + 0.05 * np.random.default_rng(1).normal(size=q.shape), RATE).any()
    assert not standing(q[:5], RATE).any()


def test_an_arm_that_rests_between_motion_does_not_stick():
    """All joints at once, each on its own path; one that stands longer than the others is still seen."""
    q = stuck(24.0, 1.4) * np.array([1.0, -0.7, 1.3])
    assert standing(q[:, :1], RATE).any()
    assert not standing(q, RATE).any()
    q[:, 2:] = stuck(24.0, 0.15)
    assert standing(q, RATE).any(axis=0).all()


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_all_joints_at_rest_for_a_moment_between_motions_stand(noise: float):
    """Friction goes through all of its range there, and shows no weight that the motion beside it does not show."""
    q = stuck(12.0, 0.4) * np.array([1.0, -0.7, 1.3]) + noise * np.random.default_rng(1).normal(size=(12000, 3))
    found, right = standing(q, RATE), truly(12.0, 0.4)
    inner = right & (np.arange(12000) < 11000)  # the last rest may be the end of all motion
    assert found[inner].mean() > 0.98
    reach = round(BESIDE * RATE)
    near = np.convolve(right, np.ones(2 * reach + 1), "same") > 0
    assert not found[~near].any()


def at_rest_every(period: float) -> np.ndarray:
    """Three joints for 24 s, with velocities and accelerations of zero where each period begins."""
    x = 2.0 * np.pi * clock(24.0, RATE) / period
    return np.column_stack([np.sin(x) ** 3 + c * (1.0 - np.cos(x)) ** 2 for c in (0.3, -0.4, 0.5)])


def test_a_motion_that_begins_and_ends_at_rest_stands_where_it_begins_anew():
    """Velocities and accelerations are zero there and no joint stays: each is left out until it slides for sure."""
    period, t = 8.0, clock(24.0, RATE)
    q = at_rest_every(period)
    dq = np.gradient(q, 1.0 / RATE, axis=0)
    found = standing(q + NOISE * np.random.default_rng(1).normal(size=q.shape), RATE)
    away = np.abs((t + period / 2.0) % period - period / 2.0)
    inner = (t > 0.5 * period) & (t < 2.5 * period)
    assert found[inner & (away < 0.05)].all()
    assert not found[away > BESIDE + SLACK].any()
    assert not found[np.abs(dq) > 1.5 * SLIDING * dq.std(axis=0)].any()


def test_a_rest_at_the_seam_of_repetitions_is_no_sticking():
    """It is left out under a name of its own."""
    t, q = clock(24.0, RATE), at_rest_every(8.0)[:, :2]
    processing = ProcessingOptions(cutoff=20.0, decimate=100.0)
    run, (finding,) = one(log := recording(t, q=q), processing)
    assert (finding.code, finding.severity) == ("rests-left-out", "info")
    assert (
        all(name in finding.evidence for name in log.channels) and "before a motion is repeated" in finding.evidence
    )
    kept, silent = one(log, replace(processing, standstill="keep"))
    assert not silent and run.mask.sum() < kept.mask.sum()
    sticks, rests = sticks_and_rests(q, RATE)
    assert not sticks.any() and np.array_equal(rests, standing(q, RATE))


def test_the_doctor_names_a_rest_at_the_seam_as_an_identification_does():
    robot, q = small_arm().robot, at_rest_every(8.0)
    effort = 10.0 * np.sign(np.gradient(q, axis=0))
    log = Recording(clock(24.0, RATE), q, effort=effort, source="log.csv", joint_names=robot.joint_names)
    found = diagnose_recording(robot, log, LogFormat())
    read = to_robot_convention(log, LogFormat(), robot).recording
    (named,) = (f for f in one(read, ProcessingOptions())[1] if f.code == "rests-left-out")
    assert "sticking" not in codes(found)
    assert [f.evidence for f in found if f.code == "rests-left-out"] == [named.evidence]


def test_an_arm_that_rests_for_long_does_so_while_one_joint_creeps():
    q = stuck(24.0, 2.0) * np.array([1.0, -0.7, 1.3])
    creep = CREEP * np.sin(2.0 * np.pi * clock(24.0, RATE) / 7.0)
    q[:, 2] += creep
    assert not standing(q, RATE).any()
    q[:, 2] += 10.0 * creep  # this one moves, and the two others stand beside it
    assert standing(q, RATE)[:, :2].any(axis=0).all()


@pytest.mark.parametrize(("rate", "seen", "unseen"), [(50.0, 0.16, 0.10), (100.0, 0.08, 0.04), (1000.0, 0.06, 0.04)])
def test_how_short_a_pause_is_seen_depends_on_the_rate(rate: float, seen: float, unseen: float):
    assert standing(stuck(24.0, seen, rate), rate).any()
    assert not standing(stuck(24.0, unseen, rate), rate).any()


@pytest.mark.parametrize("cutoff", [2.0, 20.0])
def test_coarse_positions_on_an_uneven_clock_do_not_stick(cutoff: float):
    """A spline through rounded positions is smooth where they are stairs, and stands on every step."""
    rng = np.random.default_rng(3)
    t = clock(30.0, 500.0) + rng.uniform(-0.3, 0.3, 15000) / 500.0
    log = recording(t, q=COARSE * np.round(motion(t)[0] / COARSE))
    assert "sticking" not in codes(one(log, ProcessingOptions(cutoff=cutoff))[1])


def test_noise_of_positions_is_found_whatever_their_clock():
    rng = np.random.default_rng(5)
    for spread in (0.0, 0.3):
        t = clock(30.0, 500.0) + rng.uniform(-spread, spread, 15000) / 500.0
        q = motion(t)[0]
        assert np.allclose(position_noise(q + NOISE * rng.normal(size=q.shape), t), NOISE, rtol=FEW)
        assert np.allclose(position_noise(COARSE * np.round(q / COARSE), t), COARSE / np.sqrt(12.0), rtol=FEW)
    assert not position_noise(np.zeros((3, 2)), np.arange(3.0)).any()


def both(seconds: float, pause: float) -> np.ndarray:
    """One joint that sticks beside one that never does."""
    return np.hstack([stuck(seconds, pause), 0.4 * np.sin(2.0 * clock(seconds, RATE))[:, None]])


def test_rows_at_standstill_do_not_count_for_their_joint_and_are_named():
    log = recording(clock(24.0, RATE), q=both(24.0, 0.2))
    processing = ProcessingOptions(cutoff=20.0, decimate=100.0)
    kept, silent = one(log, replace(processing, standstill="keep"))
    run, findings = one(log, processing)
    assert codes(silent) == []
    assert kept.mask[:, 0].sum() == kept.mask[:, 1].sum()
    assert np.array_equal(run.mask[:, 1], kept.mask[:, 1])
    lost = kept.mask[:, 0] & ~run.mask[:, 0]
    assert lost[truly(24.0, 0.2)[run.rows] & kept.mask[:, 0]].all()
    (finding,) = findings
    assert (finding.code, finding.severity) == ("sticking", "info")
    assert f"{log.channels[0]} {lost.sum() / kept.mask[:, 0].sum():.0%}" in finding.evidence
    assert log.channels[1] not in finding.evidence


def test_a_joint_that_mostly_stands_keeps_its_rows_with_a_warning():
    log = recording(clock(24.0, RATE), q=both(24.0, 0.9))
    run, findings = one(log, ProcessingOptions())  # at 5 Hz standstill reaches 0.4 s to each side
    assert np.array_equal(run.mask[:, 0], run.mask[:, 1])
    assert [(f.code, f.severity, f.channel) for f in findings] == [("sticking", "warning", log.channels[0])]


def test_the_preset_of_the_thesis_leaves_nothing_out():
    assert THESIS.standstill == "keep"


# Sticking in closed loop ---------------------------------------------------------------------------------------


def sticking(delay: float = 0.0) -> Simulated:
    """The small arm with four times its dry friction under feedback that knows none of it, logged at 1 kHz."""
    friction = Friction(np.array(FRICTION["FV"]), 4.0 * np.array(FRICTION["FS"]))
    effort = SensorChannel(noise=0.02, delay=delay)
    options = LabOptions(
        repetitions=2, controller=Controller(), sensing=Sensing(RATE, SensorChannel(noise=1e-6), effort)
    )
    return simulate(small_arm(friction=friction), short_plan(1, 8.0), options, seed=1)


def told(done: Simulated) -> list[str]:
    model = DynamicsModel(small_arm().robot, (RigidBody(), Viscous(), Coulomb(0.0)))
    log = replace(done.recording, joint_names=model.robot.joint_names)
    found = examine(LogEvidence(model.robot, log, LogFormat(), log, (), model, explanations_of()))
    return [f.code for f in found if f.severity == "error"]


def test_joints_that_stick_are_no_delay_and_a_delay_is_one():
    done = sticking()
    assert (done.trace.dq == 0.0).mean(axis=0).max() > 0.01  # they do stick
    assert told(done) == []
    assert told(sticking(delay=0.02)) == ["channel-delay"]


def test_the_doctor_tells_of_joints_that_stick_as_an_identification_does():
    done, robot = sticking(), small_arm().robot
    log = replace(done.recording, joint_names=robot.joint_names)
    read = to_robot_convention(log, LogFormat(), robot).recording
    (named,) = (f for f in one(read, ProcessingOptions())[1] if f.code == "sticking")
    (finding,) = (f for f in diagnose_recording(robot, log, LogFormat()) if f.code == "sticking")
    assert (finding.severity, finding.evidence, finding.remedy) == (named.severity, named.evidence, named.remedy)
    kept = diagnose_recording(robot, log, LogFormat(), processing=ProcessingOptions(standstill="keep"))
    assert "sticking" not in codes(kept)


@pytest.mark.parametrize("step", [0.0, 2.0 * np.pi / 4096.0])
def test_long_rests_of_each_joint_are_found_where_only_motion_counts(step: float):
    """At the ends, while others move, and of a joint that never moves; from coarse encoders, too."""
    rate, t = 250.0, clock(30.0, 250.0)
    rng = np.random.default_rng(1)
    moves = np.stack([(t >= 2.0) & (t < 28.0), (t < 10.0) | (t >= 14.0), np.zeros(len(t), dtype=bool)], axis=1)
    # Speeds of constant sign: joints that never turn round rest where they are said to and nowhere else.
    q = np.cumsum(moves, axis=0) / rate + 2e-4 * rng.standard_normal(moves.shape)
    q = np.round(q / step) * step if step else q
    found = sticks_and_rests(q, rate, every=True)[1]
    assert found[:, 2].all()
    for j in (0, 1):
        assert found[~moves[:, j], j].mean() > 0.97
        assert found[moves[:, j], j].mean() < 0.01
    assert not sticks_and_rests(q, rate)[1].any()


def test_a_recording_of_rest_alone_has_no_row_in_motion():
    t = clock(20.0)
    log = recording(t, noise=1e-5)
    still = replace(log, q=log.q[:1] + 1e-5 * np.random.default_rng(2).standard_normal(log.q.shape), sha256="")
    run, findings = one(still, ProcessingOptions(standstill="moving"))
    assert not run.mask.any() and "rests-left-out" in codes(findings)
    assert one(still, ProcessingOptions())[0].mask.any()

"""Monitor of the small arm: the observer's equation, sample by sample, alarms that are true, rates that are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.estimate_record import torque_parameters
from armid.lab.options import LabOptions
from armid.lab.pushes import Push
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.runs.monitoring.live_monitor import LiveMonitor
from armid.runs.monitoring.monitor import Monitor, make_monitor, watch
from armid.runs.monitoring.monitor_record import monitor_record, monitor_table
from armid.runs.monitoring.motion_comparison import MotionLevel, reversal_count, unlike_unseen_motion
from armid.runs.monitoring.observer import (
    OBSERVERS,
    LowPassStage,
    ObserverOptions,
    external_torque_along,
    filtered_motion,
)
from armid.runs.monitoring.thresholds import PROMISED
from armid.runs.monitoring.unseen_residuals import external_torque_of, own_residuals
from armid.runs.run import Run
from armid.study.storage.records import to_json
from plants import short_plan, small_arm, smooth_arm
from watched import RATE, SENSORS, moved, small_run

PUSH = Push(joint=1, torque=6.0, start=5.0, seconds=0.3)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return small_run(tmp_path_factory.mktemp("monitored"))


@pytest.fixture(scope="module")
def references() -> list[Recording]:
    """Seven minutes without contact, along sixty motions."""
    return [moved(seed, 1) for seed in range(200, 260)]


@pytest.fixture(scope="module")
def monitor(run: Run, references: list[Recording]) -> Monitor:
    return make_monitor(run, references=references)


def test_a_stage_is_exact_for_lines():
    """ẏ = ω (u - y) with u = t has y = t - 1/ω, once the start is forgotten."""
    time = np.arange(0.0, 2.0, 0.01)[:, None]
    assert np.allclose(LowPassStage.of(20.0, 100.0).along(time)[-1], time[-1] - 1.0 / 20.0)
    assert np.allclose(LowPassStage.of(20.0, 100.0).along(np.ones((5, 2))), 1.0)


def test_the_momentum_observer_is_that_of_the_textbook(run: Run):
    """r = K (p - ∫(τ + ∂T/∂q - g - τ_f + r)), integrated with the filtered signals; equal to the step's order."""
    model, theta = run.model, torque_parameters(run.estimate.base, run.estimate.fit)
    options, errors = ObserverOptions("momentum", 50.0), list[float]()
    for rate in (1000.0, 2000.0):
        exact = Sensing(rate, SensorChannel(), SensorChannel())
        log = simulate(
            smooth_arm(),
            short_plan(3, 3.0),
            LabOptions(mode="inverse-dynamics", sensing=exact, pushes=(replace(PUSH, start=1.5),)),
        ).recording
        assert log.effort is not None
        found = external_torque_along(model, theta, options, rate=rate, q=log.q, dq=None, torque=log.effort)
        by_integral = textbook(model, theta, options, rate, log.q, log.effort)
        errors.append(float(np.abs(found.external - by_integral)[int(rate) :].max()))
    assert errors[1] < 0.6 * errors[0] and errors[1] < 0.01 * PUSH.torque


def textbook(
    model: DynamicsModel, theta: Array, options: ObserverOptions, rate: float, q: Array, torque: Array
) -> Array:
    """Momentum observer by its integral; the gradient of the kinetic energy by differences of the mass matrix."""
    motion = filtered_motion(options, np.arange(len(q)) / rate, rate, q, None)
    stage = LowPassStage.of(options.stage_at(rate), rate)
    torque = stage.along(stage.along(torque))
    momentum = np.einsum("nij,nj->ni", model.mass_matrix(motion.q, theta), motion.dq)
    gradient = np.empty_like(q)
    for j in range(model.n):
        step = np.zeros(model.n)
        step[j] = 1e-6
        change = (model.mass_matrix(motion.q + step, theta) - model.mass_matrix(motion.q - step, theta)) / 2e-6
        gradient[:, j] = 0.5 * np.einsum("ni,nij,nj->n", motion.dq, change, motion.dq)
    still = np.zeros_like(q)
    rest = model.torque(Motion(motion.time, motion.q, motion.dq, still), theta)
    rest = rest - coriolis(model, theta, motion)
    rate_of = torque + gradient - rest
    r, integral, out = np.zeros(model.n), np.zeros(model.n), [np.zeros(model.n)]
    for k in range(1, len(q)):
        integral += (0.5 * (rate_of[k] + rate_of[k - 1]) + r) / rate
        r = options.gain_at(rate) * (momentum[k] - momentum[0] - integral)
        out.append(r)
    return np.array(out)


def coriolis(model: DynamicsModel, theta: Array, motion: Motion) -> Array:
    """C q̇: the part of the torque that is quadratic in the velocities."""
    rigid = np.zeros_like(theta)
    rigid[model.inertial_columns] = theta[model.inertial_columns]
    still = np.zeros_like(motion.q)
    full = model.torque(Motion(motion.time, motion.q, motion.dq, still), rigid)
    return full - model.torque(Motion(motion.time, motion.q, still, still), rigid)


@pytest.mark.parametrize("kind", OBSERVERS)
@pytest.mark.parametrize("velocity", [False, True])
def test_sample_by_sample_is_the_same(run: Run, kind: str, velocity: bool):
    """The batch starts at rest, the stream with its first sample; both forget this before they are used."""

    def with_velocity(recording: Recording) -> Recording:
        return replace(recording, dq=np.gradient(recording.q, 1.0 / RATE, axis=0)) if velocity else recording

    options = ObserverOptions(kind, 50.0)  # pyright: ignore[reportArgumentType]
    made = make_monitor(run, references=[with_velocity(moved(20, 5))], options=options)
    log = with_velocity(moved(4, 1, PUSH))
    assert log.effort is not None
    seen = watch(made, log)
    live = LiveMonitor(made, RATE)
    samples = [live.update(log.q[k], log.effort[k], log.dq[k] if log.dq is not None else None) for k in range(1500)]
    used = slice(int(RATE) + 1, 1500)
    external = np.array([each.external for each in samples])[used]
    threshold = np.array([each.threshold for each in samples])[used]
    assert np.allclose(external, seen.parts[0].external[used], atol=1e-6)
    assert np.allclose(threshold, seen.thresholds[0][used], atol=1e-6)
    assert any(each.alarm for each in samples)
    assert not any(each.alarm for each in samples[: int(RATE)])
    with pytest.raises(ArmidError, match="Velocities"):
        live.update(log.q[0], log.effort[0], None if velocity else log.q[0])


def test_hysteresis_is_the_same_sample_by_sample(tmp_path: Path):
    run = small_run(tmp_path, "rigid-body", "viscous", "hysteresis")
    made = make_monitor(run, references=[moved(20, 5)])
    log = moved(4, 1)
    assert log.effort is not None
    live = LiveMonitor(made, RATE)
    external = np.array([live.update(q, tau).external for q, tau in zip(log.q, log.effort, strict=True)])
    used = slice(int(RATE) + 1, None)
    assert np.allclose(external[used], watch(made, log).parts[0].external[used], atol=1e-6)


def test_a_push_is_found_with_joint_size_and_time(monitor: Monitor):
    seen = watch(monitor, moved(31, 1, PUSH))
    found = [alarm for alarm in seen.alarms if abs(alarm.start - PUSH.start) < 0.3]
    assert len(found) == 1
    (alarm,) = found
    assert alarm.joint == monitor.run.robot.joint_names[PUSH.joint]
    assert 0.0 <= alarm.start - PUSH.start <= 0.05
    assert abs(alarm.duration - PUSH.seconds) < 0.1
    assert alarm.size == pytest.approx(
        PUSH.torque, rel=0.1
    )  # of noise, and the part of the step that the filter shows
    assert alarm.wrench is not None and len(alarm.wrench.undetermined) >= 3


def test_the_promised_rate_is_kept_on_other_motion(monitor: Monitor):
    """Twenty minutes; with one deviation of the count for what is counted."""
    assert monitor.thresholds.promised and monitor.source == "reference"
    seen = [watch(monitor, moved(seed, 1)) for seed in range(300, 480)]
    assert sum(bool(each.findings) for each in seen) <= 0.02 * len(seen)  # the motion is like the unseen motion
    hours = sum(each.seconds for each in seen) / 3600.0
    alarms, promised = sum(len(each.alarms) for each in seen), monitor.thresholds.rate * hours
    assert promised / PROMISED - np.sqrt(promised) <= alarms <= promised * PROMISED + np.sqrt(promised)


def test_thresholds_grow_as_the_rate_falls(run: Run, references: list[Recording], monitor: Monitor):
    rare = make_monitor(run, references=references, false_alarms=0.01)
    assert (rare.thresholds.factor >= monitor.thresholds.factor - 1e-12).all()
    assert not rare.thresholds.promised
    finding = next(each for each in rare.findings if each.code == "rate-not-promised")
    assert f"{rare.thresholds.smallest:.3g} per hour" in finding.evidence


def test_the_recordings_of_the_run_give_thresholds(run: Run):
    """Its only recording, each fifth predicted by an estimate from the others."""
    made = make_monitor(run, false_alarms=100.0)
    assert made.source == "parts" and {each.code for each in made.findings} == {"rate-not-promised", "one-recording"}
    assert made.thresholds.seconds > 20.0


def test_a_part_is_predicted_by_an_estimate_without_it(tmp_path: Path):
    """The torque of joint 3 is half as large again in the last fifth; an estimate with it would follow."""
    log = moved(1, 4)
    assert log.effort is not None
    last = slice(len(log.q) * 4 // 5, None)
    effort = log.effort.copy()
    effort[last, 2] *= 1.5
    run = small_run(tmp_path, recording=replace(log, effort=effort))
    part = own_residuals(run, ObserverOptions()).parts[-1]
    used = part.usable.all(axis=1)
    predicted, residual = (
        external_torque_of(run, ObserverOptions(), replace(log, effort=each))[0].external[-len(used) :][used, 2]
        for each in (np.zeros_like(effort), log.effort)
    )
    torque, found = predicted - residual, part.external[used, 2]  # the true torque after the filters
    assert found @ torque / (torque @ torque) == pytest.approx(-0.5, abs=0.02)  # of noise; with the part it is -0.445


def test_a_rest_gives_no_alarm(monitor: Monitor):
    """A joint that stands holds any torque within its dry friction."""
    log = moved(32, 1)
    assert log.effort is not None
    stop = 1000
    q, effort = log.q.copy(), log.effort.copy()
    rest = np.arange(stop, len(q))
    q[rest] = q[stop]
    model, theta = monitor.run.model, torque_parameters(monitor.run.estimate.base, monitor.run.estimate.fit)
    held = model.gravity_torque(q[stop : stop + 1], theta)[0]
    effort[rest] = held + 0.9 * np.array([0.8, -1.2, 0.4])
    still = replace(log, q=q, effort=effort)
    seen = watch(monitor, still)
    assert not [each for each in seen.alarms if each.start > stop / RATE + 0.5]


def every(step: int, recording: Recording) -> Recording:
    """The same recording at a lower rate."""
    assert recording.time is not None and recording.effort is not None
    rows = slice(None, None, step)
    return Recording(q=recording.q[rows], time=recording.time[rows], effort=recording.effort[rows])


def cut(recording: Recording, length: float, gap: float) -> Recording:
    """The recording with gaps between pieces of a length [s]."""
    assert recording.time is not None and recording.effort is not None
    kept = np.mod(recording.time - recording.time[0], length + gap) < length
    return Recording(q=recording.q[kept], time=recording.time[kept], effort=recording.effort[kept])


def test_what_was_not_watched_is_said(monitor: Monitor):
    """The observer settles for a second after each gap."""
    log = moved(31, 1)
    assert not watch(monitor, log).findings
    (finding,) = watch(monitor, cut(log, 3.0, 0.2)).findings
    assert finding.code == "partly-watched" and "joint_1" in finding.evidence
    with pytest.raises(ArmidError, match="cannot be watched"):
        watch(monitor, cut(log, 0.8, 0.2))


def test_motion_unlike_the_unseen_motion_is_reported(monitor: Monitor):
    """The rate of false alarms is promised for motion like the unseen one, not for four times the speed."""
    options = LabOptions(mode="inverse-dynamics", repetitions=6, sensing=SENSORS)
    fast = simulate(small_arm(), short_plan(31, 2.0), options, seed=31).recording
    slow = simulate(small_arm(), short_plan(31, 16.0), replace(options, repetitions=1), seed=31).recording
    (finding,) = watch(monitor, fast).findings
    assert finding.code == "unlike-unseen-motion" and "speed" in finding.evidence and "reversals" in finding.evidence
    record = monitor_record(monitor, [("fast.csv", watch(monitor, fast))])
    assert [each["code"] for each in record["recordings"][0]["findings"]] == ["unlike-unseen-motion"]
    assert not watch(monitor, slow).findings


def test_a_short_unseen_motion_is_not_compared():
    """Four pieces do not show how far pieces differ, twenty do."""
    mean, deviation = np.ones((3, 2)), np.full((3, 2), 0.3)
    faster = MotionLevel(2.0 * mean, deviation, 20)
    for pieces, reported in ((1, False), (4, False), (20, True)):
        unseen = MotionLevel(mean, deviation, pieces)
        assert bool(unlike_unseen_motion(unseen, faster, ("a", "b"), "log.csv")) == reported


def test_reversals_are_counted_without_those_of_the_noise():
    time = np.arange(0.0, 10.0, 0.01)
    dq = np.cos(2.0 * np.pi * 0.5 * time) + np.random.default_rng(0).normal(0.0, 1e-3, len(time))
    assert reversal_count(dq) == 10
    assert reversal_count(np.random.default_rng(0).normal(0.0, 1e-3, 100)) == 0  # a joint at rest


def test_wrong_requests_are_refused(run: Run, monitor: Monitor):
    with pytest.raises(ArmidError, match="Unknown observer"):
        ObserverOptions("kalman")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ArmidError, match="at least 10"):
        ObserverOptions("momentum", 2.0)
    with pytest.raises(ArmidError, match="rate of false alarms"):
        make_monitor(run, false_alarms=0.0)
    with pytest.raises(ArmidError, match="too high"):
        make_monitor(run, options=ObserverOptions("momentum", RATE))
    with pytest.raises(ArmidError, match="at 20 Hz or more; found 15 Hz"):
        ObserverOptions().gain_at(15.0)  # the default would not have settled when alarms begin
    with pytest.raises(ArmidError, match="250 Hz"):
        LiveMonitor(monitor, 1000.0)
    with pytest.raises(ArmidError, match="250 Hz"):
        watch(monitor, every(5, moved(31, 1)))
    with pytest.raises(ArmidError, match="Samples of a recording of unseen motion"):
        make_monitor(run, references=[moved(31, 1), every(2, moved(32, 1))])
    with pytest.raises(ArmidError, match="not consecutive"):
        watch(monitor, replace(moved(31, 1), consecutive=False))


def test_records_say_all(monitor: Monitor):
    seen = watch(monitor, moved(31, 1, PUSH))
    record = monitor_record(monitor, [("log.csv", seen)])
    assert "no safety function" in record["notice"]
    assert "NaN" not in to_json(record) and "Infinity" not in to_json(record)
    assert len(record["recordings"][0]["alarms"]) == len(seen.alarms) > 0
    names, *rows = monitor_table(seen, monitor.run.robot.joint_names).splitlines()
    assert names.startswith("t,tau_ext1,") and len(rows) == len(seen.parts[0].time)
    over = np.array([row.split(",")[-3:] for row in rows], dtype=float)
    assert over.any(axis=1).sum() >= PUSH.seconds * RATE * 0.5

"""Virtual arms with servos: MuJoCo and armid's own roll-out agree, effects do what they say, and seeds repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import LabError
from armid.excitation.command_motion import CommandMotion, command_ranges, load_commands, random_commands
from armid.lab.servos.options import servo_lab_options
from armid.lab.servos.simulation import servo_findings, servo_truth_record, simulate_servo
from armid.lab.servos.virtual_arms import VIRTUAL_ARMS, description_of, known_servo_arm, options_for
from armid.model.terms import Coulomb, Viscous
from armid.robot import load_robot
from armid.servo.closed_loop import simulate
from armid.servo.parameters import ServoParameters, make_servo_model
from armid.servo.servo_run import servo_runs

pytest.importorskip("mujoco")

UNIFORM = 0.29
"""Standard deviation of a rounded value, over the step: 1 / √12."""

INTEGRATION = 1e-4
"""Difference of two integrators of the closed loop, MuJoCo with leapfrog at 2 kHz and armid's midpoint rule [rad]."""


def arm_of(name: str, table=None):
    robot = load_robot(description_of(name))
    options = options_for(robot, table)
    return robot, options, known_servo_arm(robot, options)


def simulated(name: str, table=None, seconds: float = 6.0, seed: int = 1):
    robot, options, arm = arm_of(name, table)
    commands = random_commands(robot, seconds, options.sensing.rate, np.random.default_rng(seed))
    return simulate_servo(arm, commands, options, seed=seed)


def true_parameters(model, arm) -> ServoParameters:
    friction = {"FV": arm.arm.friction.viscous, "FS": arm.arm.friction.coulomb}
    return ServoParameters(
        arm.arm.inertial,
        arm.arm.rotor,
        np.array([friction[law.symbol][law.joint] for law in model.laws]),
        arm.stiffness,
        arm.damping,
        arm.limit,
        arm.offset,
        arm.delay,
    )


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
def test_both_engines_agree_on_the_motion_of_the_truth(name):
    done = simulated(name)
    model = make_servo_model(done.robot, [Viscous(), Coulomb(0.0)])
    (run,) = servo_runs(done.recording)
    (again,) = simulate(model, true_parameters(model, done.truth), [run])
    after = round(1.0 / run.step)
    difference = np.sqrt(np.mean((again.q - run.q)[after:] ** 2, axis=0))
    step = done.options.sensing.position.resolution
    assert difference.max() < UNIFORM * step * 1.1 + INTEGRATION
    assert np.abs(done.recording.q - done.recording.command).max() > 20 * step  # the servos are soft


def test_the_log_has_commands_and_no_torque():
    recording = simulated("hobby-arm", seconds=3.0).recording
    assert recording.effort is None and recording.dq is None
    assert recording.command is not None and recording.command.shape == recording.q.shape == (150, 6)
    step = 2.0 * np.pi / 4096
    assert np.abs(recording.q / step - np.round(recording.q / step)).max() < 1e-6


def test_a_seed_gives_the_same_log_and_jitter_moves_the_clock():
    one, same, other = (simulated("stand-leg", seconds=2.0, seed=seed).recording for seed in (3, 3, 4))
    assert np.array_equal(one.q, same.q) and one.sha256 == same.sha256 != other.sha256
    steps = np.diff(one.time)
    assert 0.0 < np.std(steps) < 4e-4  # twice the variance of the jitter of 0.1 ms


def test_a_longer_delay_only_shifts_the_motion():
    still = {"sensing": {"jitter": 0.0, "position": {"resolution": 0.0}}}
    early, late = (simulated("hobby-arm", {**still, "servo": {"delay": delay}}, 4.0) for delay in (0.0, 0.04))
    assert np.abs(late.recording.q[2:] - early.recording.q[:-2]).max() < 1e-9  # 0.04 s are two samples


def test_a_saturated_servo_keeps_to_its_limit_and_is_told():
    done = simulated("hobby-arm", {"servo": {"limit": 0.4}}, seconds=3.0)
    assert np.abs(done.trace.effort).max() == 0.4
    assert {finding.code for finding in servo_findings(done)} == {"drive-saturated"}
    assert servo_findings(simulated("hobby-arm", seconds=3.0)) == ()


def test_backlash_lets_the_link_move_by_the_play_at_most():
    play = 0.02
    table = {"arm": {"backlash": [play] * 6}, "link_deviation": 0.0}
    done = simulated("hobby-arm", table, seconds=4.0)
    trace, gear = done.trace, done.truth.arm
    assert trace.drive_q is not None and gear.stiffness is not None
    slack = np.abs(trace.drive_q - trace.q)
    wound = 1.5 * np.abs(trace.transmitted).max(axis=0) / gear.stiffness
    assert (slack.max(axis=0) <= 0.5 * play + wound).all()
    assert (np.ptp(trace.drive_q - trace.q, axis=0)[[0, 1]] > 0.5 * play).all()  # joints that turn back use it


def test_stiction_beyond_the_model_changes_the_motion():
    plain, sticky = (simulated("hobby-arm", {"arm": {"effects": each}}, 4.0) for each in ([], ["stribeck", "load"]))
    extra = sticky.truth.arm.friction.stribeck.extra / sticky.truth.stiffness
    assert np.abs(plain.trace.q - sticky.trace.q).max() > extra.max()


def test_the_truth_is_recorded_in_the_usual_form():
    done = simulated("stand-leg", seconds=2.0)
    record = servo_truth_record(done, "00")
    assert record["parameters"]["FS_3"] == pytest.approx(0.24) and record["parameters"]["IA_1"] == pytest.approx(
        0.011
    )
    assert list(record["servo"]["stiffness"]) == [25.0, 25.0, 25.0] and record["recording_sha256"] == "00"
    masses = [done.robot.links[i].inertial.mass for i in range(3)]
    assert record["parameters"]["M_3"] != pytest.approx(masses[2], rel=1e-3)  # links deviate from the description


def test_any_arm_with_masses_gets_servos_that_hold_it():
    robot = load_robot("ur5e")
    options = options_for(robot)
    arm = known_servo_arm(robot, options)
    commands = random_commands(robot, 2.0, 50.0, np.random.default_rng(0))
    done = simulate_servo(arm, commands, options)
    error = np.abs(done.recording.command - done.recording.q)
    assert 1e-3 < error.max() < 0.5


def test_random_commands_keep_the_limits():
    robot = load_robot("ur5e")
    low, high, speed = command_ranges(robot)
    for seed in range(20):
        motion = random_commands(robot, 10.0, 100.0, np.random.default_rng(seed))
        assert (motion.command >= low).all() and (motion.command <= high).all()
        assert (np.abs(np.diff(motion.command, axis=0)) * 100.0 <= speed * (1.0 + 1e-9)).all()


def test_commands_are_read_as_written(tmp_path):
    motion = random_commands(load_robot("ur5e"), 2.0, 50.0, np.random.default_rng(1))
    (tmp_path / "commands.csv").write_text(motion.csv())
    again = load_commands(tmp_path / "commands.csv")
    assert again.rate == motion.rate and np.array_equal(again.command, motion.command)


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ({"servo": {"stiffness": 0.0}}, "stiffness"),
        ({"servo": {"stifness": 1.0}}, "stifness"),
        ({"servo": {"delay": [0.1, 0.2]}}, "delay"),
        ({"link_deviation": 2.0}, "link_deviation"),
        ({"repetitions": 0}, "repetitions"),
        ({"arm": {"backlash": [-0.1] * 6}}, "acklash"),
    ],
)
def test_wrong_options_are_named(table, word):
    with pytest.raises(LabError, match=word):
        arm_of("hobby-arm", table)


def test_commands_of_another_arm_are_refused():
    _, options, arm = arm_of("stand-leg")
    with pytest.raises(LabError, match="6 joints"):
        simulate_servo(arm, CommandMotion(50.0, np.zeros((50, 6))), options)


def test_tables_are_merged_key_by_key():
    options = servo_lab_options({"sensing": {"rate": 200.0, "jitter": 1e-4}}, {"sensing": {"rate": 100.0}})
    assert options.sensing.rate == 100.0 and options.sensing.jitter == 1e-4 and options.sensing.side == "link"
    assert replace(options).sensing.position.resolution == pytest.approx(2.0 * np.pi / 4096)

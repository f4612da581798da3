"""Faults of logs with commands, made from logs of virtual arms; nothing is said about sound ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armid.doctor import CHECKS
from armid.excitation.command_motion import random_commands
from armid.lab.servos.simulation import simulate_servo
from armid.lab.servos.virtual_arms import VIRTUAL_ARMS, description_of, known_servo_arm, options_for
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import load_robot
from armid.study.diagnosis import diagnose_recording

pytest.importorskip("mujoco")

SECONDS = 20.0

LATE = 0.02
"""Error of a lag that is estimated from coarse encoders and soft servos [s]."""


@cache
def log(name: str, seed: int = 1, **servo: float) -> Recording:
    """Log of a virtual arm, with other servos if values are given."""
    robot = load_robot(description_of(name))
    options = options_for(robot, {"servo": servo})
    commands = random_commands(robot, SECONDS, options.sensing.rate, np.random.default_rng(seed))
    recording = simulate_servo(known_servo_arm(robot, options), commands, options, seed=seed).recording
    n = recording.n
    names = {"q": tuple(f"q{j + 1}" for j in range(n)), "command": tuple(f"command{j + 1}" for j in range(n))}
    return replace(recording, joint_names=(), columns=names)


def told(name: str, recording: Recording) -> dict[str, str]:
    """Evidence by code, without the information that there is no torque."""
    found = diagnose_recording(load_robot(description_of(name)), recording, LogFormat())
    return {each.code: f"{each.channel}: {each.evidence} {each.remedy}" for each in found if each.severity != "info"}


def with_columns(recording: Recording, **columns) -> Recording:
    """Recording with other commands or positions of single joints: `command_1=…`."""
    changed = {name: getattr(recording, name).copy() for name in ("q", "command")}
    for key, values in columns.items():
        name, joint = key.rsplit("_", 1)
        changed[name][:, int(joint)] = values
    return replace(recording, **changed)


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_said_about_a_sound_log(name, seed):
    assert told(name, log(name, seed)) == {}


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
def test_exchanged_columns(name):
    sound = log(name)
    found = told(name, replace(sound, q=sound.command, command=sound.q))
    assert list(found) == ["command-exchanged"]
    assert "columns = " in found["command-exchanged"] and 'q = ["command1"' in found["command-exchanged"]


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
@pytest.mark.parametrize(
    ("factor", "words"), [(180 / np.pi, "in degrees"), (100 / 1.2, ""), (-1.0, "other direction")]
)
def test_other_units_or_directions(name, factor, words):
    sound = log(name)
    found = told(name, replace(sound, command=factor * sound.command))
    assert list(found) == ["command-units"] and words in found["command-units"]


def test_normalised_values_of_one_joint():
    sound = log("hobby-arm")
    found = told("hobby-arm", with_columns(sound, command_5=50.0 * sound.command[:, 5]))
    assert list(found) == ["command-units"] and found["command-units"].startswith("grip")


@pytest.mark.parametrize(("name", "order"), [("hobby-arm", (2, 1, 0, 3, 4, 5)), ("stand-leg", (1, 2, 0))])
def test_another_order(name, order):
    sound = log(name)
    found = told(name, replace(sound, command=sound.command[:, list(order)]))
    assert list(found) == ["command-order"]
    back = np.argsort(order)  # columns that must be read in this order
    expected = ", ".join(f'"command{k + 1}"' for k in back)
    assert f"command = [{expected}]" in found["command-order"]


@pytest.mark.parametrize("shift", [0, 1, -2])
def test_a_command_that_was_filled_in_after_the_fact(shift):
    sound = log("hobby-arm")
    found = told("hobby-arm", replace(sound, command=np.roll(sound.q, -shift, axis=0)))
    assert list(found) == ["command-copied"]
    assert ("row" in found["command-copied"].split(",")[1]) == bool(shift) if shift else True


def test_a_constant_command():
    sound = log("stand-leg")
    found = told("stand-leg", with_columns(sound, command_1=0.3))
    assert list(found) == ["command-constant"] and found["command-constant"].startswith("thigh")


def test_a_dead_servo():
    sound = log("hobby-arm")
    found = told("hobby-arm", with_columns(sound, q_3=0.2))
    assert set(found) == {"servo-dead", "standstill"} and "--lock bend" in found["servo-dead"]


def test_a_servo_at_its_end_stop():
    sound = log("hobby-arm")
    end = sound.q[:, 0].max() - 0.45 * np.ptp(sound.q[:, 0])
    found = told("hobby-arm", with_columns(sound, q_0=np.minimum(sound.q[:, 0], end)))
    assert list(found) == ["servo-saturated"] and "pan stops" in found["servo-saturated"]


def test_a_limited_position_error():
    """A program that limits each command to the neighbourhood of the position."""
    sound = log("hobby-arm")
    error = sound.command[:, 1] - sound.q[:, 1]
    bound = 0.4 * np.abs(error).max()
    found = told("hobby-arm", with_columns(sound, command_1=sound.q[:, 1] + np.clip(error, -bound, bound)))
    assert list(found) == ["servo-saturated"] and "it is limited" in found["servo-saturated"]


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
def test_a_large_delay(name):
    delay = 0.3
    sound, late = log(name), log(name, delay=delay)
    found = told(name, late)
    assert list(found) == ["command-delay"] and "[servo]" in found["command-delay"]
    own = float(np.mean(options_for(load_robot(description_of(name))).servo.delay))
    from armid.doctor.command_response import command_response

    lags = [command_response(each, 1.0 / np.median(np.diff(each.time))) for each in (sound, late)]
    shift = np.median(lags[1].lags - lags[0].lags)
    assert shift == pytest.approx(delay - own, abs=LATE)


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
def test_a_delay_that_grows(name):
    """Two clocks: by the end, the commands are logged 0.2 s too early."""
    sound = log(name)
    t = sound.time - sound.time[0]
    early = np.column_stack([np.interp(t + 0.2 * t / t[-1], t, x) for x in sound.command.T])
    found = told(name, replace(sound, command=early))
    assert "command-delay-changes" in found and set(found) <= {"command-delay-changes", "command-delay"}


def test_every_check_of_servos_has_its_effect():
    names = [name for name, check in CHECKS.items() if ".servos." in check.look.__module__]
    assert len(names) == 8
    assert all(CHECKS[name].effects and set(CHECKS[name].untested) == set(CHECKS[name].effects) for name in names)

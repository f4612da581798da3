"""Design of commands: limits are kept, and the search improves on chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.excitation.command_motion import command_ranges, random_commands
from armid.lab.servos.virtual_arms import VIRTUAL_ARMS, description_of
from armid.model.terms import Coulomb, Viscous
from armid.robot import load_robot
from armid.servo.motion_design.search import design_commands, expected_unknowns, judge_commands
from armid.servo.motion_design.shape import GENES, commands_of_shape, mutated
from armid.servo.options import ServoOptions
from armid.servo.parameters import ServoModel, make_servo_model

SECONDS, RATE = 8.0, 50.0


def model_of(name: str, **limits) -> ServoModel:
    robot = load_robot(description_of(name))
    joints = tuple(replace(joint, **limits) for joint in robot.joints)
    return make_servo_model(replace(robot, joints=joints), [Viscous(), Coulomb(0.0)])


@pytest.mark.parametrize("name", VIRTUAL_ARMS)
def test_every_shape_keeps_the_limits(name):
    model, rng = model_of(name, velocity_limit=1.5), np.random.default_rng(1)
    low, high, speed = command_ranges(model.robot)
    genes = rng.uniform(size=(model.n, GENES))
    for _ in range(40):
        motion = commands_of_shape(genes, (low, high, speed), SECONDS, RATE)
        assert (motion.command >= low - 1e-9).all() and (motion.command <= high + 1e-9).all()
        assert (np.abs(np.diff(motion.command, axis=0)) * RATE <= speed * (1.0 + 1e-9)).all()
        genes = mutated(genes, rng)
        assert genes.min() >= 0.0 and genes.max() <= 1.0


def test_a_known_stiffness_is_no_unknown():
    model = model_of("stand-leg")
    open_, given = (
        expected_unknowns(model, options)
        for options in (ServoOptions(), ServoOptions(stiffness=np.full(3, 25.0), damping=np.full(3, 0.8)))
    )
    assert ("stiffness", 0) in open_.names() and ("stiffness", 0) not in given.names()
    assert given.mean.stiffness.tolist() == [25.0, 25.0, 25.0]


def test_motion_shows_what_it_should():
    """Held commands show no rotor inertia; twice the motion in a row shows everything at least as well."""
    model = model_of("stand-leg")
    unknowns = expected_unknowns(model, ServoOptions())
    once = random_commands(model.robot, SECONDS, RATE, np.random.default_rng(2))
    still = replace(once, command=np.repeat(once.command[:1], len(once.command), axis=0))
    prior = dict(zip(unknowns.names(), unknowns.deviation, strict=True))
    held, moving, twice = (judge_commands(unknowns, each) for each in (still, once, once.repeated(2)))
    rotor = ("rotor_inertia", 2)
    assert held.deviations[rotor] > 0.95 * prior[rotor] > 2.0 * moving.deviations[rotor]
    assert all(twice.deviations[name] < 1.02 * value for name, value in moving.deviations.items())
    assert twice.value < moving.value < held.value


def test_the_search_improves_on_random_motion_and_keeps_the_torque():
    model, options = model_of("stand-leg", effort_limit=6.0), ServoOptions()
    found = design_commands(model, options, seconds=SECONDS, rate=RATE, torque_share=0.5, budget=4.0, seed=1)
    unknowns = expected_unknowns(model, options)
    drawn = [
        judge_commands(unknowns, random_commands(model.robot, SECONDS, RATE, np.random.default_rng(seed)))
        for seed in range(5)
    ]
    assert found.value < min(each.value for each in drawn)
    assert found.torque_share.max() <= 0.5
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    assert (found.positions[0] >= limits[:, 0]).all() and (found.positions[1] <= limits[:, 1]).all()
    again = judge_commands(unknowns, found.commands)
    assert again.value == found.value


def test_servos_that_cannot_hold_the_arm_are_refused():
    with pytest.raises(EstimationError, match="largest"):
        design_commands(model_of("hobby-arm", effort_limit=0.01), ServoOptions(), seconds=4.0, budget=0.1)

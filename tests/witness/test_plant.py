"""The plant against dynamics that it does not share a line with: armid's kernel, and what physics keeps."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from armid import kernel
from armid.excitation.fourier import Excitation
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.controller import Controller, Drive
from armid.lab.friction import Friction
from armid.lab.known_arms import EFFECTS, KnownArm, truth_of, with_effects
from armid.lab.plant import Plant, stable_rate, write_mjcf
from armid.lab.simulated_motion import TrueMotion, closed_loop
from armid.robot import load_robot
from armid.robot.robot import InertialParameters
from plants import short_plan, small_arm, smooth_arm
from trees import random_inertial, random_states, random_tree, robot_of

TOLERANCE = 1e-9
"""Relative to the largest torque: rounding of two recursions, and of MuJoCo's principal axes."""


@pytest.mark.parametrize("seed", range(12))
def test_mujoco_asks_for_the_same_torque(seed: int):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, int(rng.integers(1, 8)), branching=0.4)
    inertial = random_inertial(rng, tree.n)
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot_of(tree), inertial))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    at = [int(model.joint(f"joint_{i}").dofadr[0]) for i in range(tree.n)]
    states = random_states(rng, 5, tree.n)
    expected = kernel.inverse_dynamics(tree, inertial, *states)
    for k in range(5):
        for target, values in zip((data.qpos, data.qvel, data.qacc), states, strict=True):
            target[at] = values[k]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse[at], expected[k], atol=TOLERANCE * np.abs(expected).max())


@pytest.mark.parametrize("name", ["iiwa14-r820", "panda", "ur10e"])
def test_mujoco_asks_the_built_in_truths_for_the_same_torque(name: str):
    """Along a motion that uses half of every limit, without friction."""
    truth = truth_of(load_robot(name))
    model = mujoco.MjModel.from_xml_string(write_mjcf(truth.robot, truth.inertial))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    at = [int(model.joint(f"joint_{i}").dofadr[0]) for i in range(truth.robot.n)]
    fastest = np.array([joint.velocity_limit for joint in truth.robot.joints])
    q, dq, ddq = np.random.default_rng(0).uniform(-1.5, 1.5, (3, 20, truth.robot.n)) * [[[1.0]], [[0.5]], [[4.0]]]
    dq *= fastest
    expected = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, q, dq, ddq)
    for k in range(20):
        data.qpos[at], data.qvel[at], data.qacc[at] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(data.qfrc_inverse[at], expected[k], atol=TOLERANCE * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(4))
def test_acceleration_of_the_plant_is_that_of_the_kernel(seed: int):
    """On trees, where MuJoCo's joints stand in another order than the robot's."""
    rng = np.random.default_rng(seed)
    robot = robot_of(random_tree(rng, 6, branching=0.5))
    truth = KnownArm(robot, random_inertial(rng, 6), Friction.none(6), rng.uniform(0.0, 1.0, 6))
    plant = Plant(truth, 1e-3, rng.normal(size=6), np.zeros(6))
    effort = rng.normal(size=6)
    for _ in range(20):
        q, dq = plant.q.copy(), plant.drive_dq.copy()
        ddq = plant.step(effort).ddq
        expected = kernel.inverse_dynamics(robot.tree, truth.inertial, q[None], dq[None], ddq[None])[0]
        expected += truth.rotor * ddq
        np.testing.assert_allclose(expected, effort, atol=TOLERANCE * (1.0 + np.abs(ddq).max()))


def energy(truth: KnownArm, q, dq) -> np.ndarray:
    """Kinetic and potential energy [J] of links and rigid rotors."""
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", dq, kernel.mass_matrix(truth.robot.tree, truth.inertial, q), dq)
    kinetic += 0.5 * (truth.rotor * dq**2).sum(axis=1)
    return kinetic + kernel.potential_energy(truth.robot.tree, truth.inertial, q)


@pytest.mark.parametrize("effects", [None, (), ("rotor", "stribeck", "asymmetric", "load")])
def test_energy_balance_of_a_closed_loop(effects: tuple[str, ...] | None):
    """Drives put in what links have more and what friction takes, to 1e-4 of what went in and out."""
    frictionless = effects is None
    truth = smooth_arm(rotor=np.full(3, 0.1)) if frictionless else with_effects(small_arm(), effects)
    trace, _ = closed_loop(truth, short_plan(period=2.0), Controller(), Drive(), rate=8000.0, lead_in=0.25)
    h = trace.time[1] - trace.time[0]
    power = trace.effort * trace.dq
    dissipated = trace.friction * trace.dq
    gained = energy(truth, trace.q, trace.dq)
    work = h * (power - dissipated).sum(axis=1)
    balance = gained[1:] - gained[0] - np.cumsum(0.5 * (work[1:] + work[:-1]))
    assert np.abs(balance).max() <= 1e-4 * h * np.abs(power).sum()


def test_energy_balance_of_the_iiwa():
    """Part of Table A.1, played eight times as fast, with friction and rotors."""
    truth = with_effects(truth_of(load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))), ["rotor"])
    plan = builtin_plan("thesis-a1")
    slow = Excitation(8.0 * plan.base_frequency, plan.a[:, :1], plan.b[:, :1], plan.offset)
    trace, _ = closed_loop(truth, slow, Controller(), Drive(), rate=8000.0, lead_in=0.25)
    h = trace.time[1] - trace.time[0]
    power = trace.effort * trace.dq
    work = h * (power - trace.friction * trace.dq).sum(axis=1)
    gained = energy(truth, trace.q, trace.dq)
    balance = gained[1:] - gained[0] - np.cumsum(0.5 * (work[1:] + work[:-1]))
    assert np.abs(balance).max() <= 1e-4 * h * np.abs(power).sum()


def test_without_drives_a_swinging_arm_keeps_its_energy():
    truth = smooth_arm()
    plant = Plant(truth, 1e-3 / 4.0, np.array([0.3, 1.2, -0.7]), np.zeros(3))
    q, dq = [], []
    for _ in range(8000):
        q.append(plant.q.copy())
        dq.append(plant.step(np.zeros(3)).dq)
    total = energy(truth, np.array(q), np.array(dq))
    kinetic = energy(truth, np.array(q), np.array(dq)) - energy(truth, np.array(q), np.zeros((8000, 3)))
    assert kinetic.max() > 5.0
    assert np.abs(total - total[0]).max() <= 1e-4 * kinetic.max()


def test_stiff_gears_move_as_rigid_ones():
    rigid = small_arm(rotor=np.full(3, 0.2))
    elastic = replace(rigid, stiffness=np.full(3, 3e5), spring_damping=np.full(3, 30.0))
    traces = [
        closed_loop(t, short_plan(period=1.5), Controller(), Drive(), rate=8000.0, lead_in=0.25)[0]
        for t in (rigid, elastic)
    ]
    np.testing.assert_allclose(traces[1].q, traces[0].q, atol=1e-3)
    assert np.abs(traces[1].q - traces[0].q).max() > 1e-6
    drive_q = traces[1].drive_q
    assert drive_q is not None
    wound = 3e5 * (drive_q - traces[1].q)
    # The spring's torque is what the link feels, but for its damper.
    np.testing.assert_allclose(wound, traces[1].transmitted, atol=0.02 * np.abs(wound).max() + 30.0 * 0.01)


@pytest.mark.parametrize("name", ["iiwa14-r820", "panda", "ur10e"])
def test_built_in_truths_are_bodies_that_follow_their_plan(name: str):
    robot = load_robot(name)
    truth = truth_of(robot)
    assert all(InertialParameters.from_vector(link).is_consistent() for link in truth.inertial)
    middle = np.clip(np.mean([joint.position_limits for joint in robot.joints], axis=1), -3.0, 3.0)
    a, b = np.random.default_rng(0).normal(0.0, 0.2, (2, robot.n, 2))
    plan = Excitation(2 * np.pi / 1.0, a, b, middle, name)
    trace, _ = closed_loop(truth, plan, Controller(), Drive(), rate=4000.0, lead_in=0.25)
    # Feedback errs by at most what friction deflects it: Coulomb and viscous friction over the gains, and margin.
    assert np.abs(trace.q - plan.at(trace.time).q)[1000:].max() < 0.05


def test_every_effect_changes_the_motion():
    plan, plain = short_plan().stretched(6.0), small_arm()

    def moved(truth: KnownArm) -> TrueMotion:
        """Its first second."""
        brief = Excitation(2.0 * np.pi, plan.a[:, :1], plan.b[:, :1], plan.offset)
        rate = max(2000.0, 500.0 * np.ceil(stable_rate(truth, plan.at([0.0]).q) / 500.0 + 1.0))
        return closed_loop(truth, brief, Controller(), Drive(), rate=rate, lead_in=0.1)[0]

    base = moved(plain)
    for name in EFFECTS:
        changed = moved(with_effects(plain, [name]))
        assert np.isfinite(changed.effort).all()
        assert abs(np.abs(changed.effort).mean() - np.abs(base.effort).mean()) > 1e-5, name

"""Virtual arms with servos, and recordings of their commands and positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.model.terms import Coulomb, Viscous
from armid.robot.robot import Frame, InertialParameters, Joint, Link, Robot
from armid.servo.closed_loop import simulate
from armid.servo.parameters import ServoModel, ServoParameters, make_servo_model
from armid.servo.servo_run import ServoRun

RATE = 50.0
"""Sample rate of command and position [Hz]."""

BITS = 12
"""Bits of the encoders, per turn."""


def small_arm() -> Robot:
    """Hobby arm with an upright pan joint, which gravity does not load, and two joints that it does."""
    axes, heights = ([0, 0, 1], [0, 1, 0], [0, 1, 0]), ([0, 0, 0.05], [0, 0, 0.06], [0.12, 0, 0])
    joints, links = [], []
    for k, (axis, origin) in enumerate(zip(axes, heights, strict=True)):
        pose = np.eye(4)
        pose[:3, 3] = origin
        joints.append(Joint(f"joint_{k + 1}", "revolute", k - 1, axis, pose, (-3.0, 3.0), 5.0, np.inf))
        body = InertialParameters.from_com(0.15, [0.05 * k, 0.0, 0.02], 2e-4 * np.eye(3))
        links.append(Link(f"link_{k + 1}", body))
    return Robot("small arm", joints, links, Frame("tip", 2, np.eye(4)), (0.0, 0.0, -9.81))


def servo_model(robot: Robot) -> ServoModel:
    return make_servo_model(robot, [Viscous(), Coulomb(0.0)])


def unlike(bodies: Array, rng: np.random.Generator) -> Array:
    """Inertial parameters (n, 10) of possible links that differ from `bodies` by about 10 %, with medians at them.

    A factor with independent entries would make links 4 % heavier on average, as the squares of its entries add up.
    """
    factors = np.tile(np.eye(4), (len(bodies), 1, 1))
    lengths = np.ones((len(bodies), 4))
    for i in range(4):
        for j in range(i + 1):
            change = 0.1 * rng.normal(size=len(bodies))
            if i == j:
                lengths[:, i] = np.exp(change)
            else:
                factors[:, i, j] = change
    factors *= (lengths / np.linalg.norm(factors, axis=2))[:, :, None]
    moved = np.linalg.cholesky(pseudo_inertia(bodies) + 1e-12 * np.eye(4)) @ factors
    return vector_from_pseudo_inertia(moved @ np.swapaxes(moved, 1, 2))


def any_parameters(model: ServoModel, rng: np.random.Generator) -> ServoParameters:
    """Servos of hobby arms, and links that differ from the description by about 10 %."""
    n, bodies = model.n, model.robot.inertial_vector
    assert bodies is not None
    stiffness = np.exp(rng.uniform(np.log(8.0), np.log(40.0), n))
    shares = {"FV": np.exp(rng.uniform(-4.6, -2.8, n)), "FS": np.exp(rng.uniform(-6.2, -3.9, n))}
    return ServoParameters(
        unlike(bodies, rng),
        np.exp(rng.uniform(np.log(0.005), np.log(0.04), n)),
        np.array([stiffness[law.joint] * shares[law.symbol][law.joint] for law in model.laws]),
        stiffness,
        np.zeros(n),
        np.full(n, np.inf),
        rng.normal(0.0, 0.01, n),
        np.full(n, rng.uniform(0.0, 0.02)),
    )


def recorded(
    model: ServoModel, parameters: ServoParameters, rng: np.random.Generator, seconds: float, *, bits: int = BITS
) -> ServoRun:
    """Run of a motion of five frequencies, integrated with steps of 0.5 ms and read by encoders."""
    samples = round(seconds * RATE)
    t = np.arange(samples) / RATE
    command = rng.uniform(-0.4, 0.4, (1, model.n)) + np.zeros((samples, model.n))
    for _ in range(5):
        f, phase = rng.uniform(0.05, 0.8, model.n), rng.uniform(0.0, 6.0, model.n)
        command += (
            rng.uniform(0.05, 0.35, model.n) * np.minimum(1.0, 0.5 / f) * np.sin(2 * np.pi * f * t[:, None] + phase)
        )
    still = ServoRun(1.0 / RATE, 0.0, np.repeat(command[:1], samples, axis=0), np.zeros(model.n), t, command)
    (found,) = simulate(replace(model, longest_step=5e-4), parameters, [still])
    return replace(still, q=read(found.q, bits)).part(25, samples)


def read(q: Array, bits: int = BITS) -> Array:
    """Positions as the encoders read them."""
    step = 2.0 * np.pi / 2**bits
    return np.round(q / step) * step

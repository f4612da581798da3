"""The truth's friction: each part by itself, and a joint that sticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid import kernel
from armid.errors import LabError
from armid.lab.friction import Friction, MaxwellSlip, StribeckEffect, ToothRipple, Warmth, friction_along
from armid.lab.known_arms import EFFECTS, KnownArm, truth_of, with_effects
from armid.lab.plant import Instant, Plant
from armid.model.motion import Motion
from armid.robot import load_robot
from labs import small_model
from plants import small_arm

ONE = np.ones(1)


def swing(amplitude: float = 1.0, samples: int = 400) -> Motion:
    """A joint that goes to and fro once in 4 s."""
    t = np.arange(samples) * 4.0 / samples
    w = np.pi / 2.0
    q, dq = amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
    return Motion(t, q[:, None], dq[:, None], (-(w**2) * q)[:, None])


def along(friction: Friction, motion: Motion, load: float = 0.0) -> np.ndarray:
    return friction_along(friction, motion, np.full_like(motion.q, load))[0][:, 0]


def test_plain_friction():
    motion = swing()
    dq = motion.dq[:, 0]
    np.testing.assert_allclose(along(Friction(2.0 * ONE, 3.0 * ONE), motion), 2.0 * dq + 3.0 * np.sign(dq))


def test_parts_are_what_the_terms_say():
    """Each part is the law of the term of its name, with the same numbers."""
    motion = swing()
    dq, forward = motion.dq[:, 0], np.sign(motion.dq[:, 0])
    plain = Friction(0.0 * ONE, 3.0 * ONE)
    extra = {
        "offset": (replace(plain, offset=0.7 * ONE), 0.7),
        "asymmetric": (replace(plain, asymmetry=-0.5 * ONE), -0.5 * np.abs(forward)),
        "load": (replace(plain, load=0.1 * ONE), 0.1 * 20.0 * forward),
        "stribeck": (
            replace(plain, stribeck=StribeckEffect(2.0 * ONE, 0.3 * ONE)),
            2.0 * np.exp(-((dq / 0.3) ** 2)) * forward,
        ),
        "ripple": (
            replace(plain, ripple=ToothRipple(0.4 * ONE, 50.0 * ONE, 0.2 * ONE)),
            0.4 * np.sin(50.0 * motion.q[:, 0] + 0.2),
        ),
    }
    for name, (friction, law) in extra.items():
        np.testing.assert_allclose(along(friction, motion, -20.0), 3.0 * forward + law, atol=1e-12, err_msg=name)


def test_hysteresis_goes_over_two_deflections():
    slip = MaxwellSlip(2.0 * ONE[None], 0.01 * ONE[None])
    motion = swing(samples=40_000)
    torque = along(Friction(0.0 * ONE, 0.0 * ONE, slip=slip), motion)
    q = motion.q[:, 0]
    top = int(q.argmax())
    assert torque[top] == pytest.approx(2.0)
    back = top + int(np.argmax(torque[top:] <= -2.0 + 1e-9))
    assert q[top] - q[back] == pytest.approx(0.02, abs=1e-4)
    assert np.abs(torque).max() <= 2.0 + 1e-12


def test_warmth_thins_the_grease_and_cools_down():
    warmth = Warmth(0.05 * ONE, 0.5 * ONE, 10.0 * ONE, 0.0 * ONE)
    friction = Friction(4.0 * ONE, 1.0 * ONE, warmth=warmth)
    motion = swing(samples=4000)
    torque, rise = friction_along(friction, motion, np.zeros_like(motion.q))
    assert rise is not None and rise[0] == 0.0 and rise[-1] > 1.0
    dq = motion.dq
    np.testing.assert_allclose(torque, np.sign(dq) + 4.0 * np.exp(-0.05 * rise) * dq, rtol=1e-12)
    # Heat is the work of friction; little of it has gone by cooling.
    work = 0.001 * np.cumsum(torque * dq)
    assert rise[-1, 0] < 0.5 * work[-1] < 1.5 * rise[-1, 0]
    cooled = warmth.next(np.array([10.0]), np.array([0.0]), 1.0)
    assert cooled[0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Friction(-ONE, ONE),
        lambda: Friction(ONE, np.ones(2)),
        lambda: Friction(ONE, ONE, asymmetry=2.0 * ONE),
        lambda: Friction(ONE, ONE, load=-ONE),
        lambda: Friction(ONE, ONE, stribeck=StribeckEffect(np.ones(2), np.ones(2))),
        lambda: StribeckEffect(ONE, 0.0 * ONE),
        lambda: MaxwellSlip(ONE[None], 0.0 * ONE[None]),
        lambda: Warmth(ONE, ONE, 0.0 * ONE, ONE),
        lambda: with_effects(small_arm(), ["magic"]),
        lambda: small_arm(stiffness=np.full(3, 1e4)),
        lambda: small_arm(rotor=-np.ones(3)),
        lambda: truth_of(load_robot("panda", locked=["panda_joint7"])),
    ],
)
def test_what_cannot_be_is_refused(wrong):
    with pytest.raises(LabError):
        wrong()


def held(torque: float, steps: int = 400) -> Instant:
    """The last instant of the first joint of the small arm, whose gravity does not turn it, pushed from rest."""
    truth, rest = small_arm(), np.zeros((1, 3))
    effort = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, rest, rest, rest)[0]
    effort[0] += torque
    plant = Plant(truth, 1e-3, rest[0], effort)
    return [plant.step(effort) for _ in range(steps)][-1]


def test_a_joint_sticks_until_friction_gives_way():
    """Coulomb friction of the first joint is 0.8 N·m."""
    assert held(0.79).q[0] == 0.0 and held(-0.79).q[0] == 0.0
    assert held(0.81).q[0] > 1e-5 and held(-0.81).q[0] < -1e-5
    assert held(0.5).friction[0] == pytest.approx(0.5)


def test_effects_leave_what_they_do_not_name():
    truth = small_arm()
    for name in EFFECTS:
        changed = with_effects(truth, [name])
        np.testing.assert_array_equal(changed.friction.viscous, truth.friction.viscous)
        np.testing.assert_array_equal(changed.inertial, truth.inertial)
    slip = with_effects(truth, ["hysteresis"]).friction
    assert slip.slip is not None
    np.testing.assert_allclose(slip.coulomb + slip.slip.torque.sum(axis=0), truth.friction.coulomb)


def test_an_arm_without_numbers_of_its_own_gets_friction_from_its_limits():
    robot = small_model().robot
    truth = truth_of(robot)
    assert isinstance(truth, KnownArm)
    np.testing.assert_allclose(truth.friction.coulomb, [3.2, 3.2, 3.2])  # a 25th of 80 N·m
    built_in = truth_of(load_robot("iiwa14-r820"))
    assert (built_in.friction.viscous[0], built_in.friction.coulomb[6]) == (28.404, 3.030)

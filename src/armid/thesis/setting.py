"""Inputs of all chapters of the study: models of the hanging arm with both signs of gravity, and true parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.excitation.fourier import Excitation
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot

HANGING, LITERAL = (0.0, 0.0, 9.81), (0.0, 0.0, -9.81)
"""Acceleration of gravity in the base frame of the hanging arm [m/s²], and its opposite, which the thesis prints."""

PERIOD, DESIGNED = 27.0, 20.0
"""Period with which the arm executed the motion of Table A.1 of the thesis, and period for which this motion was
designed [s]."""

Tell = Callable[[str, float], None]
"""Callback with the name of a part of the study and the share of the whole study that is done, from 0 to 1."""


@dataclass(frozen=True, slots=True)
class Extent:
    """Extent of a run of the study.

    Attributes:
        seeds: Number of seeds of the noise, over which medians are taken.
        starts: Number of random starts of Algorithm 2.
        stages: Number of stages of each descent, from a smoothed to the exact criterion.
        rate: Sample rate of recordings along the exact motion [Hz]; the noise density does not depend on it.
        lab_rate: Sample rate of closed-loop recordings [Hz].
        physics_rate: Step rate of the closed-loop simulation [Hz].
        repetitions: Number of repetitions in each closed-loop recording.
        searches: Number of random starts of the nonlinear program, equation (3.52) of the thesis.
        poses: Number of random poses and states at which identities are checked.
    """

    seeds: int = 10
    starts: int = 6
    stages: int = 6
    rate: float = 8000.0
    lab_rate: float = 1000.0
    physics_rate: float = 4000.0
    repetitions: int = 2
    searches: int = 2
    poses: int = 200


QUICK = Extent(
    seeds=2, starts=1, stages=3, rate=1000.0, lab_rate=500.0, physics_rate=2000.0, repetitions=1, searches=1, poses=50
)
"""Smallest extent with which all chapters have results."""


def extent_of(*, quick: bool = False, seeds: int | None = None, starts: int | None = None) -> Extent:
    """Extent of the whole or of a quick study.

    Args:
        quick: True for the quick study.
        seeds: Number of seeds of the noise, instead of the usual number.
        starts: Number of random starts of Algorithm 2, instead of the usual number.
    """
    extent = QUICK if quick else Extent()
    return replace(extent, seeds=seeds or extent.seeds, starts=starts or extent.starts)


@dataclass(frozen=True, eq=False, slots=True)
class ReferenceModel:
    """Model of the arm with one of the two signs of gravity.

    Attributes:
        dynamics: Model with rigid bodies, viscous friction, and Coulomb friction of width zero.
        base: The 57 base parameters of equation (3.38) of the thesis.
    """

    dynamics: DynamicsModel
    base: BaseParameters

    def theta(self, values: Array) -> Array:
        """Standard parameters (p,) that give the same torque as base parameters (b,).

        A standard parameter whose column is not kept is zero.
        """
        theta = np.zeros(len(self.dynamics.parameters))
        theta[self.base.kept] = values
        return theta

    def columns(self, motion: Motion) -> Array:
        """Regressor Y_b of the base parameters along a motion, shape (N, 7, 57)."""
        return self.dynamics.regressor(motion)[:, :, self.base.kept]


@dataclass(frozen=True, eq=False, slots=True)
class Setting:
    """Inputs that all chapters of the study share.

    Attributes:
        hanging: Model of the hanging arm.
        literal: Model with the sign of gravity that equations (2.21) and (2.33) print.
        theta: True standard parameters of the virtual arm, shape (p,): bodies of the description, friction of Table
            4.1.
        truth: True base parameters of the virtual arm, shape (57,).
        train: Motion of Table A.1 of the thesis, slowed down to a period of 27 s.
        unseen: Motion of Table A.2 of the thesis, slowed down to a period of 27 s.
        extent: Extent of the run.
    """

    hanging: ReferenceModel
    literal: ReferenceModel
    theta: Array
    truth: Array
    train: Excitation
    unseen: Excitation
    extent: Extent


def _model(gravity: tuple[float, float, float]) -> ReferenceModel:
    robot = load_robot("iiwa14-r820", gravity=gravity)
    dynamics = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.0)))
    return ReferenceModel(dynamics, find_base_parameters(dynamics))


def make_setting(extent: Extent) -> Setting:
    """Makes the inputs of the study: models, true parameters and motions of the arm."""
    hanging, literal = _model(HANGING), _model(LITERAL)
    theta = thesis_truth(hanging.dynamics)
    return Setting(
        hanging,
        literal,
        theta,
        hanging.base.values_of(theta),
        builtin_plan("thesis-a1").stretched(PERIOD),
        builtin_plan("thesis-a2").stretched(PERIOD),
        extent,
    )


def random_states(setting: Setting, seed: int) -> Motion:
    """Random states: positions within the joint limits, velocities up to 2 rad/s, accelerations up to 5 rad/s²."""
    rng, joints = np.random.default_rng(seed), setting.hanging.dynamics.robot.joints
    low, high = np.array([joint.position_limits for joint in joints]).T
    shape = (setting.extent.poses, len(joints))
    q = rng.uniform(low, high, shape)
    return Motion.of_states(q, rng.uniform(-2.0, 2.0, shape), rng.uniform(-5.0, 5.0, shape))

"""Joint controllers and drives of a simulated arm in closed loop.

Every controller adds a feed-forward torque along the planned motion to a linear feedback of position and velocity of
the drive: τ = feed-forward(t) + KP e + KD ė + KI ∫e. The controllers differ only in the feed-forward torque:

- computed-torque: inverse dynamics of a nominal model along the plan, without friction;
- pd-gravity: gravity torque of the nominal model along the plan;
- pid: none; the integral part compensates gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import LabError, did_you_mean
from armid.lab.known_arms import UNKNOWN_EFFORT, KnownArm
from armid.model.motion import Motion

CONTROLLERS = ("computed-torque", "pd-gravity", "pid")
"""Kinds of controllers, the values of the key `kind` of the table [controller] of a `lab.toml`."""

SLOWER = 0.25
"""Largest product of the angular natural frequency of the position loop and the delay of this loop [rad]. The delay
is the sum of the sample time and the time constant of the current loop."""


@dataclass(frozen=True, slots=True)
class Controller:
    """Joint controller.

    Attributes:
        kind: One of `CONTROLLERS`.
        compliance: Position error at which the feedback commands the full effort of the joint [rad or m]. The
            compliance determines the gains, unless a joint is so light that the loop would be too fast for the
            sampling rate.
        damping: Damping ratio of the loop for the mean inertia of the joint.
        integral: KI divided by KP [1/s]; `None` stands for 2 if `kind` is `pid`, otherwise for 0.
        rate: Sampling rate [Hz]; 0 for sampling in every step of the simulation.
        model_scale: Torque of the nominal model divided by the torque of the true model.
        friction: Share of the viscous and Coulomb friction that the feed-forward torque contains.
    """

    kind: Literal["computed-torque", "pd-gravity", "pid"] = "computed-torque"
    compliance: float = 0.03
    damping: float = 0.8
    integral: float | None = None
    rate: float = 0.0
    model_scale: float = 1.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in CONTROLLERS:
            raise LabError(
                f"Unknown controller {self.kind!r}.",
                possible=", ".join(CONTROLLERS),
                remedy=did_you_mean(self.kind, CONTROLLERS),
            )
        good = self.compliance > 0.0 and self.damping > 0.0 and self.rate >= 0.0 and (self.integral or 0.0) >= 0.0
        if not good:
            raise LabError(
                "For a controller, `compliance` and `damping` must be positive, `rate` and `integral` not negative; "
                f"found {self.compliance}, {self.damping}, {self.rate} and {self.integral}.",
                remedy="correct these values in the table [controller].",
            )


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive: delay and saturation between the commanded and the actual torque.

    Attributes:
        bandwidth: Corner frequency of the first-order current loop [Hz]; 0 for a loop without delay.
        saturation: Largest torque divided by the effort limit of the joint; 0 for no saturation.
    """

    bandwidth: float = 0.0
    saturation: float = 1.0

    def __post_init__(self) -> None:
        if not (self.bandwidth >= 0.0 and self.saturation >= 0.0):
            raise LabError(
                "For a drive, `bandwidth` and `saturation` must not be negative; found "
                f"{self.bandwidth} and {self.saturation}.",
                remedy="correct these values in the table [drive].",
            )

    def limits(self, truth: KnownArm) -> Array:
        """Largest torque that the drive of each joint gives, shape (n,) [N·m or N]; infinite without saturation."""
        return (self.saturation or np.inf) * np.array([joint.effort_limit for joint in truth.robot.joints])


@dataclass(frozen=True, eq=False, slots=True)
class ControllerGains:
    """Feedback gains of each joint.

    Attributes:
        proportional: KP, shape (n,) [N·m/rad or N/m].
        derivative: KD, shape (n,) [N·m·s/rad or N·s/m].
        integral: KI, shape (n,) [N·m/(rad·s) or N/(m·s)].
    """

    proportional: Array
    derivative: Array
    integral: Array


def gains(controller: Controller, drive: Drive, truth: KnownArm, motion: Motion, step: float) -> ControllerGains:
    """Feedback gains that are suitable for an arm along a motion.

    Args:
        controller: The controller.
        drive: The drive; its current loop limits the gains.
        truth: The simulated arm.
        motion: Motion along which the mean inertias of the joints are computed, which determine the gains.
        step: Sample time of the controller [s].
    """
    mass = kernel.mass_matrix(truth.robot.tree, truth.inertial, some_poses(motion.q))
    mass = mass + np.diag(truth.rotor)
    inertia = np.einsum("njj->nj", mass).mean(axis=0)
    # Where other joints yield, a joint acts with less than its inertia; this mode must not be too fast for the
    # sampling.
    lightest = 1.0 / np.einsum("njj->nj", np.linalg.inv(mass)).max(axis=0)
    limits = np.array([joint.effort_limit for joint in truth.robot.joints])
    wanted = np.where(np.isfinite(limits), limits, UNKNOWN_EFFORT) / controller.compliance
    fastest = SLOWER / (step + (1.0 / (2.0 * math.pi * drive.bandwidth) if drive.bandwidth else 0.0))
    kp = np.minimum(wanted, lightest * fastest**2)
    kd = 2.0 * controller.damping * np.minimum(np.sqrt(kp * inertia), lightest * fastest)
    ki = controller.integral if controller.integral is not None else 2.0 * (controller.kind == "pid")
    return ControllerGains(kp, kd, ki * kp)


def some_poses(q: Array, count: int = 100) -> Array:
    """Selects about `count` evenly spaced samples of the positions (N, n) of a motion."""
    return q[:: max(1, len(q) // count)]


def feedforward(controller: Controller, truth: KnownArm, motion: Motion) -> Array:
    """Feed-forward torque (N, n) [N·m or N] along the planned motion."""
    if controller.kind == "pid":
        torque = np.zeros_like(motion.q)
    else:
        dynamic = float(controller.kind == "computed-torque")
        dq, ddq = dynamic * motion.dq, dynamic * motion.ddq
        torque = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, motion.q, dq, ddq) + truth.rotor * ddq
        torque *= controller.model_scale
    if controller.friction:
        known = truth.friction
        torque += controller.friction * (known.viscous * motion.dq + known.coulomb * np.sign(motion.dq))
    return torque

"""Joint controllers and drives of the closed loop.

Every controller adds a feed-forward along the planned motion to linear feedback of the drive's position and velocity,
τ = feed-forward(t) + KP e + KD ė + KI ∫e. They differ in the feed-forward alone:

- computed-torque: inverse dynamics of a nominal model along the plan, without friction;
- pd-gravity: gravity torque of the nominal model along the plan;
- pid: none; the integral part holds the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid import kernel
from armid.errors import LabError, did_you_mean
from armid.lab.known_arms import KnownArm
from armid.model.motion import Motion
from armid.values import Array

CONTROLLERS = ("computed-torque", "pd-gravity", "pid")
"""Kinds of controllers."""

UNKNOWN_EFFORT = 100.0
"""Effort limit [N·m or N] where none is known."""

SLOWER = 0.25
"""Largest natural frequency of the loop, in radians per sample or over the corner of the current loop."""


@dataclass(frozen=True, slots=True)
class Controller:
    """Joint controller.

    Attributes:
        kind: One of `CONTROLLERS`.
        compliance: Position error at which feedback commands the joint's full effort [rad or m]. The gains follow
            from it, except for joints so light that the loop would be faster than its sampling allows.
        damping: Damping ratio of the loop with the mean inertia of the joint.
        integral: KI over KP [1/s]; `None` is 0, and 2 for `pid`.
        rate: Sampling rate [Hz]; 0 for every step of the simulation.
        model_scale: Ratio of its nominal model to the true one.
        friction: Share of viscous and Coulomb friction in the feed-forward along the plan.
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
            raise LabError("A controller's compliance and damping must be positive, rate and integral not negative.")


@dataclass(frozen=True, slots=True)
class Drive:
    """Dynamics and limits between commanded and actual torque.

    Attributes:
        bandwidth: Corner frequency of the first-order current loop [Hz]; 0 for an ideal one.
        saturation: Largest torque over the joint's effort limit; 0 for no saturation.
    """

    bandwidth: float = 0.0
    saturation: float = 1.0

    def __post_init__(self) -> None:
        if not (self.bandwidth >= 0.0 and self.saturation >= 0.0):
            raise LabError("A drive's bandwidth and saturation must not be negative.")

    def limits(self, truth: KnownArm) -> Array:
        """Largest torque of each joint (n,) [N·m or N]."""
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
    """Feedback gains that suit an arm along a motion.

    Args:
        controller: The controller.
        drive: The drive, whose current loop limits the gains.
        truth: The arm.
        motion: Motion whose mean inertias determine the gains.
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
    """About a given number of evenly spaced positions (N, n) of a motion."""
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

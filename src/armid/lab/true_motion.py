"""True motion of a simulation: every quantity at every step, without sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid import kernel
from armid.errors import LabError
from armid.excitation.fourier import Excitation
from armid.lab.controller import Controller, ControllerGains, Drive, feedforward, gains
from armid.lab.friction import friction_along
from armid.lab.known_arms import KnownArm
from armid.lab.plant import Plant
from armid.model.motion import Motion
from armid.values import Array

__all__ = ["MARGIN", "TrueMotion", "closed_loop", "inverse_dynamics"]

MARGIN = 0.25
"""Time before the recording that is simulated for delays and causal filters [s]."""

WHOLE = 1e-6
"""Part of a step by which a period may miss a whole number of steps; the motion then repeats exactly."""

PROGRESS_INTERVAL = 2000
"""Steps from one word of progress to the next."""

Tell = Callable[[float], None]


@dataclass(frozen=True, eq=False, slots=True)
class TrueMotion:
    """True motion at N instants; the recording begins at time 0.

    Attributes:
        time: Shape (N,) [s].
        q: Positions of the joints, shape (N, n) [rad or m].
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        effort: Torque of the drives, on the joint side, shape (N, n) [N·m or N].
        friction: Friction, shape (N, n) [N·m or N].
        transmitted: Torque that the links feel, shape (N, n) [N·m or N].
        drive_q: Positions of elastic drives, shape (N, n); `None` for rigid ones.
        drive_dq: Their velocities, shape (N, n).
        rise: Temperature rise, shape (N, n) [K], where there is one.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    effort: Array
    friction: Array
    transmitted: Array
    drive_q: Array | None = None
    drive_dq: Array | None = None
    rise: Array | None = None

    def from_time(self, start: float) -> TrueMotion:
        """Motion from a time on [s]."""
        first = int(np.searchsorted(self.time, start - 1e-9))
        parts = {name: getattr(self, name) for name in self.__slots__}
        return replace(self, **{name: None if x is None else x[first:] for name, x in parts.items()})


def inverse_dynamics(truth: KnownArm, plan: Excitation, rate: float, repetitions: int) -> TrueMotion:
    """Motion of an arm that follows its plan exactly, with torque by inverse dynamics.

    Args:
        truth: The arm; its drives must be rigid.
        plan: The motion.
        rate: Instants a second [Hz].
        repetitions: How often the motion is run through.

    Raises:
        LabError: The truth is elastic, so that drive and link move differently.
    """
    if truth.stiffness is not None:
        raise LabError("Inverse dynamics knows no elastic drives.", remedy="simulate in closed loop.")
    first = -round(MARGIN * rate)
    motion = plan.at(np.arange(first, round(repetitions * plan.period * rate)) / rate)
    robot = truth.robot
    transmitted = kernel.inverse_dynamics(robot.tree, truth.inertial, motion.q, motion.dq, motion.ddq)
    friction, rise = friction_along(truth.friction, motion, transmitted)
    effort = transmitted + friction + truth.rotor * motion.ddq
    return TrueMotion(motion.time, motion.q, motion.dq, motion.ddq, effort, friction, transmitted, rise=rise)


def closed_loop(
    truth: KnownArm,
    plan: Excitation,
    controller: Controller,
    drive: Drive,
    *,
    rate: float,
    repetitions: int = 1,
    lead_in: float = 2.0,
    tell: Tell | None = None,
) -> tuple[TrueMotion, ControllerGains]:
    """Motion of an arm that a controller moves along a plan, from rest through a smooth lead-in.

    During the lead-in the reference goes from rest in the plan's first pose over to the plan, which runs on the same
    clock; the motion is in step with the plan from time 0 on.

    Args:
        truth: The arm.
        plan: The motion.
        controller: What asks for torque.
        drive: What gives it.
        rate: Steps a second [Hz].
        repetitions: How often the motion is run through.
        lead_in: Time from rest to the plan [s].
        tell: Told the share that is done.

    Returns:
        What happened, from `MARGIN` before time 0 on, and the controller's gains.

    Raises:
        LabError: It ran away, or the step is too long.
    """
    h = 1.0 / rate
    every = max(1, round(rate / controller.rate)) if controller.rate else 1
    lead, steps = round(lead_in * rate), round(repetitions * plan.period * rate)
    before = _lead_in(plan, lead, h)
    period = plan.period * rate
    repeats = abs(period - round(period)) < WHOLE
    along = plan.at(np.arange(round(period) if repeats else steps) * h)
    gain = gains(controller, drive, truth, along, every * h)
    references = [_reference(controller, truth, motion) for motion in (before, along)]
    run = _Run(truth, h, gain, drive, every, references[0] if lead else references[1], controller.kind == "pid")
    kept = min(lead, round(MARGIN * rate))
    run.keep(kept + steps)
    run.go(references[0], lead, keep=kept)
    while run.row < kept + steps:
        run.go(references[1], min(along.samples, kept + steps - run.row), keep=along.samples, tell=tell)
    return run.trace(h * np.arange(-kept, steps, dtype=np.float64)), gain


def _lead_in(plan: Excitation, steps: int, h: float) -> Motion:
    """Reference from rest in the plan's first pose to the plan, C² at both ends: p + w(t) (plan(t) - p)."""
    along = plan.at(np.arange(-steps, 0) * h)
    if not steps:
        return along
    start = plan.at([0.0]).q[0]
    s = (np.arange(steps) / steps)[:, None]
    rate = 1.0 / (steps * h)
    w = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    dw = 30.0 * s**2 * (1.0 - s) ** 2 * rate
    ddw = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) * rate**2
    off = along.q - start
    return Motion(
        along.time,
        start + w * off,
        w * along.dq + dw * off,
        w * along.ddq + 2.0 * dw * along.dq + ddw * off,
    )


Reference = tuple[Array, Array, Array]


def _reference(controller: Controller, truth: KnownArm, motion: Motion) -> Reference:
    """Positions, velocities and torques that the controller follows, shape (N, n) each."""
    if not motion.samples:
        return motion.q, motion.dq, motion.q
    torque = feedforward(controller, truth, motion)
    if truth.stiffness is None:
        return motion.q, motion.dq, torque
    wound = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, motion.q, motion.dq, motion.ddq)
    return motion.q + wound / truth.stiffness, motion.dq, torque  # drives are ahead by what the gears give


class _Run:
    """Plant with its controller and the stored motion."""

    def __init__(
        self,
        truth: KnownArm,
        h: float,
        gain: ControllerGains,
        drive: Drive,
        every: int,
        first: Reference,
        integrates: bool,
    ) -> None:
        start = first[0][0] if truth.stiffness is None else None
        rest = np.zeros((1, truth.robot.n))
        q = first[0][:1]
        holding = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, q, rest, rest)[0]
        if start is None:
            q = q - holding / truth.stiffness
        self.plant = Plant(truth, h, q[0], holding)
        self.gain, self.every, self.h = gain, every, h
        self.limits = drive.limits(truth)
        self.share = 1.0 - np.exp(-2.0 * np.pi * drive.bandwidth * h) if drive.bandwidth else 1.0
        self.effort = holding
        # What feedback has integrated so far; a controller without a model holds the arm by it.
        self.held = holding.copy() if integrates else np.zeros(truth.robot.n)
        self.integrates = bool(gain.integral.any())
        self.row = 0

    def keep(self, rows: int) -> None:
        """Allocates memory for a number of instants."""
        plant = self.plant
        names = ["q", "dq", "ddq", "effort", "friction", "drive_ddq"]
        names += ["drive_q", "drive_dq"] if plant.elastic else []
        names += ["rise"] if plant.rise is not None else []
        self.kept = {name: np.empty((rows, plant.n)) for name in names}

    def go(self, reference: Reference, steps: int, *, keep: int, tell: Tell | None = None) -> None:
        """Follows a reference for a number of steps and stores the last of them."""
        plant, gain, limits, share = self.plant, self.gain, self.limits, self.share
        kp, kd, ki = gain.proportional, gain.derivative, gain.integral * (self.every * self.h)
        lowest, highest = -limits, limits
        bounded = bool(np.isfinite(limits).any())
        wanted = self.effort
        for k in range(steps):
            if k % self.every == 0:
                error = reference[0][k] - plant.drive_q
                wanted = reference[2][k] + kp * error + kd * (reference[1][k] - plant.drive_dq)
                wanted += self.held
                if bounded:
                    free = wanted
                    wanted = np.minimum(np.maximum(wanted, lowest), highest)
                    if self.integrates:
                        self.held += np.where(free == wanted, ki * error, 0.0)  # no wind-up
                elif self.integrates:
                    self.held += ki * error
            self.effort = wanted if share == 1.0 else self.effort + share * (wanted - self.effort)
            if k < steps - keep:
                plant.step(self.effort)
            else:
                self._kept_step()
            if tell is not None and k % PROGRESS_INTERVAL == 0:
                tell(self.row / len(self.kept["q"]))

    def _kept_step(self) -> None:
        plant, kept, row = self.plant, self.kept, self.row
        kept["q"][row] = plant.q
        if plant.elastic:
            kept["drive_q"][row] = plant.drive_q
        if plant.rise is not None:
            kept["rise"][row] = plant.rise
        plant.step(self.effort)
        kept["dq"][row] = plant.at_dq
        kept["ddq"][row] = plant.at_ddq
        kept["effort"][row] = self.effort
        kept["friction"][row] = plant.at_friction
        if plant.elastic:
            kept["drive_dq"][row] = plant.at_drive_dq
        kept["drive_ddq"][row] = plant.at_drive_ddq
        self.row += 1

    def trace(self, time: Array) -> TrueMotion:
        """Stored motion."""
        kept = self.kept
        transmitted = kept["effort"] - kept["friction"] - self.plant.truth.rotor * kept.pop("drive_ddq")
        return TrueMotion(time, **kept, transmitted=transmitted)

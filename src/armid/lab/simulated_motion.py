"""True motion of a simulated arm: all quantities at every simulation step, before sensors measure them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import LabError
from armid.excitation.fourier import Excitation
from armid.input_boundary import within
from armid.lab.controller import Controller, ControllerGains, Drive, feedforward, gains
from armid.lab.friction import friction_along
from armid.lab.known_arms import KnownArm
from armid.lab.plant import Plant
from armid.lab.pushes import Push, external_torque
from armid.model.motion import Motion

MARGIN = 0.25
"""Time before the recording that is simulated, because delays and causal filters need it [s]."""

WHOLE = 1e-6
"""Largest difference of the period from a whole number of steps, as a fraction of a step, with which the samples of
one period are repeated."""

PROGRESS_INTERVAL = 2000
"""Number of steps between two calls of the progress callback."""

Tell = Callable[[float], None]


@dataclass(frozen=True, eq=False, slots=True)
class TrueMotion:
    """True motion at N instants; the recording begins at the time 0.

    Attributes:
        time: Time of each instant, shape (N,) [s].
        q: Positions of the joints, shape (N, n) [rad or m].
        dq: Velocities of the joints, shape (N, n) [rad/s or m/s].
        ddq: Accelerations of the joints, shape (N, n) [rad/s² or m/s²].
        effort: Torque of the drives, on the joint side, shape (N, n) [N·m or N].
        friction: Friction, shape (N, n) [N·m or N].
        transmitted: Torque that the gears transmit to the links, shape (N, n) [N·m or N].
        drive_q: Positions of elastic drives, on the joint side, shape (N, n) [rad or m]; `None` for rigid drives.
        drive_dq: Velocities of elastic drives, shape (N, n) [rad/s or m/s]; `None` for rigid drives.
        rise: Temperature rise, shape (N, n) [K]; `None` if the friction has no warm-up.
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
        """The motion from the time `start` [s] on; earlier instants are left out."""
        first = int(np.searchsorted(self.time, start - 1e-9))
        parts = {name: getattr(self, name) for name in self.__slots__}
        return replace(self, **{name: None if x is None else x[first:] for name, x in parts.items()})


def inverse_dynamics(
    truth: KnownArm, plan: Excitation, rate: float, repetitions: int, pushes: Sequence[Push] = ()
) -> TrueMotion:
    """True motion of an arm that follows its plan exactly; the torque is computed by inverse dynamics.

    Args:
        truth: The arm; its drives must be rigid.
        plan: The planned motion.
        rate: Number of instants per second [Hz].
        repetitions: Number of repetitions of the motion.
        pushes: External torques, which do not change the motion.

    Raises:
        LabError: The drives are elastic, so that drive and link move differently.
    """
    if truth.stiffness is not None:
        raise LabError(
            "The mode inverse-dynamics cannot simulate elastic drives.",
            remedy="use the mode closed-loop, or leave out the stiffness and the effect 'elastic'.",
        )
    _check_steps(repetitions * plan.period, rate)
    first = -round(MARGIN * rate)
    motion = plan.at(np.arange(first, round(repetitions * plan.period * rate)) / rate)
    robot = truth.robot
    transmitted = kernel.inverse_dynamics(robot.tree, truth.inertial, motion.q, motion.dq, motion.ddq)
    external = external_torque(pushes, robot.n, motion.time)
    if external is not None:
        transmitted = transmitted - external
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
    pushes: Sequence[Push] = (),
    tell: Tell | None = None,
) -> tuple[TrueMotion, ControllerGains]:
    """True motion of an arm that a controller moves along a plan; the arm begins at rest with a smooth lead-in.

    In the lead-in, which ends at time 0, the reference changes smoothly from rest in the first pose of the plan to
    the motion of the plan. From time 0 on the reference is the plan.

    Args:
        truth: The arm.
        plan: The planned motion.
        controller: Controller of the joints.
        drive: Dynamics and limits of the drives.
        rate: Number of steps per second [Hz].
        repetitions: Number of repetitions of the motion.
        lead_in: Duration of the lead-in [s].
        pushes: External torques.
        tell: Callback with the share of the simulation that is done.

    Returns:
        Motion that begins `MARGIN` before the time 0, and the gains of the controller.

    Raises:
        LabError: The simulation became unstable, or the step is too long.
    """
    _check_steps(lead_in + repetitions * plan.period, rate)
    h = 1.0 / rate
    every = max(1, round(rate / controller.rate)) if controller.rate else 1
    lead, steps = round(lead_in * rate), round(repetitions * plan.period * rate)
    before = _lead_in(plan, lead, h)
    period = plan.period * rate
    repeats = abs(period - round(period)) < WHOLE
    along = plan.at(np.arange(round(period) if repeats else steps) * h)
    gain = gains(controller, drive, truth, along, every * h)
    references = [_reference(controller, truth, motion) for motion in (before, along)]
    q, holding = _equilibrium(truth, references[0 if lead else 1][0][:1])
    actuation = _Actuation(controller, gain, drive, truth, holding, h, every)
    kept = min(lead, round(MARGIN * rate))
    time = h * np.arange(-kept, steps, dtype=np.float64)
    external = external_torque(pushes, truth.robot.n, time)
    run = _Run(Plant(truth, h, q, holding), actuation, kept + steps, external)
    run.follow(references[0], lead, keep=kept)
    while run.row < kept + steps:
        run.follow(references[1], min(along.samples, kept + steps - run.row), keep=along.samples, tell=tell)
    return run.trace(time), gain


def _check_steps(seconds: float, rate: float) -> None:
    """Raises an error if a simulation would have fewer than two steps, or more than the limit `motion`."""
    if not seconds * rate >= 2.0:
        raise LabError(
            f"The motion takes {seconds:.4g} s, which is less than two steps at {rate:.4g} Hz.",
            remedy="correct the plan, or raise the rate.",
        )
    within("motion", seconds * rate, f"The simulation of {seconds:.4g} s at {rate:.4g} Hz", LabError)


def _lead_in(plan: Excitation, steps: int, h: float) -> Motion:
    """Reference motion p + w(t) (plan(t) - p) from rest in the first pose p of the plan into the plan.

    The weight w rises from 0 to 1, with first and second derivatives that are zero at both ends.
    """
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
    """Reference positions, velocities and feed-forward torques for the controller, shape (N, n) each."""
    if not motion.samples:
        return motion.q, motion.dq, motion.q
    torque = feedforward(controller, truth, motion)
    if truth.stiffness is None:
        return motion.q, motion.dq, torque
    wound = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, motion.q, motion.dq, motion.ddq)
    return motion.q + truth.deflection(wound), motion.dq, torque  # drives lead by the deflection of the gears


def _equilibrium(truth: KnownArm, drive_q: Array) -> tuple[Array, Array]:
    """Joint positions at rest, shape (n,), for drive positions (1, n), and torques (n,) that hold the arm there."""
    rest = np.zeros_like(drive_q)
    holding = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, drive_q, rest, rest)[0]
    return drive_q[0] - truth.deflection(holding), holding


class _Actuation:
    """Controller and drives of a simulated arm, with the commanded torque and the actual torque of the drives."""

    def __init__(
        self,
        controller: Controller,
        gain: ControllerGains,
        drive: Drive,
        truth: KnownArm,
        holding: Array,
        step: float,
        every: int,
    ) -> None:
        self.gain, self.every = gain, every
        self.lower, self.upper = -drive.limits(truth), drive.limits(truth)
        self.share = 1.0 - np.exp(-2.0 * np.pi * drive.bandwidth * step) if drive.bandwidth else 1.0
        self.commanded = self.effort = holding
        # The integral holds the arm where the controller has no model.
        self.integral = holding if controller.kind == "pid" else np.zeros_like(holding)
        self.increment = gain.integral * (every * step) if gain.integral.any() else None

    def update(self, k: int, reference: Reference, plant: Plant) -> Array:
        """Torque (n,) [N·m or N] of the drives in simulation step k of a reference motion."""
        if k % self.every == 0:
            error = reference[0][k] - plant.drive_q
            torque = reference[2][k] + self.gain.proportional * error
            torque += self.gain.derivative * (reference[1][k] - plant.drive_dq)
            torque += self.integral
            self.commanded = np.minimum(np.maximum(torque, self.lower), self.upper)
            if self.increment is not None:  # without wind-up
                self.integral = self.integral + np.where(torque == self.commanded, self.increment * error, 0.0)
        lag = self.share != 1.0
        self.effort = self.effort + self.share * (self.commanded - self.effort) if lag else self.commanded
        return self.effort


class _Run:
    """Simulated arm with its controller, and the motion that is stored step by step."""

    def __init__(self, plant: Plant, actuation: _Actuation, rows: int, external: Array | None = None) -> None:
        self.plant, self.actuation, self.row, self.external = plant, actuation, 0, external
        names = ["q", "dq", "ddq", "effort", "friction"]
        names += ["drive_q", "drive_dq", "drive_ddq"] if plant.truth.stiffness is not None else []
        names += ["rise"] if plant.truth.friction.warmth is not None else []
        self.stored = {name: np.empty((rows, plant.truth.robot.n)) for name in names}

    def follow(self, reference: Reference, steps: int, *, keep: int, tell: Tell | None = None) -> None:
        """Moves the arm along a reference for a number of simulation steps, and stores the last `keep` steps."""
        for k in range(steps):
            stored = k >= steps - keep
            external = self.external[self.row] if stored and self.external is not None else None
            instant = self.plant.step(self.actuation.update(k, reference, self.plant), external)
            if stored:
                for name, values in self.stored.items():
                    values[self.row] = getattr(instant, name)
                self.row += 1
            if tell is not None and k % PROGRESS_INTERVAL == 0:
                tell(self.row / len(self.stored["q"]))

    def trace(self, time: Array) -> TrueMotion:
        """True motion from the stored quantities, for the times (N,) [s] of the stored steps."""
        stored = self.stored
        acceleration = stored.pop("drive_ddq", stored["ddq"])
        transmitted = stored["effort"] - stored["friction"] - self.plant.truth.rotor * acceleration
        return TrueMotion(time, **stored, transmitted=transmitted)

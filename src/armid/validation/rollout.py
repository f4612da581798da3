"""Rollout of a model: forward simulation of windows of a recording, from the initial state and the recorded torque.

The equations of motion with the mass matrix M and the bias torque of the model are integrated by leapfrog,

    (M + h/2 D) a = τ - bias(q, v̂) - rest(v̂) - dry,   v(k+1/2) = v(k-1/2) + h a,   q(k+1) = q(k) + h v(k+1/2)

for many windows of a recording at once. Here h is the time step, a the acceleration, τ the recorded torque, k the
number of the step, and v̂ the velocity at step k, extrapolated from step k - 1/2. `rest` is friction without dry
friction; the diagonal matrix D is the derivative of `rest` by the velocity. `dry` is the torque of dry friction, with
which a joint sticks or slides (`armid.maths.stiction`). For the estimation, the sign function of dry friction may be
smoothed over a width; here this width is set to zero.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.maths.stiction import solve_stiction
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms.term import smooths_sign
from armid.model.torque_law_expression import symbols

LEAST_RATE = 1000.0
"""Smallest rate of the integration steps [Hz]. The error of leapfrog decreases with the square of the rate. The
frequencies of the modes of arms are far below a tenth of this rate."""

STABLE = 0.8
"""Largest product of the integration step [s] and the angular frequency of the feedback [rad/s]; leapfrog is stable
below 2."""

REST = 1e-9
"""Small velocity [rad/s or m/s]: dry friction is half the difference of the friction at plus and at minus this
velocity."""

NUDGE = 1e-4
"""Velocity step [rad/s or m/s] of the difference quotient of friction. Friction laws change over velocities that are
at least a hundred times as large."""

RUNAWAY = 100.0
"""Speed of a joint [rad/s or m/s] from which the simulation of a window counts as diverged; joints of arms reach at
most ten."""

CHECK_EVERY = 50
"""Number of integration steps between two checks of the mass matrix."""


@dataclass(frozen=True, eq=False, slots=True)
class Feedback:
    """Linear feedback KP e + KD ė + KI ∫e of a position error e of each joint, by the controller of the recording.

    The reference motion of the controller need not be known. On the recorded motion, the controller gave the recorded
    torque. On another motion it gives the recorded torque plus the feedback of e, the recorded motion minus the other
    motion.

    Attributes:
        proportional: KP, shape (n,) [N·m/rad or N/m].
        derivative: KD, shape (n,) [N·m·s/rad or N·s/m].
        integral: KI, shape (n,) [N·m/(rad·s) or N/(m·s)].
    """

    proportional: Array
    derivative: Array
    integral: Array

    def __post_init__(self) -> None:
        kp = array(self.proportional, (None,), "proportional")
        object.__setattr__(self, "proportional", kp)
        object.__setattr__(self, "derivative", array(self.derivative, kp.shape, "derivative"))
        object.__setattr__(self, "integral", array(self.integral, kp.shape, "integral"))
        if any((gain < 0.0).any() for gain in (kp, self.derivative, self.integral)):
            raise ArmidError(
                "The gains of the feedback must not be negative.",
                remedy="give gains of 0 or more; the unit is N·m or N per unit of the position error.",
            )


@dataclass(frozen=True, eq=False, slots=True)
class Windows:
    """Windows of a recording: W segments of S samples, with a sample time of `step` seconds.

    Attributes:
        q: Positions, shape (W, S, n) [rad or m].
        dq: Velocities, shape (W, S, n) [rad/s or m/s].
        ddq: Accelerations, shape (W, S, n) [rad/s² or m/s²].
        torque: Joint torque, shape (W, S, n) [N·m or N].
        memory: Hysteresis states at the first sample of each window, shape (W, m).
        step: Sample time [s].
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array
    memory: Array
    step: float


def sharpened(model: DynamicsModel) -> DynamicsModel:
    """Model with the same parameters, in which exact sign functions replace smoothed ones in friction laws."""
    terms: list[Any] = list(model.terms)
    sharp = [dataclasses.replace(term, width=0.0) if smooths_sign(term) else term for term in terms]
    return dataclasses.replace(model, terms=tuple(sharp))


@dataclass(frozen=True, eq=False, slots=True)
class RolledOut:
    """Simulated motion in W windows of a recording, of S samples each.

    All values are NaN after the sample at which the simulation of a window ended early.

    Attributes:
        q: Positions, shape (W, S, n) [rad or m].
        dq: Velocities, shape (W, S, n) [rad/s or m/s].
        torque: Torque that acted on the joints, shape (W, S, n) [N·m or N]: the recorded torque, plus the feedback
            if there is one.
        ran_away: Mask of windows that diverged: a joint reached the speed `RUNAWAY`, shape (W,).
        indefinite: Mask of windows that ended early because the mass matrix was not positive definite, shape (W,).
    """

    q: Array
    dq: Array
    torque: Array
    ran_away: NDArray[np.bool_]
    indefinite: NDArray[np.bool_]

    @property
    def stayed(self) -> NDArray[np.bool_]:
        """Mask of windows that were simulated to their end, shape (W,)."""
        return ~(self.ran_away | self.indefinite)


def roll_out(
    model: DynamicsModel, parameters: Array, windows: Windows, feedback: Feedback | None = None
) -> RolledOut:
    """Simulates the motion in windows from their initial states with the recorded torque.

    Args:
        model: Arm and torque terms.
        parameters: Standard parameters, or other values that give the same torque, shape (p,).
        windows: Recorded motion and torque.
        feedback: Feedback of the controller of the recording; if not given, only the recorded torque acts.
    """
    run = _Rollout(_Dynamics(sharpened(model), parameters), windows, feedback)
    q, dq, torque = np.full((3, *windows.q.shape), np.nan)
    for k in range(windows.q.shape[1]):
        if k:
            run.advance(k - 1)
        at, control = run.alive, run.control(k * run.substeps)
        q[at, k], dq[at, k], torque[at, k] = run.state.q[at], control.dq[at], control.torque[at]
    # A window that is lost in the very last step still has all its samples.
    alive = np.isfinite(q).all(axis=(1, 2))
    return RolledOut(q, dq, torque, ~alive & ~run.indefinite, ~alive & run.indefinite)


class _State(NamedTuple):
    """State of all windows at one instant.

    Attributes:
        q: Positions, shape (W, n) [rad or m].
        half: Velocities half an integration step earlier, shape (W, n) [rad/s or m/s].
        ddq: Accelerations one integration step earlier, shape (W, n) [rad/s² or m/s²].
        memory: Hysteresis states, shape (W, m).
        integral: Time integral of the position error of the feedback, shape (W, n) [rad·s or m·s].
    """

    q: Array
    half: Array
    ddq: Array
    memory: Array
    integral: Array


class _Control(NamedTuple):
    """Velocities and torque of all windows at one instant.

    Attributes:
        dq: Velocities, extrapolated by half an integration step, shape (W, n) [rad/s or m/s].
        torque: Torque that acts on the joints, shape (W, n) [N·m or N].
        integral: Time integral of the position error of the feedback, shape (W, n) [rad·s or m·s].
    """

    dq: Array
    torque: Array
    integral: Array


class _Rollout:
    """Integration of the motion in all windows of a recording, step by step."""

    def __init__(self, dynamics: _Dynamics, windows: Windows, feedback: Feedback | None) -> None:
        self.dynamics, self.windows, self.feedback = dynamics, windows, feedback
        self.alive, self.indefinite = np.ones(len(windows.q), dtype=bool), np.zeros(len(windows.q), dtype=bool)
        q, ddq = windows.q[:, 0], windows.ddq[:, 0]
        mass = dynamics.mass(q)
        self._check_definite(mass)
        self.substeps = self._substeps(mass)
        half = windows.dq[:, 0] - 0.5 * (windows.step / self.substeps) * ddq
        self.state = _State(q, half, ddq, windows.memory, np.zeros_like(q))

    def _substeps(self, mass: Array) -> int:
        """Number of integration steps from one sample to the next, from the mass matrices (W, n, n) at the start."""
        rate = LEAST_RATE
        if self.feedback is not None and self.alive.any():
            mobility = np.einsum("wjj->wj", np.linalg.inv(mass[self.alive]))
            rate = max(rate, math.sqrt(float((self.feedback.proportional * mobility).max())) / STABLE)
        return max(1, math.ceil(rate * self.windows.step * (1.0 - 1e-9)))

    def _check_definite(self, mass: Array) -> None:
        """Ends the simulation of each window whose mass matrix is not positive definite; `mass` is (W, n, n)."""
        positive = np.linalg.eigvalsh(mass)[:, 0] > 0.0
        self.indefinite |= self.alive & ~positive
        self.alive &= positive

    def advance(self, k: int) -> None:
        """Integrates the motion in all windows from sample k to sample k + 1."""
        for step in range(k * self.substeps, (k + 1) * self.substeps):
            self._step(step)

    def _recorded(self, values: Array, step: int) -> Array:
        """Interpolates recorded values (W, S, n) between two samples to an integration step; shape (W, n)."""
        k, share = step // self.substeps, step % self.substeps / self.substeps
        return values[:, k] if share == 0.0 else (1.0 - share) * values[:, k] + share * values[:, k + 1]

    def control(self, step: int) -> _Control:
        """Velocities and torque of all windows at an integration step.

        The torque is the recorded torque, plus the torque of the feedback if there is one.
        """
        state, gain, h = self.state, self.feedback, self.windows.step / self.substeps
        torque = self._recorded(self.windows.torque, step)
        dq = state.half + 0.5 * h * state.ddq
        if gain is None:
            return _Control(dq, torque, state.integral)
        error = self._recorded(self.windows.q, step) - state.q
        rate = self._recorded(self.windows.dq, step) - dq
        integral = state.integral + h * error
        torque = torque + gain.proportional * error + gain.derivative * rate + gain.integral * integral
        return _Control(dq, torque, integral)

    def _step(self, step: int) -> None:
        dynamics, state = self.dynamics, self.state
        h = self.windows.step / self.substeps
        dq, torque, integral = self.control(step)
        rest, slope, dry = dynamics.friction(state.q, dq, state.ddq, state.memory)
        linear = slope if self.feedback is None else slope + self.feedback.derivative
        mass = dynamics.mass(state.q)
        if step % CHECK_EVERY == 0:
            self._check_definite(mass)
        identity = np.eye(mass.shape[1])
        matrix = mass + 0.5 * h * linear[:, :, None] * identity
        matrix[~self.alive] = identity
        driving = torque - dynamics.bias(state.q, dq) - rest - linear * (state.half - dq)
        mobility = np.asarray(h * np.linalg.inv(matrix), dtype=np.float64)
        free = state.half + (mobility @ driving[:, :, None])[:, :, 0]
        new = solve_stiction(mobility, free, dry, dry)[1] if dry.any() else free
        self.alive &= np.abs(new).max(axis=1) < RUNAWAY
        alive = self.alive[:, None]
        ddq = (np.where(alive, new, state.half) - state.half) / h
        half = np.where(alive, new, 0.0)
        q = state.q + h * half
        self.state = _State(q, half, ddq, dynamics.updated_memory(q, state.memory), integral)


class _Dynamics:
    """Mass matrix, bias torque and friction of a model with given parameters."""

    def __init__(self, model: DynamicsModel, parameters: Array) -> None:
        self.model, self.theta = model, parameters
        self.inertial = parameters[model.inertial_columns].reshape(model.n, 10)
        # Terms proportional to the acceleration are in the mass matrix already.
        self.entries = np.array(
            [
                e
                for e, (_, p, law, _) in enumerate(model.entries)
                if "ddq" not in symbols(law.expression) and parameters[p]
            ],
            dtype=np.int64,
        )
        self.depends_on_load = any("load" in symbols(law.expression) for _, law in model.laws)

    def mass(self, q: Array) -> Array:
        """Mass matrices of links and rotors at positions (W, n), shape (W, n, n) [kg·m² or kg]."""
        return self.model.mass_matrix(q, self.theta)

    def bias(self, q: Array, dq: Array) -> Array:
        """Torque of the rigid bodies at zero acceleration in each of W windows, without friction, shape (W, n)."""
        return kernel.inverse_dynamics(self.model.tree, self.inertial, q, dq, np.zeros_like(q))

    def friction(self, q: Array, dq: Array, ddq: Array, memory: Array) -> tuple[Array, Array, Array]:
        """Friction of each joint in W windows, in three parts of shape (W, n) each.

        Returns:
            Friction without dry friction [N·m or N], its derivative by the velocity, and the largest dry friction
            [N·m or N].
        """
        if not len(self.entries):
            return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)
        small = np.full_like(dq, REST)
        away = np.where(dq < 0.0, -NUDGE, NUDGE)
        up, down, here, beside = np.split(self._torque(q, [small, -small, dq, dq + away], ddq, memory), 4)
        dry = np.maximum(0.5 * (up - down), 0.0)
        rest = here - dry * np.sign(dq)
        # A negative slope is treated explicitly, in the next step: it is small, and implicit it could be unstable.
        slope = np.maximum((beside - here) / away, 0.0)
        return rest, np.where(dq == 0.0, 0.0, slope), dry

    def _torque(self, q: Array, velocities: list[Array], ddq: Array, memory: Array) -> Array:
        """Torque of the friction terms at positions (W, n) for k arrays of velocities (W, n), shape (k W, n)."""
        times = len(velocities)
        many = np.tile(q, (times, 1))
        acceleration = np.tile(ddq, (times, 1)) if self.depends_on_load else np.zeros_like(many)
        states = np.tile(memory, (times, 1)) if self.model.nodes else None
        motion = Motion(
            np.arange(len(many), dtype=np.float64), many, np.concatenate(velocities), acceleration, states
        )
        columns = self.model.term_columns(motion, self.entries)
        torque = np.zeros((self.model.n, len(many)))
        np.add.at(torque, columns.joint, columns.values * self.theta[columns.parameter][:, None])
        return torque.T

    def updated_memory(self, q: Array, memory: Array) -> Array:
        """Hysteresis states (W, m) after the joints have moved to the positions q (W, n)."""
        if not self.model.nodes:
            return memory
        driven = np.stack([sum(w * q[:, j] for j, w in node.coordinate) for node in self.model.nodes], axis=1)
        width = np.array([node.memory.width for node in self.model.nodes])
        return np.minimum(np.maximum(memory, driven - width), driven + width)

"""Simulated arm in MuJoCo, with friction of our own and drives that may be elastic.

MuJoCo says what rigid bodies do: the acceleration of a state under given torques. Friction is a torque of ours, since
MuJoCo's own is a soft constraint, whose sign depends on the acceleration too. Time goes on by leapfrog,

    v(k+1/2) = v(k-1/2) + h a(k),    q(k+1) = q(k) + h v(k+1/2)

which is of second order, keeps energy, asks MuJoCo once a step, and leaves position, acceleration and torque of a
sample belonging to one instant: torque held over a step would lead the motion by half a step. Viscous friction acts
on the mean velocity of the step, through h/2 FV on the diagonal of the mass matrix, so that it is stable at any step.
Dry friction is that of the step's last velocity, whose sign is found together with it (`armid.maths.stiction`).

An elastic drive is a rotor of its own, a hinge at rest in the world, tied to its joint by a spring of MuJoCo's. What
turns the rotor about other axes is neglected [Spong1987].
"""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.errors import LabError, MissingExtraError
from armid.lab.known_arms import KnownArm
from armid.maths.inertia import vector_to_com_inertia
from armid.maths.stiction import solve_stiction
from armid.robot.missing_inertia import inertial_key
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["EXTRA", "Plant", "stable_rate", "write_mjcf"]

EXTRA = "lab"

STABLE = 0.5
"""Largest product of step and angular eigenfrequency: leapfrog is stable below 2 and accurate to 1 % below 0.5."""

ROUNDING = 1e-3
"""Share of the stable rate that may be missing, because only some poses of a plan are checked."""

RUNAWAY = 1e4
"""Speed [rad/s or m/s] at which a simulation counts as unstable; drives reach about ten."""

CHECKED = 256
"""Number of steps between two checks of stability."""


def write_mjcf(robot: Robot, inertial: Array, truth: KnownArm | None = None) -> str:
    """MJCF text of the arm, with numbers in full precision.

    Args:
        robot: Geometry and gravity.
        inertial: Inertial parameters of the links, shape (n, 10).
        truth: Its rotor inertia and elasticity, if any.

    Raises:
        LabError: A link that no real body can be.
    """
    elastic = truth is not None and truth.stiffness is not None
    lines = [
        f'<mujoco model="{_attribute(robot.name)}">',
        '<compiler angle="radian" inertiafromgeom="false" autolimits="false"/>',
        f'<option gravity="{_numbers(robot.gravity)}"/>',
        "<worldbody>",
    ]
    children: dict[int, list[int]] = {}
    for i, joint in enumerate(robot.joints):
        children.setdefault(joint.parent, []).append(i)

    def body(i: int) -> None:
        joint = robot.joints[i]
        placement = joint.placement
        kind = "slide" if joint.is_prismatic else "hinge"
        armature = 0.0 if truth is None or elastic else float(truth.rotor[i])
        lines.append(
            f'<body name="link_{i}" pos="{_numbers(placement[:3, 3])}" '
            f'xyaxes="{_numbers(placement[:3, 0])} {_numbers(placement[:3, 1])}">'
            f'<joint name="joint_{i}" type="{kind}" axis="{_numbers(joint.axis)}" armature="{armature!r}"/>'
        )
        lines.append(_inertial(robot, i, inertial[i]))
        for child in children.get(i, ()):
            body(child)
        lines.append("</body>")

    for root in children.get(-1, ()):
        body(root)
    if elastic and truth is not None:
        lines += [
            f'<body name="rotor_{i}"><joint name="rotor_{i}" type="hinge" axis="0 0 1"/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="{_numbers([inertia] * 3)}"/></body>'
            for i, inertia in enumerate(truth.rotor)
        ]
    lines.append("</worldbody>")
    if elastic and truth is not None:
        lines += ["<tendon>", *_springs(truth), "</tendon>"]
    return "\n".join([*lines, "</mujoco>"])


def _springs(truth: KnownArm) -> list[str]:
    """MJCF springs between each joint and its rotor."""
    assert truth.stiffness is not None
    return [
        f'<fixed name="spring_{i}" springlength="0" stiffness="{k!r}" damping="{d!r}">'
        f'<joint joint="rotor_{i}" coef="1"/><joint joint="joint_{i}" coef="-1"/></fixed>'
        for i, (k, d) in enumerate(zip(truth.stiffness.tolist(), truth.spring_damping.tolist(), strict=True))
    ]


def _inertial(robot: Robot, i: int, vector: Array) -> str:
    """MJCF inertia of a link, which MuJoCo requires to be physically consistent."""
    name = robot.links[i].name
    if not vector[0] > 0.0:
        raise LabError(
            f"Link {name!r}, which {robot.joints[i].name} moves, has a mass of {vector[0]:g} kg; a simulation in "
            "closed loop needs a body on every joint.",
            possible="--mode inverse-dynamics, which needs none on a link that carries others",
            remedy=f"give {inertial_key(robot)} for it; a gram will do for a link that is a mere frame.",
        )
    mass, com, inertia = vector_to_com_inertia(vector)
    moments = np.linalg.eigvalsh(inertia)
    # A triangle inequality that holds with equality, as of a thin rod, may miss by rounding.
    if moments[0] <= 0.0 or moments[2] > moments[0] + moments[1] + 1e-9 * moments[2]:
        raise LabError(
            f"Link {name!r} of {robot.name} has principal moments {', '.join(f'{m:.3g}' for m in moments)} kg·m²; no "
            "real body has these.",
            remedy=f"give an inertia that a body of some extent can have in {inertial_key(robot)}.",
        )
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    full = _numbers([inertia[a, b] for a, b in order])
    return f'<inertial pos="{_numbers(com)}" mass="{float(mass)!r}" fullinertia="{full}"/>'


def _numbers(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def _attribute(text: str) -> str:
    return text.translate({ord(mark): " " for mark in '<>&"'})


def stable_rate(truth: KnownArm, q: Array) -> float:
    """Steps per second [Hz] that springs of gears and friction need at positions q (N, n); 0 without springs."""
    slip = truth.friction.slip
    dry = np.zeros(truth.robot.n) if slip is None else slip.stiffness
    mass = kernel.mass_matrix(truth.robot.tree, truth.inertial, q)
    diagonal = np.eye(truth.robot.n, dtype=bool)
    if truth.stiffness is None:
        mobility, spring = np.linalg.inv(mass + np.where(diagonal, truth.rotor, 0.0)), dry
    else:  # both ends give way
        mobility = np.linalg.inv(mass) + np.where(diagonal, 1.0 / truth.rotor, 0.0)
        spring = truth.stiffness + dry
    root = np.sqrt(spring)
    squared = np.linalg.eigvalsh(root[:, None] * mobility * root)
    return math.sqrt(max(float(squared.max(initial=0.0)), 0.0)) / STABLE


class Plant:
    """Simulated arm that is advanced step by step.

    Between steps `q`, `dq` and `torque` are those of the present instant as far as it is known: `dq` is extrapolated
    from half a step before. After `step` the attributes `at_*` hold the instant that has been passed, complete.

    Args:
        truth: The arm.
        step: h [s].
        q: Positions at the beginning, shape (n,) [rad or m].
        effort: Torque of the drives at the beginning, which elastic drives are wound up by, shape (n,) [N·m or N].

    Raises:
        LabError: The step is too long for what is stiff, or a link is no real body.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, truth: KnownArm, step: float, q: Array, effort: Array) -> None:
        try:
            mujoco: Any = import_module("mujoco")
        except ImportError as error:
            raise MissingExtraError("mujoco", "Simulating an arm", EXTRA) from error
        if 1.0 / step < (1.0 - ROUNDING) * stable_rate(truth, q[None]):
            raise LabError(
                f"A step of {1e6 * step:.0f} µs is too long for the springs of this arm.",
                remedy=f"simulate at {stable_rate(truth, q[None]):.0f} Hz or more.",
            )
        self.truth, self.h, self.n = truth, step, truth.robot.n
        model = mujoco.MjModel.from_xml_string(write_mjcf(truth.robot, truth.inertial, truth))
        flags = mujoco.mjtDisableBit
        model.opt.disableflags |= flags.mjDSBL_CONSTRAINT | flags.mjDSBL_CONTACT | flags.mjDSBL_ACTUATION
        model.opt.timestep = step
        self._model, self._data = model, mujoco.MjData(model)
        self._forward, self._solve = mujoco.mj_forward, mujoco.mj_solveM
        self.links = self._addresses("joint")
        self.elastic = truth.stiffness is not None
        self.drives = self._addresses("rotor") if self.elastic else self.links
        self._armature = model.dof_armature[self.drives].copy()
        self._places = np.arange(model.nv)[self.drives]
        self._everything = np.eye(model.nv)
        self._mobility = np.empty((model.nv, model.nv))
        self._start(q, effort)

    def _addresses(self, kind: str) -> Any:
        """Indices of joints of a kind in MuJoCo's state; a slice where they are in the robot's order."""
        at = [int(self._model.joint(f"{kind}_{i}").dofadr[0]) for i in range(self.n)]
        return slice(at[0], at[0] + self.n) if at == list(range(at[0], at[0] + self.n)) else np.array(at)

    def _start(self, q: Array, effort: Array) -> None:
        """Sets the initial state at rest."""
        truth, model = self.truth, self._model
        self._q, self._half = np.zeros(model.nv), np.zeros(model.nv)
        self._acceleration = np.zeros(model.nv)
        self._q[self.links] = q
        if truth.stiffness is not None:
            self._q[self.drives] = q + effort / truth.stiffness
        self._dq = self._half.copy()
        self._load = np.array(effort, dtype=np.float64)
        friction = truth.friction
        self._signs = np.zeros(self.n)
        self._ends = None if friction.slip is None else np.broadcast_to(q, friction.slip.deflection.shape).copy()
        self.rise = None if friction.warmth is None else friction.warmth.initial
        self._viscous = friction.viscosity(self.rise)
        model.dof_armature[self.drives] = self._armature + 0.5 * self.h * self._viscous
        self._plain, self._asymmetric = friction.is_plain, bool(friction.asymmetry.any())
        self.steps = 0
        self.at_dq = self.at_ddq = self.at_drive_dq = self.at_drive_ddq = self.at_friction = np.zeros(self.n)

    @property
    def q(self) -> Array:
        """Current positions of the joints, shape (n,) [rad or m]."""
        return self._q[self.links]

    @property
    def drive_q(self) -> Array:
        """Current positions of the drives, on the joint side, shape (n,) [rad or m]."""
        return self._q[self.drives]

    @property
    def drive_dq(self) -> Array:
        """Current velocities of the drives, extrapolated over half a step, shape (n,) [rad/s or m/s]."""
        return self._dq[self.drives]

    def step(self, effort: Array) -> None:
        """Advances by one step under torques of the drives (n,) [N·m or N].

        Raises:
            LabError: The simulation has run away.
        """
        data, drives, h = self._data, self.drives, self.h
        half = self._half
        dry, lower, upper, rest = self._friction()
        data.qpos[:] = self._q
        data.qvel[:] = self._dq
        data.qfrc_applied[drives] = effort - rest - self._viscous * half[drives] - dry
        self._forward(self._model, data)
        a = data.qacc.copy()
        new = half + h * a
        turned = new[drives] * self._signs <= 0.0
        if turned.any():
            dry, new = self._reversal(turned, dry, lower, upper, new)
            a = (new - half) / h
            self._signs = np.sign(new[drives])
        mean = 0.5 * (half + new)
        self.at_dq, self.at_drive_dq = mean[self.links], mean[drives]
        self.at_ddq, self.at_drive_ddq = a[self.links], a[drives]
        self.at_friction = rest + dry + self._viscous * self.at_drive_dq
        self._q += h * new
        self._half = new
        self._dq = new + (0.5 * h) * a
        if not self._plain:
            self._remember(effort)
        self.steps += 1
        if self.steps % CHECKED == 0 and not np.abs(new).max() < RUNAWAY:
            raise LabError(
                f"The simulation has run away after {self.steps * h:.3f} s.",
                remedy="lower the controller's bandwidth, or simulate with a shorter step.",
            )

    def _friction(self) -> tuple[Array, Array, Array, Array | float]:
        """Dry friction of sliding joints, its two bounds, and friction that depends on the position."""
        friction, signs = self.truth.friction, self._signs
        if self._plain:
            level = friction.coulomb
            return level * signs, level, level, 0.0
        level = friction.dry(self._dq[self.drives], self._load)
        rest = friction.of_position(self._q[self.drives], self._ends)
        if not self._asymmetric:
            return level * signs, level, level, rest
        lower, upper = level - friction.asymmetry, level + friction.asymmetry
        return np.where(signs > 0.0, upper, -lower) * np.abs(signs), lower, upper, rest

    def _reversal(
        self, turned: NDArray[np.bool_], dry: Array, lower: Array, upper: Array, new: Array
    ) -> tuple[Array, Array]:
        """Dry friction of the drives and velocities of all joints where some drive sticks or reverses."""
        self._solve(self._model, self._data, self._mobility, self._everything)
        columns = self.h * self._mobility[:, self.drives]
        at = turned.nonzero()[0]
        if len(at) == 1:  # nearly always; the others are hardly touched
            j = int(at[0])
            i = int(self._places[j])
            torque = min(max(dry[j] + new[i] / columns[i, j], -lower[j]), upper[j])
            moved = new + columns[:, j] * (dry[j] - torque)
            if -lower[j] < torque < upper[j]:
                moved[i] = 0.0
            still = moved[self.drives] * self._signs > 0.0
            still[j] = True
            if still.all():
                dry = dry.copy()
                dry[j] = torque
                return dry, moved
        free = new + columns @ dry
        coupling, alone = columns[self.drives], free[self.drives]
        found, velocity = solve_stiction(coupling[None], alone[None], lower[None], upper[None])
        torque = found[0]
        new = free - columns @ torque
        new[self._places[velocity[0] == 0.0]] = 0.0
        return torque, new

    def _remember(self, effort: Array) -> None:
        """Updates the states of friction."""
        friction = self.truth.friction
        self._load = effort - self.at_friction - self.truth.rotor * self.at_drive_ddq
        if self._ends is not None:
            here, width = self._q[self.drives], friction.slip.deflection  # pyright: ignore[reportOptionalMemberAccess]
            np.minimum(np.maximum(self._ends, here - width, out=self._ends), here + width, out=self._ends)
        if friction.warmth is not None and self.rise is not None:
            power = np.maximum(self.at_friction * self.at_drive_dq, 0.0)
            self.rise = friction.warmth.next(self.rise, power, self.h)
            self._viscous = friction.viscosity(self.rise)
            self._model.dof_armature[self.drives] = self._armature + 0.5 * self.h * self._viscous

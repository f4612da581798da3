"""Simulated arm in MuJoCo, with the friction model of the lab and drives that may be elastic.

MuJoCo computes the acceleration of the rigid bodies for given torques. Friction is applied as a torque, because
MuJoCo's own friction is a soft constraint, whose sign also depends on the acceleration. The integrator is leapfrog,

    v(k+1/2) = v(k-1/2) + h a(k),    q(k+1) = q(k) + h v(k+1/2)

which is of second order, conserves energy and calls MuJoCo once in each step. Leapfrog gives position, acceleration
and torque of a sample at the same instant. With a torque that is constant over a step, the torque would be half a
step earlier than the motion. Viscous friction acts on the mean velocity of the step: h/2 FV is added to the diagonal
of the mass matrix, which makes the integration of viscous friction stable for any step. Dry friction and the velocity
at the end of the step depend on each other; they are solved together (`armid.maths.stiction`).

An elastic drive is a separate rotor on a hinge that is fixed to the world; a MuJoCo spring connects the rotor to its
joint. Rotations of the rotor about other axes are neglected [Spong1987].
"""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.errors import LabError, MissingExtraError
from armid.lab.friction import FrictionState
from armid.lab.known_arms import KnownArm
from armid.maths.inertia import vector_to_com_inertia
from armid.maths.stiction import solve_stiction
from armid.robot.missing_inertia import inertial_key
from armid.robot.robot import Robot

EXTRA = "lab"

STABLE = 0.5
"""Largest product of step and angular eigenfrequency. Leapfrog is stable if this product is below 2, and accurate to
1 % if it is below 0.5."""

ROUNDING = 1e-3
"""Relative amount by which the step rate may be below the stable rate, because only some poses of a plan are
checked."""

RUNAWAY = 1e4
"""Speed [rad/s or m/s] from which a simulation counts as unstable; real drives reach about ten."""

CHECKED = 256
"""Number of steps between two checks of stability."""


def write_mjcf(robot: Robot, inertial: Array, truth: KnownArm | None = None) -> str:
    """MJCF text of the arm, with numbers in full precision.

    Args:
        robot: Geometry and gravity.
        inertial: Inertial parameters of the links, shape (n, 10).
        truth: Simulated arm with rotor inertia and elasticity; `None` for an arm without rotor inertia and
            elasticity.

    Raises:
        LabError: A link is not physically consistent.
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
    """MJCF elements of the springs between each joint and its rotor."""
    assert truth.stiffness is not None
    return [
        f'<fixed name="spring_{i}" springlength="{_numbers([-0.5 * play, 0.5 * play])}" stiffness="{k!r}" '
        f'damping="{d!r}"><joint joint="rotor_{i}" coef="1"/><joint joint="joint_{i}" coef="-1"/></fixed>'
        for i, (k, d, play) in enumerate(
            zip(truth.stiffness.tolist(), truth.spring_damping.tolist(), truth.backlash.tolist(), strict=True)
        )
    ]


def _inertial(robot: Robot, i: int, vector: Array) -> str:
    """MJCF element `<inertial>` of a link; an error if the inertia is not physically consistent."""
    name = robot.links[i].name
    if not vector[0] > 0.0:
        raise LabError(
            f"Link {name!r}, which the joint {robot.joints[i].name} moves, has a mass of {vector[0]:g} kg; a "
            "simulation in closed loop needs a positive mass of every link.",
            possible="--mode inverse-dynamics, which allows links without mass if they carry other links",
            remedy=f"add {inertial_key(robot)} to this link; if it is only a frame, one gram is enough.",
        )
    mass, com, inertia = vector_to_com_inertia(vector)
    moments = np.linalg.eigvalsh(inertia)
    # Rounding may violate a triangle inequality that holds with equality, as for a thin rod.
    if moments[0] <= 0.0 or moments[2] > moments[0] + moments[1] + 1e-9 * moments[2]:
        raise LabError(
            f"Link {name!r} of {robot.name} has the principal moments of inertia "
            f"{', '.join(f'{m:.3g}' for m in moments)} kg·m², which no real body can have.",
            remedy=f"give the inertia of a real body in {inertial_key(robot)}.",
        )
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    full = _numbers([inertia[a, b] for a, b in order])
    return f'<inertial pos="{_numbers(com)}" mass="{float(mass)!r}" fullinertia="{full}"/>'


def _numbers(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def _attribute(text: str) -> str:
    return text.translate({ord(mark): " " for mark in '<>&"'})


def stable_rate(truth: KnownArm, q: Array) -> float:
    """Smallest stable step rate [Hz] for the springs of gears and friction in poses q (N, n); 0 without springs."""
    slip = truth.friction.slip
    dry = np.zeros(truth.robot.n) if slip is None else slip.stiffness
    mass = kernel.mass_matrix(truth.robot.tree, truth.inertial, q)
    diagonal = np.eye(truth.robot.n, dtype=bool)
    if truth.stiffness is None:
        mobility, spring = np.linalg.inv(mass + np.where(diagonal, truth.rotor, 0.0)), dry
    else:  # both ends of the spring move
        mobility = np.linalg.inv(mass) + np.where(diagonal, 1.0 / truth.rotor, 0.0)
        spring = truth.stiffness + dry
    root = np.sqrt(spring)
    squared = np.linalg.eigvalsh(root[:, None] * mobility * root)
    return math.sqrt(max(float(squared.max(initial=0.0)), 0.0)) / STABLE


class Instant(NamedTuple):
    """Motion and torque of a simulated arm at one instant.

    Attributes:
        q: Positions of the joints, shape (n,) [rad or m].
        dq: Velocities of the joints, shape (n,) [rad/s or m/s].
        ddq: Accelerations of the joints, shape (n,) [rad/s² or m/s²].
        effort: Torque of the drives, shape (n,) [N·m or N].
        friction: Torque of friction, positive against a positive velocity, shape (n,) [N·m or N].
        drive_q: Positions of the drives, on the joint side, shape (n,) [rad or m].
        drive_dq: Velocities of the drives, on the joint side, shape (n,) [rad/s or m/s].
        drive_ddq: Accelerations of the drives, on the joint side, shape (n,) [rad/s² or m/s²].
        rise: Temperature rise, shape (n,) [K]; `None` if the friction has no warm-up.
    """

    q: Array
    dq: Array
    ddq: Array
    effort: Array
    friction: Array
    drive_q: Array
    drive_dq: Array
    drive_ddq: Array
    rise: Array | None


class _RigidBodies:
    """Links and rotors of an arm in MuJoCo.

    Attributes:
        joints: Indices of the joints in MuJoCo's state.
        drives: Indices of the rotors in MuJoCo's state; for rigid drives, indices of the joints.
        size: Number of coordinates of MuJoCo's state: joints and, for elastic drives, rotors.
    """

    def __init__(self, truth: KnownArm, step: float) -> None:
        try:
            self._mujoco: Any = import_module("mujoco")
        except ImportError as error:
            raise MissingExtraError("mujoco", "Simulating an arm", EXTRA) from error
        model = self._mujoco.MjModel.from_xml_string(write_mjcf(truth.robot, truth.inertial, truth))
        flags = self._mujoco.mjtDisableBit
        model.opt.disableflags |= flags.mjDSBL_CONSTRAINT | flags.mjDSBL_CONTACT | flags.mjDSBL_ACTUATION
        model.opt.timestep = step
        self._model, self._data, self.size = model, self._mujoco.MjData(model), int(model.nv)
        self.joints = self._addresses("joint", truth.robot.n)
        self.drives = self.joints if truth.stiffness is None else self._addresses("rotor", truth.robot.n)
        self._armature = model.dof_armature[self.drives].copy()
        self._identity = np.eye(self.size)

    def _addresses(self, kind: str, n: int) -> Any:
        """Indices of joints of a kind in MuJoCo's state; a slice if they are in the order of the robot."""
        at = [int(self._model.joint(f"{kind}_{i}").dofadr[0]) for i in range(n)]
        return slice(at[0], at[0] + n) if at == list(range(at[0], at[0] + n)) else np.array(at)

    def add_inertia(self, inertia: Array) -> None:
        """Sets the inertia (n,) [kg·m² or kg] that is added to the rotor inertia of the drives."""
        self._model.dof_armature[self.drives] = self._armature + inertia

    def acceleration(self, q: Array, dq: Array, torque: Array, external: Array | None = None) -> Array:
        """Accelerations (size,) of all coordinates at a state q, dq, each (size,).

        Args:
            q: Positions.
            dq: Velocities.
            torque: Torques of the drives, shape (n,) [N·m or N].
            external: External torques on the links, shape (n,) [N·m or N]; `None` if there are none.
        """
        data = self._data
        data.qpos[:], data.qvel[:], data.qfrc_applied[self.drives] = q, dq, torque
        if external is not None:
            rigid = self.size == len(torque)
            data.qfrc_applied[self.joints] = torque + external if rigid else external
        self._mujoco.mj_forward(self._model, data)
        return data.qacc.copy()

    def mobility(self) -> Array:
        """Accelerations of all coordinates for a unit torque of each drive, shape (size, n), in the last state."""
        inverse = np.empty_like(self._identity)
        self._mujoco.mj_solveM(self._model, self._data, inverse, self._identity)
        return inverse[:, self.drives]


class Plant:
    """Simulated arm whose state advances step by step.

    Args:
        truth: Parameters of the arm.
        step: Step h [s].
        q: Initial positions, shape (n,) [rad or m].
        effort: Initial torque of the drives, shape (n,) [N·m or N]; it determines the initial deflection of elastic
            drives.

    Raises:
        LabError: The step is too long for the springs, or a link is not physically consistent.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, truth: KnownArm, step: float, q: Array, effort: Array) -> None:
        if 1.0 / step < (1.0 - ROUNDING) * stable_rate(truth, q[None]):
            raise LabError(
                f"A step of {1e6 * step:.0f} µs is too long for the springs of this arm: the simulation would be "
                "unstable.",
                remedy=f"simulate at {stable_rate(truth, q[None]):.0f} Hz or more.",
            )
        self.truth, self.h, self.steps = truth, step, 0
        self._bodies = _RigidBodies(truth, step)
        self._q, self._half = np.zeros((2, self._bodies.size))
        self._q[self._bodies.joints] = q
        if truth.stiffness is not None:
            self._q[self._bodies.drives] = q + truth.deflection(effort)
        self._dq = self._half
        self._friction = FrictionState(truth.friction, q, effort)
        self._bodies.add_inertia(0.5 * step * self._friction.viscous)

    @property
    def q(self) -> Array:
        """Current positions of the joints, shape (n,) [rad or m]."""
        return self._q[self._bodies.joints]

    @property
    def drive_q(self) -> Array:
        """Current positions of the drives, on the joint side, shape (n,) [rad or m]."""
        return self._q[self._bodies.drives]

    @property
    def drive_dq(self) -> Array:
        """Current velocities of the drives, extrapolated over half a step, shape (n,) [rad/s or m/s]."""
        return self._dq[self._bodies.drives]

    def step(self, effort: Array, external: Array | None = None) -> Instant:
        """Advances by one step with torques of the drives (n,) [N·m or N]; returns the state before the step.

        `external` are torques that act on the links from outside, shape (n,) [N·m or N].

        Raises:
            LabError: The simulation has diverged.
        """
        bodies, friction, half, h = self._bodies, self._friction, self._half, self.h
        joints, drives = bodies.joints, bodies.drives
        dry, lower, upper, rest = friction.split(self._q[drives], self._dq[drives])
        torque = effort - rest - friction.viscous * half[drives] - dry
        a = bodies.acceleration(self._q, self._dq, torque, external)
        new = half + h * a
        turned = new[drives] * friction.signs <= 0.0
        if np.count_nonzero(turned):  # much faster than `any`
            dry, new = self._reversal(turned, dry, lower, upper, new)
            a = (new - half) / h
            friction.signs = np.sign(new[drives])
        mean = 0.5 * (half + new)
        drive_dq, drive_ddq = mean[drives], a[drives]
        torque = rest + dry + friction.viscous * drive_dq
        q, self._q, self._half, self._dq = self._q, self._q + h * new, new, new + (0.5 * h) * a
        passed = Instant(
            q[joints], mean[joints], a[joints], effort, torque, q[drives], drive_dq, drive_ddq, friction.rise
        )
        if not friction.is_plain:
            load = effort - torque - self.truth.rotor * drive_ddq
            friction.update(self._q[drives], load, torque * drive_dq, h)
            if friction.rise is not None:
                bodies.add_inertia(0.5 * h * friction.viscous)
        self.steps += 1
        if self.steps % CHECKED == 0 and not np.abs(new).max() < RUNAWAY:
            raise LabError(
                f"The simulation became unstable after {self.steps * h:.3f} s.",
                remedy="reduce the gains of the controller (a larger `compliance`), or raise `physics_rate`.",
            )
        return passed

    def _reversal(
        self, turned: NDArray[np.bool_], dry: Array, lower: Array, upper: Array, new: Array
    ) -> tuple[Array, Array]:
        """Dry friction of the drives and new velocities of all coordinates, if a drive stops or reverses."""
        drives = self._bodies.drives
        columns = self.h * self._bodies.mobility()
        coupling = columns[drives]
        at = turned.nonzero()[0]
        if len(at) == 1:  # the usual case
            j = int(at[0])
            torque = min(max(dry[j] + new[drives][j] / coupling[j, j], -lower[j]), upper[j])
            slid = new + columns[:, j] * (dry[j] - torque)
            velocity = slid[drives]
            if -lower[j] < torque < upper[j]:
                velocity[j] = 0.0
            still = velocity * self._friction.signs > 0.0
            still[j] = True
            if still.all():
                dry = dry.copy()
                dry[j], slid[drives] = torque, velocity
                return dry, slid
        free = new + columns @ dry
        (dry,), (velocity,) = solve_stiction(coupling[None], free[drives][None], lower[None], upper[None])
        new = free - columns @ dry
        new[drives] = np.where(velocity == 0.0, 0.0, new[drives])
        return dry, new

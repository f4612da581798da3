"""Virtual arms with servos: two of armid's own, and every arm whose description contains masses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import LabError
from armid.excitation.command_motion import command_ranges
from armid.input_boundary import read_toml
from armid.lab.friction import Friction
from armid.lab.known_arms import KnownArm, truth_of
from armid.lab.servos.options import ServoLabOptions, servo_lab_options
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.robot.robot import Robot

FOLDER = Path(__file__).parent

HOBBY_ARM, LEG = "hobby-arm", "stand-leg"

VIRTUAL_ARMS = {
    HOBBY_ARM: "six-axis hobby arm with bus servos, encoders of 12 bit and a bus of 50 Hz",
    LEG: "leg with three joints on a stand, with known gains, encoders of 14 bit and a bus of 200 Hz",
}
"""Virtual arms whose description and true values are files of this package."""

USUAL_ERROR = 0.03
"""Position error at which the servo of another arm gives the largest gravity torque of its joint [rad or m]."""

SLOWEST = 20.0
"""Lowest angular eigenfrequency of a joint with the servo of another arm [rad/s]."""

INERTIA, VISCOUS, DRY = 4e-4, 0.012, 3e-3
"""Rotor inertia [s²], viscous friction [s] and Coulomb friction [rad or m] of other arms over the stiffness."""

USUAL_DELAY = 0.01
"""Delay of the commands of other arms [s]."""

SPARE = 3.0
"""Largest torque of a servo of another arm whose description states no limit, over that at the usual error."""

GEAR = 30.0
"""Stiffness of a gear with backlash over that of its servo, if it is not given."""

POSES = 200
"""Number of random poses in which gravity torques are computed."""


@dataclass(frozen=True, eq=False, slots=True)
class KnownServoArm:
    """Virtual arm with servos whose values are known.

    Attributes:
        arm: Links, friction, rotors and gears.
        stiffness: Stiffness of the servos, shape (n,) [N·m/rad or N/m].
        damping: Damping of the servos, shape (n,) [N·m·s/rad or N·s/m].
        delay: Delay of the commands, shape (n,) [s].
        offset: Offset of horn or encoder, shape (n,) [rad or m].
        limit: Largest torque, shape (n,) [N·m or N].
    """

    arm: KnownArm
    stiffness: Array
    damping: Array
    delay: Array
    offset: Array
    limit: Array


def description_of(name: str) -> Path:
    """File of the description of a virtual arm, a key of `VIRTUAL_ARMS`."""
    return FOLDER / f"{name}.xml"


def options_for(robot: Robot, table: Mapping[str, Any] | None = None) -> ServoLabOptions:
    """Options of an arm, those of its own file for one of `VIRTUAL_ARMS`, changed by the tables of a `lab.toml`."""
    own: Mapping[str, Any] = {}
    if robot.name in VIRTUAL_ARMS and robot.n == len(read_own(robot.name)["arm"]["rotor"]):
        own = read_own(robot.name)
    return servo_lab_options(own, table or {})


def read_own(name: str) -> Mapping[str, Any]:
    """Tables of the file with the true values of a virtual arm."""
    return read_toml(FOLDER / f"{name}.toml", "a virtual arm", LabError, remedy="install armid again.")


def known_servo_arm(robot: Robot, options: ServoLabOptions) -> KnownServoArm:
    """Virtual arm with the true values of the options; what they leave open is in proportion to the loads.

    Raises:
        LabError: The description contains no masses, or a list has another number of values than the arm has joints.
    """
    plain = truth_of(robot)
    load, inertia = _needs(robot, plain.inertial)
    given, servo = options.arm, options.servo
    stiffness = servo.each("stiffness", np.maximum(load / USUAL_ERROR, SLOWEST**2 * inertia))
    effort = np.array([joint.effort_limit for joint in robot.joints])
    friction = given.friction or Friction(VISCOUS * stiffness, DRY * stiffness)
    own = replace(plain, friction=friction, rotor=INERTIA * stiffness if given.rotor is None else given.rotor)
    if given.backlash is not None and given.stiffness is None:
        gear = GEAR * stiffness
        own = replace(own, stiffness=gear, spring_damping=0.04 * np.sqrt(gear * own.rotor))
    arm = replace(given, friction=own.friction).of(own)
    bodies = deviating_links(arm.inertial, options.link_deviation, np.random.default_rng(options.arm_seed))
    return KnownServoArm(
        replace(arm, inertial=bodies),
        stiffness,
        servo.each("damping", np.zeros(robot.n)),
        servo.each("delay", np.full(robot.n, USUAL_DELAY)),
        servo.each("offset", np.zeros(robot.n)),
        servo.each("limit", np.where(np.isfinite(effort) & (effort > 0.0), effort, SPARE * USUAL_ERROR * stiffness)),
    )


def _needs(robot: Robot, inertial: Array) -> tuple[Array, Array]:
    """Largest gravity torque and inertia of each joint over random poses, shape (n,) [N·m or N; kg·m² or kg]."""
    low, high, _ = command_ranges(robot)
    poses = np.random.default_rng(0).uniform(low, high, (POSES, robot.n))
    load = np.abs(kernel.gravity_torque(robot.tree, inertial, poses)).max(axis=0)
    mass = kernel.mass_matrix(robot.tree, inertial, poses)
    return load, np.diagonal(mass, axis1=1, axis2=2).max(axis=0)


def deviating_links(inertial: Array, deviation: float, rng: np.random.Generator) -> Array:
    """Inertial parameters (n, 10) of possible links that differ from given ones by a relative deviation."""
    if deviation == 0.0:
        return inertial
    factors = np.tile(np.eye(4), (len(inertial), 1, 1))
    for i in range(4):
        for j in range(i + 1):
            change = deviation * rng.normal(size=len(inertial))
            factors[:, i, j] = np.exp(change) if i == j else change
    moved = np.linalg.cholesky(pseudo_inertia(inertial) + 1e-12 * np.eye(4)) @ factors
    return vector_from_pseudo_inertia(moved @ np.swapaxes(moved, 1, 2))

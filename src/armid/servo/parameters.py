"""Parameters of an arm whose joints are held to commands by servos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array, array
from armid.errors import ModelError
from armid.kernel import LawPrograms, ServoJoints
from armid.model.terms.law_programs import law_programs
from armid.model.terms.term import Law, Term
from armid.robot.robot import Robot

LONGEST_STEP = 2e-3
"""Usual longest step of the integration [s]. Steps of half this length change the motion of the hobby arm SO-101 by
less than 0.1 mrad."""


@dataclass(frozen=True, eq=False, slots=True)
class ServoParameters:
    """Links, drives, friction and servos of n joints.

    A servo gives the torque K (c(t - δ) - q - b) - D q̇, limited to ± its largest torque, with the command c,
    stiffness K, damping D, delay δ and offset b.

    Attributes:
        inertial: Inertial parameters of the links, shape (n, 10).
        rotor_inertia: Rotor inertias, shape (n,) [kg·m² or kg].
        friction: Parameter of each friction law, shape (l,).
        stiffness: K, shape (n,) [N·m/rad or N/m].
        damping: D, shape (n,) [N·m·s/rad or N·s/m].
        limit: Largest torque, infinite if it is not known, shape (n,) [N·m or N].
        offset: b, shape (n,) [rad or m].
        delay: δ, shape (n,) [s]; negative if the logged command is older than the logged position.
    """

    inertial: Array
    rotor_inertia: Array
    friction: Array
    stiffness: Array
    damping: Array
    limit: Array
    offset: Array
    delay: Array

    def __post_init__(self) -> None:
        n = len(self.stiffness)
        object.__setattr__(self, "inertial", array(self.inertial, (n, 10), "inertial"))
        object.__setattr__(self, "friction", array(self.friction, (None,), "friction"))
        for name in ("rotor_inertia", "stiffness", "damping", "limit", "offset", "delay"):
            object.__setattr__(self, name, array(getattr(self, name), (n,), name, finite=name != "limit"))


@dataclass(frozen=True, eq=False, slots=True)
class ServoModel:
    """Arm with friction laws, whose joints follow commands.

    Attributes:
        robot: The arm.
        laws: Friction laws.
        terms: Name of the term of each law.
        programs: The laws as programs of the roll-out.
        longest_step: Longest step of the integration [s].
    """

    robot: Robot
    laws: tuple[Law, ...]
    terms: tuple[str, ...]
    programs: LawPrograms
    longest_step: float = LONGEST_STEP

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    def joints(self, parameters: ServoParameters, step: float) -> ServoJoints:
        """Servos and laws for a roll-out with the given step [s]."""
        return ServoJoints(
            parameters.stiffness,
            parameters.damping,
            parameters.limit,
            parameters.rotor_inertia,
            self.programs,
            parameters.friction,
            step,
        )


def make_servo_model(robot: Robot, terms: Sequence[Term]) -> ServoModel:
    """Model of an arm with friction terms, in which dry friction holds a joint exactly.

    Args:
        robot: The arm.
        terms: Friction terms whose parameters cannot be negative; Coulomb friction with a width of zero.

    Raises:
        ModelError: A law depends on more than position and velocity, or its parameter may be negative.
    """
    named = sorted(((term.name, law) for term in terms for law in term.laws(robot)), key=lambda each: each[1].joint)
    laws = tuple(law for _, law in named)
    for law in laws:
        if not law.nonnegative:
            raise ModelError(
                f"The parameter {law.symbol}_{law.joint + 1} may be negative; friction of a servo must not drive it.",
                remedy="use terms such as viscous and coulomb.",
            )
    return ServoModel(robot, laws, tuple(name for name, _ in named), law_programs(laws))


def described_parameters(model: ServoModel) -> ServoParameters | None:
    """Links, rotor inertia, friction and servos that the description contains; `None` if it has no servo or no links.

    Viscous and Coulomb friction of the description are taken; other laws get zero.
    """
    robot = model.robot
    bodies, servos = robot.inertial_vector, [joint.drive.servo for joint in robot.joints]
    if bodies is None or any(servo is None for servo in servos):
        return None
    # The fields of a described drive have the names of the terms.
    friction = [
        getattr(robot.joints[law.joint].drive, name, 0.0) for name, law in zip(model.terms, model.laws, strict=True)
    ]
    limits = [joint.effort_limit for joint in robot.joints]
    gains = [(servo.stiffness, servo.damping) for servo in servos if servo is not None]
    return ServoParameters(
        bodies,
        np.array([joint.drive.rotor_inertia for joint in robot.joints]),
        np.array(friction),
        np.array([stiffness for stiffness, _ in gains]),
        np.array([damping for _, damping in gains]),
        np.array(limits),
        np.array([servo.offset for servo in servos if servo is not None]),
        np.zeros(model.n),
    )

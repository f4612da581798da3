"""Arms for simulation, with known parameters that are published or assumed.

The friction, rotors and springs of the Panda and the UR10e are not measured; they are assumptions of a size that is
usual for such drives. The friction of the iiwa is that of Table 4.1 of the thesis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import LabError, did_you_mean
from armid.lab.friction import Friction, MaxwellSlip, StribeckEffect, ToothRipple, Warmth
from armid.lab.inverse_dynamics_recording import THESIS_FRICTION
from armid.robot.missing_inertia import inertial_key, massless_joints
from armid.robot.robot import InertialParameters, Robot


@dataclass(frozen=True, eq=False, slots=True)
class KnownArm:
    """Simulated arm with known parameters.

    Attributes:
        robot: Geometry, limits and gravity.
        inertial: Inertial parameters of the links, shape (n, 10).
        friction: Friction of the drives.
        rotor: Rotor inertia of the drives, as seen from the joints, shape (n,) [kg·m² or kg].
        stiffness: Stiffness of the gears between drive and link, shape (n,) [N·m/rad or N/m]; `None` for rigid gears.
        spring_damping: Damping of the gears, shape (n,) [N·m·s/rad or N·s/m].
        backlash: Play of elastic gears, from one side to the other, shape (n,) [rad or m].
    """

    robot: Robot
    inertial: Array
    friction: Friction
    rotor: Array
    stiffness: Array | None = None
    spring_damping: Array = ()  # pyright: ignore[reportAssignmentType]
    backlash: Array = ()  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        n = self.robot.n
        object.__setattr__(self, "inertial", array(self.inertial, (n, 10), "inertial"))
        object.__setattr__(self, "rotor", array(self.rotor, (n,), "rotor"))
        damping = self.spring_damping if np.size(self.spring_damping) else np.zeros(n)
        object.__setattr__(self, "spring_damping", array(damping, (n,), "spring_damping"))
        play = self.backlash if np.size(self.backlash) else np.zeros(n)
        object.__setattr__(self, "backlash", array(play, (n,), "backlash"))
        if (self.backlash < 0.0).any() or (self.backlash.any() and self.stiffness is None):
            raise LabError(
                "Backlash must not be negative, and only elastic gears can have it.",
                remedy="give `backlash` of zero or more, and `stiffness` and `rotor` of every joint.",
            )
        if self.friction.n != n:
            raise LabError(
                f"The friction has {self.friction.n} joints; {self.robot.name} has {n}.",
                remedy="give one number for each joint in every part of the friction.",
            )
        if (self.rotor < 0.0).any():
            raise LabError(
                f"Rotor inertia must not be negative; found {self.rotor.min():g}.", remedy="correct the key `rotor`."
            )
        if self.stiffness is not None:
            object.__setattr__(self, "stiffness", array(self.stiffness, (n,), "stiffness"))
            if (self.stiffness <= 0.0).any() or (self.rotor == 0.0).any():
                raise LabError(
                    "Elastic drives need a positive stiffness and a positive rotor inertia for every joint.",
                    remedy="give rotor inertia and stiffness for every joint, or leave out the stiffness.",
                )

    def deflection(self, torque: Array) -> Array:
        """Lead of the drives before the links under transmitted torques (…, n) [rad or m]; zero for rigid gears."""
        if self.stiffness is None:
            return np.zeros_like(torque)
        return torque / self.stiffness + 0.5 * np.sign(torque) * self.backlash


PANDA_BODIES = (
    # mass [kg], centre of mass [m], length and radius [m] of a cylinder along an axis of the link
    (3.2, (0.0, -0.03, -0.10), 0.30, 0.06, 2),
    (3.2, (0.0, -0.09, 0.03), 0.30, 0.06, 1),
    (2.9, (0.04, 0.03, -0.07), 0.24, 0.055, 2),
    (2.9, (-0.04, 0.09, 0.03), 0.24, 0.055, 1),
    (3.0, (0.0, 0.03, -0.13), 0.32, 0.05, 2),
    (1.6, (0.05, 0.0, -0.01), 0.14, 0.05, 0),
    (0.8, (0.01, 0.01, 0.06), 0.10, 0.04, 2),
)
"""Bodies of the virtual Panda: homogeneous cylinders with a total mass of about 18 kg, as in the data sheet."""

OWN = {
    "panda": {
        "viscous": (7.0, 9.0, 5.5, 5.0, 2.4, 1.8, 2.0),
        "coulomb": (4.5, 5.5, 3.5, 3.5, 1.4, 1.2, 1.1),
        "rotor": (0.60, 0.60, 0.45, 0.45, 0.20, 0.18, 0.18),
        "stiffness": (1.4e4, 1.4e4, 1.4e4, 1.4e4, 9e3, 9e3, 9e3),
    },
    "ur10e": {
        "viscous": (38.0, 38.0, 22.0, 7.0, 7.0, 5.5),
        "coulomb": (17.0, 19.0, 12.0, 4.5, 4.5, 3.5),
        "rotor": (3.2, 3.2, 1.6, 0.35, 0.35, 0.30),
        "stiffness": (4.5e4, 4.5e4, 2.6e4, 1.2e4, 1.2e4, 1.2e4),
    },
    "iiwa14-r820": {
        "viscous": THESIS_FRICTION["FV"],
        "coulomb": THESIS_FRICTION["FS"],
        "rotor": (3.0, 3.0, 1.6, 1.6, 0.8, 0.35, 0.35),
        "stiffness": (3.0e4, 3.0e4, 2.2e4, 2.2e4, 1.5e4, 8e3, 8e3),
    },
}
"""Friction [N·m·s/rad, N·m], rotor inertia [kg·m²] and stiffness [N·m/rad] of the built-in arms, joint by joint."""

TYPICAL_COULOMB = 0.04
"""Coulomb friction divided by the effort limit, for arms that are not in `OWN`; typical of gears of robot arms."""

TYPICAL_SPEED = 1.0
"""Velocity [rad/s or m/s] at which viscous and Coulomb friction are equal, for arms that are not in `OWN`."""

UNKNOWN_EFFORT = 100.0
"""Effort limit [N·m or N] that is assumed if the limit is unknown."""


def truth_of(robot: Robot) -> KnownArm:
    """Simulated arm for a robot description, with viscous and Coulomb friction, rigid drives and no rotor inertia.

    A built-in arm has the friction in `OWN`. The friction of any other arm is proportional to its effort limits. The
    inertias are those of the description; only the inertias of the Panda, whose description has none, are built in.

    Raises:
        LabError: The description contains no inertias, or some joints move no mass.
    """
    own = OWN.get(robot.source if robot.source in OWN else robot.name)
    if own is not None and len(own["coulomb"]) != robot.n:
        own = None  # some of its joints are locked
    if own is None:
        friction = friction_of_limits(robot)
    else:
        friction = Friction(np.array(own["viscous"]), np.array(own["coulomb"]))
    return KnownArm(robot, _bodies(robot), friction, np.zeros(robot.n))


def friction_of_limits(robot: Robot) -> Friction:
    """Friction that is proportional to the effort limits, for arms that are not in `OWN`."""
    limits = np.array([joint.effort_limit for joint in robot.joints])
    coulomb = TYPICAL_COULOMB * np.where(np.isfinite(limits), limits, UNKNOWN_EFFORT)
    return Friction(coulomb / TYPICAL_SPEED, coulomb)


def _bodies(robot: Robot) -> Array:
    """Inertial parameters (n, 10) of the links for a simulation: of the description, or built in for the Panda."""
    nominal, empty = robot.inertial_vector, massless_joints(robot)
    if nominal is not None and empty:
        raise LabError(
            f"The joints {', '.join(empty)} of {robot.name} move no mass: the description has no inertia of their "
            "links.",
            remedy=f"add {inertial_key(robot)} with mass, com and inertia to these links, or lock the joints.",
        )
    if nominal is not None:
        return nominal
    if robot.name == "panda" and robot.n == len(PANDA_BODIES):
        return np.array([_cylinder(*each) for each in PANDA_BODIES])
    raise LabError(
        f"A simulation needs inertial parameters, but the description of {robot.name} has none.",
        possible=", ".join(OWN),
        remedy=f"add {inertial_key(robot)} with mass, centre of mass and inertia to each link.",
    )


def _cylinder(mass: float, com: Sequence[float], length: float, radius: float, axis: int) -> Array:
    """Inertial parameters (10,) of a homogeneous cylinder whose axis is parallel to an axis of the link frame."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    moments = np.full(3, across)
    moments[axis] = 0.5 * mass * radius**2
    return InertialParameters.from_com(mass, com, np.diag(moments)).vector


def _rotor(truth: KnownArm) -> KnownArm:
    own = OWN.get(truth.robot.name)
    if own is not None and len(own["rotor"]) == truth.robot.n:
        return replace(truth, rotor=np.array(own["rotor"]))
    return replace(truth, rotor=0.05 * truth.friction.coulomb + 0.01)


def _elastic(truth: KnownArm) -> KnownArm:
    own = OWN.get(truth.robot.name)
    if not truth.rotor.all():
        truth = _rotor(truth)
    known = own is not None and len(own["stiffness"]) == truth.robot.n
    stiffness = np.array(own["stiffness"]) if own is not None and known else 2e3 * truth.friction.coulomb + 5e3
    # Gear oscillations decay within some ten periods: a damping ratio of 2 % of rotor and spring.
    return replace(truth, stiffness=stiffness, spring_damping=0.04 * np.sqrt(stiffness * truth.rotor))


def _friction(change: Callable[[Friction], Friction]) -> Callable[[KnownArm], KnownArm]:
    return lambda truth: replace(truth, friction=change(truth.friction))


def _like(friction: Friction, value: ArrayLike) -> Array:
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (friction.n,)).copy()


def _slip(friction: Friction) -> Friction:
    """Friction in which Maxwell-slip springs replace two fifths of the Coulomb friction."""
    share, deflections = (0.25, 0.15), (5e-4, 2e-3)
    torque = np.outer(share, friction.coulomb)
    slip = MaxwellSlip(torque, np.outer(deflections, np.ones(friction.n)))
    return replace(friction, coulomb=friction.coulomb - torque.sum(axis=0), slip=slip)


EFFECTS: dict[str, Callable[[KnownArm], KnownArm]] = {
    "rotor": _rotor,
    "elastic": _elastic,
    "stribeck": _friction(lambda f: replace(f, stribeck=StribeckEffect(0.3 * f.coulomb, _like(f, 0.05)))),
    "asymmetric": _friction(lambda f: replace(f, asymmetry=0.1 * f.coulomb)),
    "load": _friction(lambda f: replace(f, load=_like(f, 0.03))),
    "hysteresis": _friction(_slip),
    "ripple": _friction(
        lambda f: replace(f, ripple=ToothRipple(0.05 * f.coulomb, _like(f, 200.0), np.arange(f.n, dtype=np.float64)))
    ),
    "temperature": _friction(
        lambda f: replace(f, warmth=Warmth(_like(f, 0.02), 0.05 / (f.coulomb + 1e-6), _like(f, 600.0), _like(f, 0.0)))
    ),
}
"""Effects that an arm may have in addition to viscous and Coulomb friction, by name; most are proportional to the
friction of the arm."""


def with_effects(truth: KnownArm, names: Sequence[str]) -> KnownArm:
    """Simulated arm with additional effects, applied in the order of `EFFECTS`.

    Raises:
        LabError: There is no effect with such a name.
    """
    for name in names:
        if name not in EFFECTS:
            raise LabError(
                f"Unknown effect {name!r}.", possible=", ".join(EFFECTS), remedy=did_you_mean(name, EFFECTS)
            )
    for name, change in EFFECTS.items():
        if name in names:
            truth = change(truth)
    return truth

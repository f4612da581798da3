"""Simulated friction of gears and drives, joint by joint, with effects that the identified model does not contain.

Friction is the sum of a dry part and a smooth part. While a joint sticks, the dry part lies between two bounds:

    dry     ±(FS + FT exp(-(|q̇|/v)^shape) + FSL |load|) + FSA     against the motion
    smooth  FV(T) q̇ + FO + FR sin(teeth q + phase) + Σ FH_k (q - z_k) / r_k

The parameters F… are those of `Friction` and its effects. T is the temperature rise of the joint, which is heated by
friction. z_k is the end of a Maxwell-slip spring; this end moves with q as soon as the deflection of the spring
reaches r_k [AlBender2005]. `FrictionState` computes friction step by step, `friction_along` for a whole motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armid.checked_array import Array, array
from armid.errors import LabError
from armid.model.motion import Motion


def _columns(kind: object, *names: str) -> None:
    """Converts fields of a dataclass to arrays of one number for each joint; the numbers must not be negative."""
    for name in names:
        values = array(getattr(kind, name), (None,), name)
        if (values < 0.0).any():
            raise LabError(
                f"The values of {name!r} must not be negative; found {values.min():g}.",
                remedy=f"correct the key {name!r} in the lab.toml.",
            )
        object.__setattr__(kind, name, values)


@dataclass(frozen=True, eq=False, slots=True)
class StribeckEffect:
    """Additional dry friction at low velocities.

    Attributes:
        extra: Friction FT at standstill, shape (n,) [N·m or N].
        velocity: Velocity at which the additional friction has decreased to 1/e, shape (n,) [rad/s or m/s].
        shape: Exponent of the decrease with speed.
    """

    extra: Array
    velocity: Array
    shape: float = 2.0

    def __post_init__(self) -> None:
        _columns(self, "extra", "velocity")
        if not self.velocity.all() or not self.shape > 0.0:
            raise LabError(
                "The velocity and the shape of the Stribeck effect must be positive.",
                remedy="correct `velocity` and `shape` in the table [arm.friction.stribeck].",
            )


@dataclass(frozen=True, eq=False, slots=True)
class MaxwellSlip:
    """Hysteresis at reversals of motion: each joint has E springs, and each spring slips at a given deflection.

    Attributes:
        torque: Torque FH at which each spring slips, shape (E, n) [N·m or N].
        deflection: Deflection r at which each spring slips, shape (E, n), positive [rad or m].
    """

    torque: Array
    deflection: Array

    def __post_init__(self) -> None:
        torque = array(self.torque, (None, None), "torque of Maxwell slip")
        deflection = array(self.deflection, torque.shape, "deflection of Maxwell slip")
        if (torque < 0.0).any() or not (deflection > 0.0).all():
            raise LabError(
                "Maxwell slip needs torques that are not negative, and positive deflections.",
                remedy="correct `torque` and `deflection` in the table [arm.friction.slip].",
            )
        object.__setattr__(self, "torque", torque)
        object.__setattr__(self, "deflection", deflection)

    @property
    def stiffness(self) -> Array:
        """Stiffness of all springs together, shape (n,) [N·m/rad or N/m]."""
        return (self.torque / self.deflection).sum(axis=0)

    def next(self, ends: Array, q: Array) -> Array:
        """Ends (E, n) of the springs after a motion to positions q (n,); `ends` are the ends before the motion."""
        return np.minimum(np.maximum(ends, q - self.deflection), q + self.deflection)


@dataclass(frozen=True, eq=False, slots=True)
class ToothRipple:
    """Torque that is periodic with the teeth of the gear.

    Attributes:
        amplitude: Amplitude FR, shape (n,) [N·m or N].
        teeth: Angular frequency of the ripple as a function of the position, shape (n,) [1/rad or 1/m].
        phase: Phase at q = 0, shape (n,) [rad].
    """

    amplitude: Array
    teeth: Array
    phase: Array

    def __post_init__(self) -> None:
        _columns(self, "amplitude", "teeth")
        object.__setattr__(self, "phase", array(self.phase, self.teeth.shape, "phase"))


@dataclass(frozen=True, eq=False, slots=True)
class Warmth:
    """Viscous friction that decreases as the gear warms up: FV(T) = FV exp(-coefficient T).

    T is the temperature rise of a joint above its temperature at rest. The power of friction increases T; without
    friction T decays exponentially.

    Attributes:
        coefficient: Temperature coefficient of viscous friction, shape (n,) [1/K].
        heating: Temperature rise divided by the energy that friction dissipates, shape (n,) [K/J].
        time_constant: Time constant of cooling, shape (n,) [s].
        initial: Initial temperature rise, shape (n,) [K].
    """

    coefficient: Array
    heating: Array
    time_constant: Array
    initial: Array

    def __post_init__(self) -> None:
        _columns(self, "coefficient", "heating", "time_constant", "initial")
        if not self.time_constant.all():
            raise LabError(
                "The time constant of cooling must be positive.",
                remedy="correct `time_constant` in the table [arm.friction.warmth].",
            )

    def next(self, rise: Array, power: Array, step: float) -> Array:
        """Temperature rise (n,) [K] after a time `step` [s] in which friction dissipates the power (n,) [W]."""
        return rise + step * (self.heating * power - rise / self.time_constant)


def _none() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, slots=True)
class Friction:
    """Friction of n joints; an effect whose attribute is not given does not occur.

    Attributes:
        viscous: Viscous friction FV, shape (n,) [N·m·s/rad or N·s/m].
        coulomb: Coulomb friction FS, shape (n,) [N·m or N].
        offset: Torque offset FO, shape (n,) [N·m or N].
        asymmetry: Dry friction FSA in positive direction minus the mean of both directions, shape (n,) [N·m or N];
            its absolute value is at most FS.
        load: Dry friction FSL divided by the torque that the gear transmits, shape (n,).
        stribeck: Additional friction near standstill.
        slip: Hysteresis at reversals.
        ripple: Ripple of the gear teeth.
        warmth: Decrease of viscous friction as the gear warms up.
    """

    viscous: Array
    coulomb: Array
    offset: Array = field(default_factory=_none)
    asymmetry: Array = field(default_factory=_none)
    load: Array = field(default_factory=_none)
    stribeck: StribeckEffect | None = None
    slip: MaxwellSlip | None = None
    ripple: ToothRipple | None = None
    warmth: Warmth | None = None

    def __post_init__(self) -> None:
        _columns(self, "viscous", "coulomb")
        n = len(self.viscous)
        for name in ("offset", "asymmetry", "load"):
            given = getattr(self, name)
            object.__setattr__(self, name, array(given if np.size(given) else np.zeros(n), (n,), name))
        lengths = {len(self.coulomb)}
        if self.stribeck is not None:
            lengths |= {len(self.stribeck.extra), len(self.stribeck.velocity)}
        if self.slip is not None:
            lengths.add(self.slip.torque.shape[1])
        if self.ripple is not None:
            lengths |= {len(self.ripple.amplitude), len(self.ripple.teeth)}
        if self.warmth is not None:
            lengths |= {len(self.warmth.coefficient), len(self.warmth.initial)}
        if lengths != {n}:
            raise LabError(
                f"The parts of the friction have different numbers of joints: {n}, and "
                f"{', '.join(map(str, sorted(lengths - {n})))}.",
                remedy="give each part one number for each joint.",
            )
        if (np.abs(self.asymmetry) > self.coulomb).any() or (self.load < 0.0).any():
            raise LabError(
                "The friction would accelerate a joint: an absolute value of `asymmetry` exceeds `coulomb`, or "
                "a value of `load` is negative.",
                remedy="give absolute values of `asymmetry` up to `coulomb`, and values of `load` of zero or more.",
            )

    @classmethod
    def none(cls, n: int) -> Friction:
        """Friction of n joints that is zero."""
        return cls(np.zeros(n), np.zeros(n))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.viscous)

    @property
    def is_plain(self) -> bool:
        """Tests whether the friction consists only of viscous and Coulomb friction."""
        parts = (self.stribeck, self.slip, self.ripple, self.warmth)
        rest = self.offset.any() or self.asymmetry.any() or self.load.any()
        return not rest and all(part is None for part in parts)

    def dry(self, dq: Array, load: Array) -> Array:
        """Dry friction while sliding, mean of the two directions (without `asymmetry`), shape (..., n) [N·m or N].

        Args:
            dq: Velocity, shape (..., n) [rad/s or m/s].
            load: Torque that the gear transmits, shape (..., n) [N·m or N].
        """
        level = self.coulomb + self.load * np.abs(load)
        if self.stribeck is not None:
            level = level + self.stribeck.extra * np.exp(
                -((np.abs(dq) / self.stribeck.velocity) ** self.stribeck.shape)
            )
        return level

    def of_position(self, q: Array, states: Array | None) -> Array:
        """Sum of offset, ripple and hysteresis, shape (..., n) [N·m or N].

        Args:
            q: Position, shape (..., n) [rad or m].
            states: Ends z of the springs, shape (..., E, n); `None` if there are no springs.
        """
        torque = self.offset
        if self.ripple is not None:
            torque = torque + self.ripple.amplitude * np.sin(self.ripple.teeth * q + self.ripple.phase)
        if self.slip is not None and states is not None:
            stretch = (q[..., None, :] - states) / self.slip.deflection
            torque = torque + (self.slip.torque * stretch).sum(axis=-2)
        return torque

    def viscosity(self, rise: Array | None) -> Array:
        """Viscous friction [N·m·s/rad or N·s/m] for a temperature rise (..., n) [K]; without rise if `None`."""
        if self.warmth is None or rise is None:
            return self.viscous
        return self.viscous * np.exp(-self.warmth.coefficient * rise)


class FrictionState:
    """Friction of a simulated arm, together with the state of the friction between two simulation steps.

    Attributes:
        law: Law and parameters of the friction.
        is_plain: True if there is only viscous and Coulomb friction.
        is_symmetric: True if dry friction is the same in both directions of motion.
        signs: Signs of the directions of motion, 0 for joints that stick, shape (n,).
        load: Torque that the gears transmit, shape (n,) [N·m or N].
        ends: Ends of the springs of Maxwell slip, shape (E, n) [rad or m].
        rise: Temperature rise, shape (n,) [K].
        viscous: Viscous coefficient for this temperature rise, shape (n,) [N·m·s/rad or N·s/m].
    """

    def __init__(self, law: Friction, q: Array, load: Array) -> None:
        self.law, self.is_plain, self.is_symmetric = law, law.is_plain, not law.asymmetry.any()
        self.signs, self.load = np.zeros(law.n), np.array(load, dtype=np.float64)
        self.ends = None if law.slip is None else np.broadcast_to(q, law.slip.deflection.shape)
        self.rise = None if law.warmth is None else law.warmth.initial
        self.viscous = law.viscosity(self.rise)

    def split(self, q: Array, dq: Array) -> tuple[Array, Array, Array, Array]:
        """Dry friction of sliding joints, its two bounds, and friction that depends on the position, shape (n,) each.

        The bounds are the largest absolute values of dry friction in negative and in positive direction [N·m or N].

        Args:
            q: Positions, shape (n,) [rad or m].
            dq: Velocities, shape (n,) [rad/s or m/s].
        """
        if self.is_plain:
            level = self.law.coulomb
            return level * self.signs, level, level, self.law.offset
        level, rest = self.law.dry(dq, self.load), self.law.of_position(q, self.ends)
        if self.is_symmetric:
            return level * self.signs, level, level, rest
        lower, upper = level - self.law.asymmetry, level + self.law.asymmetry
        return np.where(self.signs > 0.0, upper, -lower) * np.abs(self.signs), lower, upper, rest

    def update(self, q: Array, load: Array, power: Array, step: float) -> None:
        """Updates the state for the end of a simulation step.

        Args:
            q: Positions at the end of the step, shape (n,) [rad or m].
            load: Torque that the gears transmit, shape (n,) [N·m or N].
            power: Power that friction dissipates, shape (n,) [W].
            step: Duration of the step [s].
        """
        self.load = load
        if self.law.slip is not None and self.ends is not None:
            self.ends = self.law.slip.next(self.ends, q)
        if self.law.warmth is not None and self.rise is not None:
            self.rise = self.law.warmth.next(self.rise, np.maximum(power, 0.0), step)
            self.viscous = self.law.viscosity(self.rise)


def friction_along(friction: Friction, motion: Motion, load: Array) -> tuple[Array, Array | None]:
    """Friction (N, n) [N·m or N] along a motion, and temperature rise (N, n) [K], `None` without warm-up.

    The dry friction at samples with velocity zero is set to zero; only a closed-loop simulation can determine it.

    Args:
        friction: Friction of the simulated arm.
        motion: Consecutive samples of a motion, evenly spaced or not.
        load: Torque that the gears transmit, shape (N, n) [N·m or N].
    """
    q, dq = motion.q, motion.dq
    torque = friction.dry(dq, load) * np.sign(dq) + friction.asymmetry * np.abs(np.sign(dq))
    torque += friction.of_position(q, _springs(friction, q))
    if friction.warmth is None:
        return torque + friction.viscous * dq, None
    rise = np.empty_like(q)
    now = friction.warmth.initial
    steps = np.diff(motion.time, append=motion.time[-1:])
    for k in range(motion.samples):  # each temperature follows from the friction at the one before
        rise[k] = now
        viscous = friction.viscosity(now) * dq[k]
        power = np.maximum((torque[k] + viscous) * dq[k], 0.0)
        torque[k] += viscous
        now = friction.warmth.next(now, power, steps[k])
    return torque, rise


def _springs(friction: Friction, q: Array) -> Array | None:
    """Ends of the springs (N, E, n) along positions (N, n); at the beginning the springs are relaxed."""
    if friction.slip is None:
        return None
    springs, ends = np.empty((len(q), *friction.slip.deflection.shape)), q[0]
    for k, here in enumerate(q):
        springs[k] = ends = friction.slip.next(ends, here)
    return springs

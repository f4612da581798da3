"""Limits of the joints, and the constraint channels that a search derives from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError, Finding, did_you_mean
from armid.excitation.limits.constraint_channels import (
    AmplitudeLimit,
    CoefficientLimit,
    ConstraintChannel,
    RangeLimit,
)
from armid.excitation.limits.torque_limits import Torque, TorqueModel
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.model.motion import Motion
from armid.robot.joint_selection import matching
from armid.robot.robot import Robot

KINDS = ("position", "velocity", "acceleration", "jerk", "effort")
"""Kinds of limits of a joint."""


@dataclass(frozen=True, eq=False, slots=True)
class Limits:
    """Limits of all joints; infinite where a joint has no limit.

    Attributes:
        joints: Names of the joints.
        lower: Lower position limits, shape (n,) [rad or m].
        upper: Upper position limits, shape (n,) [rad or m].
        velocity: Velocity limits, shape (n,) [rad/s or m/s].
        acceleration: Acceleration limits, shape (n,) [rad/s² or m/s²].
        jerk: Jerk limits, shape (n,) [rad/s³ or m/s³].
        effort: Limits of torque or force, shape (n,) [N·m or N].
    """

    joints: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    effort: Array

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "acceleration", "jerk", "effort"):
            value = array(getattr(self, name), (len(self.joints),), name, finite=False)
            object.__setattr__(self, name, value)
            if name not in ("lower", "upper") and not (value > 0.0).all():
                joint = self.joints[int(np.flatnonzero(~(value > 0.0))[0])]
                raise ArmidError(
                    f"The {name} limit of {joint} must be positive; found {value[self.joints.index(joint)]:g}.",
                    remedy=f"give a positive {name} limit for {joint}.",
                )
        empty = np.flatnonzero(~(self.lower < self.upper))
        if len(empty):
            j = int(empty[0])
            raise ArmidError(
                f"The position limits of {self.joints[j]} are reversed or equal: {self.lower[j]:g} to "
                f"{self.upper[j]:g}.",
                remedy="give a lower limit that is smaller than the upper one.",
            )

    def narrowed(self, motion: Motion, *, by_joint: bool = True) -> Limits:
        """Limits with velocity and acceleration limits reduced to the peak values of a motion.

        Args:
            motion: Motion whose peak values are used.
            by_joint: True if each joint is limited to its own peak values. If false, all joints are limited to the
                largest ratio of velocity and velocity limit, and to the largest acceleration, that any joint reaches
                in the motion.
        """
        tiny = np.finfo(float).tiny
        velocity, acceleration = (np.maximum(np.abs(x).max(axis=0), tiny) for x in (motion.dq, motion.ddq))
        if not by_joint:
            share = velocity / self.velocity
            velocity = share.max() * self.velocity if (share > 0.0).any() else np.full_like(share, velocity.max())
            acceleration = np.full_like(acceleration, acceleration.max())
        return replace(
            self,
            velocity=np.minimum(self.velocity, velocity),
            acceleration=np.minimum(self.acceleration, acceleration),
        )


def described_limits(robot: Robot) -> Limits:
    """Limits that the robot description gives; it contains no limits of acceleration and jerk."""
    lower, upper = np.array([joint.position_limits for joint in robot.joints]).T
    velocity = np.array([joint.velocity_limit for joint in robot.joints])
    effort = np.array([joint.effort_limit for joint in robot.joints])
    unknown = np.full(robot.n, np.inf)
    return Limits(robot.joint_names, lower, upper, velocity, unknown, unknown, effort)


def planned_limits(robot: Robot) -> Limits:
    """Limits of the robot description for a planned motion, with positions also within the soft limits."""
    limits = described_limits(robot)
    soft = np.array([joint.soft_limits for joint in robot.joints])
    return replace(limits, lower=np.maximum(limits.lower, soft[:, 0]), upper=np.minimum(limits.upper, soft[:, 1]))


def soft_limits_used(robot: Robot, limits: Limits) -> Finding | None:
    """Finding that names the joints whose positions are limited by soft limits; `None` if there are none."""
    planned, described = planned_limits(robot), described_limits(robot)
    bounded = [
        j for j in range(robot.n)
        if (limits.lower[j], limits.upper[j]) == (planned.lower[j], planned.upper[j])
        and (planned.lower[j], planned.upper[j]) != (described.lower[j], described.upper[j])
    ]  # fmt: skip
    if not bounded:
        return None
    ranges = ", ".join(
        f"{robot.joint_names[j]} {limits.lower[j]:.4g} to {limits.upper[j]:.4g} {robot.joints[j].unit} "
        f"(limit: {described.lower[j]:.4g} to {described.upper[j]:.4g})"
        for j in bounded
    )
    evidence = (
        "the robot's controller stops a joint at its soft limits (safety_controller in the description), so the plan "
        f"keeps within them: {ranges}"
    )
    remedy = "if other limits apply, set them with --limit JOINT.position=LOW:HIGH."
    return Finding("soft-limits", "info", "", evidence, remedy)


def limits_wider_than_described(robot: Robot, limits: Limits) -> Finding | None:
    """Finding about limits that are wider than those of the description; `None` if there are none.

    Args:
        robot: The arm.
        limits: Limits of a motion.
    """
    described, texts, joints = described_limits(robot), list[str](), list[str]()
    for j, joint in enumerate(robot.joints):
        wider: list[str] = []
        if limits.lower[j] < described.lower[j] or limits.upper[j] > described.upper[j]:
            asked, range_ = (f"{low[j]:.4g} to {high[j]:.4g}" for low, high in (
                (limits.lower, limits.upper), (described.lower, described.upper)
            ))  # fmt: skip
            wider.append(f"position {asked} {joint.unit} (described: {range_})")
        for kind, unit in (("velocity", f"{joint.unit}/s"), ("effort", joint.effort_unit)):
            given, known = (float(getattr(each, kind)[j]) for each in (limits, described))
            if given > known:
                wider.append(f"{kind} {given:.4g} {unit} (described: {known:.4g})")
        if wider:
            joints.append(joint.name)
            texts.append(f"{joint.name}: {', '.join(wider)}")
    if not joints:
        return None
    evidence = f"as requested, the plan may go beyond the limits of the description; {'; '.join(texts)}"
    remedy = (
        "check that the arm and its controller allow this, or give limits within the described ones with --limit."
    )
    return Finding("limit-beyond-description", "warning", ", ".join(joints), evidence, remedy)


def limits_of(
    robot: Robot,
    given: Mapping[tuple[str, str], float | tuple[float, float]] | None = None,
    *,
    acceleration: float | None = None,
    jerk: float | None = None,
) -> Limits:
    """Limits of a motion: given limits, otherwise those of the robot description including its soft limits.

    Args:
        robot: The arm.
        given: Limits by pair of joint and kind; a position limit is a pair of lower and upper limit. Joints are names
            or patterns such as `*`. A name takes precedence over a pattern, and a later pattern over an earlier one.
        acceleration: Acceleration limit of every joint [rad/s² or m/s²]; `None` for no limit.
        jerk: Jerk limit of every joint [rad/s³ or m/s³]; `None` for no limit.

    Raises:
        ArmidError: A joint or kind does not exist, or a joint has no limit of position or velocity. Continuous joints
            need no position limit.
    """
    values = _given(planned_limits(robot), robot, given or {}, acceleration, jerk)
    limits = Limits(robot.joint_names, **values)
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    without = [
        (joint.name, "position") for joint, ok in zip(robot.joints, bounded, strict=True)
        if not ok and joint.kind != "continuous"
    ]  # fmt: skip
    without += [(name, "velocity") for name, v in zip(limits.joints, limits.velocity, strict=True) if v == np.inf]
    if without:
        joints = {name for name, _ in without}
        unusable = [
            f"{each.channel}: {each.evidence}"
            for each in robot.findings
            if each.code == "limits-unknown" and each.channel in joints
        ]
        more = f" (and {len(unusable) - 1} joints alike)" if len(unusable) > 1 else ""
        stated = f" In the description: {unusable[0]}{more}." if unusable else ""
        raise ArmidError(
            f"A limit of position or velocity is missing for {robot.name}: {', '.join(map('.'.join, without))}."
            f"{stated}",
            remedy=_examples(without, robot.n),
        )
    return limits


def _given(
    described: Limits,
    robot: Robot,
    given: Mapping[tuple[str, str], float | tuple[float, float]],
    acceleration: float | None = None,
    jerk: float | None = None,
) -> dict[str, Array]:
    """Limits by kind, shape (n,) each: limits of the description, replaced by the given limits."""
    values = {
        "lower": described.lower.copy(),
        "upper": described.upper.copy(),
        "velocity": described.velocity.copy(),
        "acceleration": np.full(robot.n, np.inf if acceleration is None else acceleration),
        "jerk": np.full(robot.n, np.inf if jerk is None else jerk),
        "effort": described.effort.copy(),
    }
    names = robot.joint_names
    for (name, kind), value in sorted(given.items(), key=lambda each: each[0][0] in names):
        which = [names.index(each) for each in matching(name, names)] or [robot.joint_index(name)]
        if kind not in KINDS:
            raise ArmidError(
                f"There is no kind of limit {kind!r}.", possible=", ".join(KINDS), remedy=did_you_mean(kind, KINDS)
            )
        if kind == "position":
            if not isinstance(value, tuple):
                raise ArmidError(
                    f"The position limit of {name} needs a lower and an upper number; found {value}.",
                    remedy=f"write {name}.position=LOW:HIGH.",
                )
            values["lower"][which], values["upper"][which] = value
        else:
            values[kind][which] = value
    return values


def with_limits(robot: Robot, given: Mapping[tuple[str, str], float | tuple[float, float]]) -> Robot:
    """Robot whose limits are those of the description, replaced by the given limits.

    The arguments are those of `limits_of`.

    Raises:
        ArmidError: A joint or kind does not exist.
    """
    values = _given(described_limits(robot), robot, given)
    joints = [
        replace(
            joint,
            position_limits=np.array([values["lower"][j], values["upper"][j]]),
            velocity_limit=float(values["velocity"][j]),
            effort_limit=float(values["effort"][j]),
        )
        for j, joint in enumerate(robot.joints)
    ]
    return replace(robot, joints=tuple(joints))


def _examples(without: Sequence[tuple[str, str]], joints: int) -> str:
    """Text with command options that give the missing limits; patterns are used only if all joints lack a limit."""
    options: list[str] = []
    for kind, value in (("position", "-1.5:1.5"), ("velocity", "1.0")):
        missing = [name for name, lacking in without if lacking == kind]
        if missing:
            each = (
                [f"'*.{kind}={value}'"]
                if len(missing) == joints > 1
                else [f"{name}.{kind}={value}" for name in missing]
            )
            options.append(f"--limit {','.join(each)}")
    return f"give these limits, for instance {' '.join(options)}, in radians, metres and seconds."


def _finite(values: Array) -> NDArray[np.intp]:
    return np.flatnonzero(np.isfinite(values))


def motion_channels(limits: Limits) -> tuple[ConstraintChannel, ...]:
    """Constraint channels of the limits of position, velocity, acceleration and jerk, as far as limits are known."""
    names = limits.joints
    bounded = _finite(limits.upper - limits.lower)
    low, high = limits.lower[bounded], limits.upper[bounded]
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    result: list[ConstraintChannel] = []
    if len(bounded):
        labels = tuple(names[j] for j in bounded)
        result.append(RangeLimit("position", 0, tuple(bounded.tolist()), labels, middle, half))
    for order, kind in enumerate(("velocity", "acceleration", "jerk"), 1):
        values: Array = getattr(limits, kind)
        limited = _finite(values)
        if len(limited):
            labels, middle = tuple(names[j] for j in limited), np.zeros(len(limited))
            result.append(RangeLimit(kind, order, tuple(limited.tolist()), labels, middle, values[limited]))
    return tuple(result)


def thesis_channels(
    limits: Limits, basis: SeriesBasis, *, form: Literal["thesis", "thesis-literal"] = "thesis"
) -> tuple[ConstraintChannel, ...]:
    """Constraint channels of equations (3.55d) to (3.55f) of the thesis: sums of amplitudes bound the motion.

    The thesis prints (3.55f) with a factor 1/L, but its tables violate this condition. Without the factor, (3.55f)
    follows from (3.55d) and (3.55e) and is not needed. With the form `thesis-literal`, (3.55f) is enforced as
    printed.

    Args:
        limits: Limits of the joints.
        basis: Basis of the series, with its start pose.
        form: `thesis` for (3.55d) and (3.55e); `thesis-literal` for (3.55f) as printed in addition.
    """
    reach = np.minimum(limits.upper - basis.start, basis.start - limits.lower)
    bounded, moving = _finite(reach), _finite(limits.velocity)
    names = limits.joints

    def of(joints: NDArray[np.intp]) -> tuple[tuple[int, ...], tuple[str, ...]]:
        return tuple(joints.tolist()), tuple(names[j] for j in joints)

    result: list[ConstraintChannel] = [
        AmplitudeLimit("position", 0, *of(bounded), reach[bounded]),
        AmplitudeLimit("velocity", 1, *of(moving), limits.velocity[moving]),
    ]
    if form == "thesis-literal":
        number, L = np.arange(1, basis.harmonics + 1), basis.harmonics
        limit = np.minimum(number * (basis.base_frequency / L) * reach[:, None], limits.velocity[:, None])
        every = np.arange(len(names))
        labels = tuple(name for name in names for _ in range(2 * L))
        result.append(CoefficientLimit("coefficients", tuple(every.tolist()), labels, limit))
    return tuple(result)


def torque_channel(limits: Limits, base: Array, margin: float, described: TorqueModel | None = None) -> Torque | None:
    """Constraint channel of the torque, with a margin to the limits; `None` if no torque limit is known.

    Args:
        limits: Limits of the joints.
        base: Base parameters (of the description or identified), shape (b,).
        margin: Share of the limit that must not be used, from 0 to below 1.
        described: Model to which the base parameters belong; the model of the goal if not given.

    Raises:
        ArmidError: The margin is negative, or is 1 or larger.
    """
    if not 0.0 <= margin < 1.0:
        raise ArmidError(
            f"The torque margin is a share of the limit, at least 0 and below 1; found {margin}.",
            remedy="give for instance 0.1, with which the plan uses at most 90 % of each torque limit.",
        )
    known = _finite(limits.effort)
    if not len(known):
        return None
    return Torque(
        "torque", tuple(known.tolist()), tuple(limits.joints[j] for j in known), base,
        (1.0 - margin) * limits.effort[known], described,
    )  # fmt: skip

"""Options of a design: goal of the motion, constraints on the motion, and budget of the search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armid.checked_array import Array
from armid.excitation.collision.ignored_pairs import IgnoredBodies
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import Limits, limits_of
from armid.excitation.limits.torque_limits import EstimatedTorque
from armid.excitation.limits.workspace import Workspace
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.study.plans.surroundings import AssumedFloor

LIMIT_KINDS = ("true", "thesis", "thesis-literal")
"""Forms of position and velocity limits: `true` limits the motion itself; the other two limit sums of amplitudes
(equations 3.55d to 3.55f of the thesis)."""


@dataclass(frozen=True, eq=False, slots=True)
class DesignGoal:
    """Goal of a designed motion.

    Attributes:
        goal: Model, and criterion that the design minimises.
        duration: Length of a period [s].
        harmonics: Number of harmonics of the series.
        start: Start pose, shape (n,) [rad or m]; armid chooses one if it is not given.
        free_start: True if the search also chooses the start pose, as one of its unknowns.
        free_centre: True if joints may oscillate about a pose other than the start pose, which equation (3.55c) of
            the thesis excludes.
        begin: Pose of the arm before the motion, shape (n,) [rad or m]; the start pose if not given.
        end: Pose of the arm after the motion, shape (n,) [rad or m]; the start pose if not given.
    """

    goal: CriterionGoal
    duration: float = 20.0
    harmonics: int = 10
    start: Array | None = None
    free_start: bool = False
    free_centre: bool = False
    begin: Array | None = None
    end: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class DesignConstraints:
    """Constraints on the motion.

    Attributes:
        limits: One of `LIMIT_KINDS`.
        given: Limits that replace the limits of the description, by joint and kind of limit.
        acceleration: Limit of the acceleration of every joint [rad/s² or m/s²]; no limit if not given.
        jerk: Limit of the jerk of every joint [rad/s³ or m/s³]; no limit if not given.
        torque_margin: Share of the torque limits that must stay unused; if `None`, torque is not limited.
        estimate: Estimate from which torque is computed; if not given, torque is computed from the description.
        clearance: Smallest allowed distance between bodies [m]; if `None`, collisions are not checked.
        surroundings: Fixed bodies around the arm.
        floor: Assumed floor; it is ignored if the arm does not start above it.
        workspace: Region in which the tip must stay.
        envelope: Motion whose velocities and accelerations must not be exceeded.
        envelope_by_joint: True if each joint is limited to its own values in `envelope`; otherwise all joints are
            limited to the largest values of any joint.
        ignored: Pairs of bodies that are not checked.
    """

    limits: str = "true"
    given: Mapping[tuple[str, str], float | tuple[float, float]] = field(default_factory=dict)  # pyright: ignore
    acceleration: float | None = None
    jerk: float | None = None
    torque_margin: float | None = 0.1
    estimate: EstimatedTorque | None = None
    clearance: float | None = None
    surroundings: tuple[Shape, ...] = ()
    floor: AssumedFloor | None = None
    workspace: Workspace | None = None
    envelope: Motion | None = None
    envelope_by_joint: bool = True
    ignored: tuple[IgnoredBodies, ...] = ()


@dataclass(frozen=True, slots=True)
class SearchBudget:
    """Budget of the search for the best plan.

    Attributes:
        budget: Wall time of the search [s]; `None` if only `rounds` limits the search.
        seed: Seed of the random starting points.
        workers: Number of processes; with 0 the search runs in the present process.
        rounds: Largest number of rounds of the search; `None` if only `budget` limits the search.
    """

    budget: float | None = 30.0
    seed: int = 1
    workers: int = 2
    rounds: int | None = None


def constrained_limits(robot: Robot, constraints: DesignConstraints) -> Limits:
    """Limits of the joints for a design; velocities and accelerations of a given envelope are limits, too."""
    limits = limits_of(robot, constraints.given, acceleration=constraints.acceleration, jerk=constraints.jerk)
    if constraints.envelope is None:
        return limits
    return limits.narrowed(constraints.envelope, by_joint=constraints.envelope_by_joint)

"""Wishes for a motion, what it must keep to, and how long is looked for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.workspace import Workspace
from armid.model.motion import Motion
from armid.robot.shapes import Shape
from armid.study.plans.surroundings import AssumedFloor
from armid.values import Array

__all__ = ["LIMIT_KINDS", "DesignConstraints", "DesignGoal", "SearchBudget"]

LIMIT_KINDS = ("true", "thesis", "thesis-literal")
"""What position and velocity limits apply to: the motion itself, or sums of amplitudes as in (3.55d-f)."""


@dataclass(frozen=True, eq=False, slots=True)
class DesignGoal:
    """Wish for the motion.

    Attributes:
        goal: What it is for.
        duration: Length of a period [s].
        harmonics: Number of harmonics.
        start: Start pose, shape (n,) [rad or m]; found where not given.
        free_start: Whether the start pose is among the unknowns.
        free_centre: Whether joints may swing about another pose than the start, which (3.55c) has them not do.
        begin: Pose that the arm comes from, shape (n,); the start where not given.
        end: Pose that it goes to afterwards, shape (n,); the start where not given.
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
    """Rules that the motion must keep to.

    Attributes:
        limits: One of `LIMIT_KINDS`.
        given: Limits by joint and kind in the place of the description's.
        acceleration: Of every joint [rad/s² or m/s²]; none where not given.
        jerk: Of every joint [rad/s³ or m/s³]; none where not given.
        torque_margin: Share of the torque limits that is kept free; `None` leaves torque out.
        parameters: Base parameters for torque, of an identification, shape (b,); the description's where not given.
        clearance: Distance that bodies keep [m]; `None` leaves collisions out.
        surroundings: Bodies that do not move.
        floor: One that is assumed, and left out where the arm does not start above it.
        workspace: Where the tip may be.
        envelope: A motion whose velocity and acceleration are not exceeded.
        envelope_by_joint: Whether each joint keeps to its own, or all to the highest of any joint.
    """

    limits: str = "true"
    given: Mapping[tuple[str, str], float | tuple[float, float]] = field(default_factory=dict)  # pyright: ignore
    acceleration: float | None = None
    jerk: float | None = None
    torque_margin: float | None = 0.1
    parameters: Array | None = None
    clearance: float | None = None
    surroundings: tuple[Shape, ...] = ()
    floor: AssumedFloor | None = None
    workspace: Workspace | None = None
    envelope: Motion | None = None
    envelope_by_joint: bool = True


@dataclass(frozen=True, slots=True)
class SearchBudget:
    """Effort of the search.

    Attributes:
        budget: Wall time of the search [s]; `None` for no end other than `rounds`.
        seed: Of the starts.
        workers: Processes; 0 searches in this one.
        rounds: Whole rounds at most.
    """

    budget: float | None = 30.0
    seed: int = 1
    workers: int = 2
    rounds: int | None = None

"""Goal of a designed motion, its constraints, and the budget of the search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from armid.excitation.collision.ignored_pairs import IgnoredBodies
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.workspace import Workspace
from armid.model.motion import Motion
from armid.robot.shapes import Shape
from armid.study.plans.surroundings import AssumedFloor
from armid.values import Array

LIMIT_KINDS = ("true", "thesis", "thesis-literal")
"""Forms of position and velocity limits: on the motion itself, or on sums of amplitudes as in (3.55d-f)."""


@dataclass(frozen=True, eq=False, slots=True)
class DesignGoal:
    """Goal of a designed motion.

    Attributes:
        goal: Model and criterion.
        duration: Length of a period [s].
        harmonics: Number of harmonics.
        start: Start pose, shape (n,) [rad or m]; chosen automatically if not given.
        free_start: Whether the start pose is among the unknowns.
        free_centre: Whether joints may oscillate about another pose than the start, which (3.55c) excludes.
        begin: Pose from which the arm comes, shape (n,); the start if not given.
        end: Pose to which it goes afterwards, shape (n,); the start if not given.
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
        given: Limits by joint and kind that replace the description's.
        acceleration: Of every joint [rad/s² or m/s²]; none where not given.
        jerk: Of every joint [rad/s³ or m/s³]; none where not given.
        torque_margin: Share of the torque limits that is kept free; `None` does not limit torque.
        parameters: Identified base parameters for torque, shape (b,); the description's if not given.
        clearance: Smallest distance between bodies [m]; `None` does not check collisions.
        surroundings: Bodies that do not move.
        floor: Assumed floor, ignored where the arm does not start above it.
        workspace: Region that the tip must stay in.
        envelope: Motion whose velocity and acceleration are not exceeded.
        envelope_by_joint: Whether the envelope applies joint by joint, or as the maximum over all joints.
        ignored: Pairs of bodies that are not checked.
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
    ignored: tuple[IgnoredBodies, ...] = ()


@dataclass(frozen=True, slots=True)
class SearchBudget:
    """Budget of the search.

    Attributes:
        budget: Wall time of the search [s]; `None` if only `rounds` ends it.
        seed: Seed of the random starts.
        workers: Number of processes; 0 searches in the present one.
        rounds: Largest number of rounds.
    """

    budget: float | None = 30.0
    seed: int = 1
    workers: int = 2
    rounds: int | None = None

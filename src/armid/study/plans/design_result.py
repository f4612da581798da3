"""Result of the design of a periodic motion: plan, search, preflight check and findings."""

from __future__ import annotations

from dataclasses import dataclass

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.certification import Margin
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.design.multistart import Search
from armid.excitation.design.sqp import DescentProblem
from armid.excitation.limits.joint_limits import (
    Limits,
)
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.plan import Plan
from armid.excitation.preflight import Expectation, Preflight, worst
from armid.notebook_display import Displayed, Summary
from armid.robot.robot import Robot

SPREAD = 200.0
"""Rate at which extreme positions and accelerations of a motion are sampled [Hz]."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Designed(Displayed):
    """Result of the design of a periodic motion.

    Attributes:
        plan: The designed plan.
        problem: The optimisation problem, with constraints for all pairs of bodies.
        x: Unknowns of the plan, shape (n k,), with k unknowns of each joint.
        limits: Limits of the joints.
        search: Result of the search for the best motion.
        preflight: Check of the plan against all limits.
        findings: Findings of the design.
        collision: Pairs of bodies that must keep a distance; `None` if collisions are not checked.
    """

    plan: Plan
    problem: DescentProblem
    x: Array
    limits: Limits
    search: Search
    preflight: Preflight
    findings: tuple[Finding, ...]
    collision: CollisionOptions | None = None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.problem.goal.model.robot

    @property
    def start(self) -> Array:
        """Pose at the beginning of the series, shape (n,) [rad or m]."""
        return self.plan.excitation.at([0.0]).q[0]

    @property
    def expected(self) -> Expectation:
        """Predicted uncertainty of the parameters after a recording of the plan."""
        assert self.preflight.expected is not None
        return self.preflight.expected

    @property
    def torque(self) -> Torque | None:
        """Constraint channel of the torque limits; `None` if torque is not checked."""
        return next((each for each in self.problem.channels if isinstance(each, Torque)), None)

    @property
    def heading(self) -> str:
        """Text with the number of harmonics, the period, the number of repetitions and the duration of the plan."""
        plan, series = self.plan, self.plan.excitation
        times = "once" if plan.repetitions == 1 else f"{plan.repetitions} times"
        leads = (
            f"; {plan.duration:.1f} s with the motions to and from the start pose"
            if plan.lead_in + plan.lead_out
            else ""
        )
        return f"{series.harmonics} harmonics over {series.period:g} s, {times}{leads}"

    def spread(self, margin: Margin) -> tuple[float, float, float, float] | None:
        """Lowest and highest position [rad or m] of the joint of a position limit, then its lower and upper limit.

        The result is `None` if the margin belongs to another kind of limit.
        """
        if margin.limit != "position" or margin.label not in self.limits.joints:
            return None
        j, series = self.limits.joints.index(margin.label), self.plan.excitation
        q = series.sample(SPREAD).q[:, j]
        low, high = min(float(q.min()), margin.value), max(float(q.max()), margin.value)
        return low, high, float(self.limits.lower[j]), float(self.limits.upper[j])

    def summary(self) -> Summary:
        """Summary with the smallest margin between the plan and each kind of limit."""
        rows = tuple(
            (each.limit, each.label, f"{each.value:.4g} of {each.bound:.4g} {each.unit}", f"{each.certified:.1%}")
            for each in worst(self.preflight.margins)
        )
        note = f"expected condition number {self.expected.condition:.4g}; {len(self.findings)} findings"
        return Summary(self.plan.summary().title, ("limit", "of", "nearest", "certified"), rows, note)

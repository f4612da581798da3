"""Finding for a plan in which some joints stay well below their limits because of collisions or other limits.

The amplitude of each joint that stays well below all its own limits is enlarged up to the first of these limits.
Bodies that then come too close, and limits that are then exceeded, are the reason why the amplitudes of the plan are
small. The loss of accuracy is the ratio of the predicted standard deviations of the parameters: those for the plan,
divided by those for the enlarged motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.certification import Margin
from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import Objective
from armid.excitation.design.sqp import DescentProblem, about_start, utilisation
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics

USED = 0.75
"""Largest utilisation of each of its own limits at which a joint counts as well below its limits."""

LARGEST = 5.0
"""Largest factor by which the amplitude of a joint is enlarged."""

COST = 1.3
"""Smallest loss of accuracy for which a finding is made. The loss is the standard deviation of a base parameter for
the plan, divided by its standard deviation for the enlarged motion (median over the parameters)."""

PARTS = np.linspace(0.1, 1.0, 10)
"""Shares of the enlargement of the amplitudes at which the limits are evaluated, to find the limits that are exceeded
first."""

TESTED = 10.0
"""Rate at which limits and distances of bodies are evaluated along the enlarged motions [Hz]."""

NAMED = 3
"""Largest number of limits and pairs of bodies that the finding names."""

REMEDIES = {
    "torque": "--limit JOINT.effort=VALUE or --torque-margin",
    "velocity": "--limit JOINT.velocity=VALUE",
    "acceleration": "--acceleration or --limit JOINT.acceleration=VALUE",
    "jerk": "--jerk or --limit JOINT.jerk=VALUE",
    "tip": "--tip-box",
}
"""Options of `armid excite` that relax a limit, by the kind of the limit."""


@dataclass(frozen=True, slots=True)
class Restraint:
    """Limit that an enlarged motion exceeds.

    Attributes:
        limit: Kind of the limit, for instance `velocity`; `collision` for the distance of two bodies.
        label: Name of the joint, of the plane or of the pair of bodies that has the limit.
        required: Required distance of two bodies [m]; zero if the limit is not a distance.
        part: Share of the enlargement of the amplitudes at which the limit is first exceeded, from 0 (the plan) to 1.
    """

    limit: str
    label: str | BodyPair
    required: float
    part: float

    @property
    def text(self) -> str:
        """Text that names the kind of the limit, and the joint, plane or pair of bodies to which it belongs."""
        if self.limit == "collision":
            return f"the distance of {self.label} ({1000.0 * self.required:.1f} mm required)"
        return f"the limit of {self.limit} of {self.label}"


def restrained_motion(
    problem: DescentProblem, x: Array, margins: Sequence[Margin], collision: CollisionOptions | None
) -> Finding | None:
    """Finding about joints that stay well below their limits, with the reason and the loss of accuracy.

    Args:
        problem: Criterion and limits of the design.
        x: Unknowns of the plan, shape (n k,), with k unknowns of each joint.
        margins: Margins between the plan and all limits.
        collision: Pairs of bodies that must keep a distance; `None` for no collision check.

    Returns:
        The finding; `None` if all joints come near their limits, if no other limit restrains the motion, or if the
        loss of accuracy is small.
    """
    goal, basis = problem.goal, problem.basis
    names = goal.model.robot.joint_names
    used = np.array([max((m.share for m in margins if m.label == name), default=1.0) for name in names])
    held = np.flatnonzero((used < USED) & (used > 0.0))
    if not len(held):
        return None
    factors = np.ones(basis.n)
    factors[held] = np.minimum(1.0 / used[held], LARGEST)
    grid = Objective(goal, basis, max(round(goal.rate * basis.period), 40 * basis.harmonics))
    larger = about_start(basis, x, factors)
    cost = float(np.median(_deviations(grid, x) / _deviations(grid, larger)))
    restraints = _restraints(problem, x, factors, collision) if cost >= COST else []
    if not restraints:
        return None
    shares = ", ".join(f"{names[j]} {100.0 * used[j]:.0f} %" for j in held[np.argsort(used[held])])
    evidence = (
        f"{' and '.join(each.text for each in restraints)} {'keep' if len(restraints) > 1 else 'keeps'} joints well "
        f"below their own limits (largest share of any limit: {shares}); if these joints reached their limits, the "
        f"standard deviations of the parameters would be smaller by a factor of {cost:.1f}"
    )
    return Finding("motion-restrained", "warning", ", ".join(names[j] for j in held), evidence, _remedy(restraints))


def _deviations(grid: Objective, x: Array) -> Array:
    """Predicted standard deviations (b,) of the base parameters for the series with unknowns x, shape (n k,)."""
    return np.sqrt(np.maximum(np.diag(np.linalg.inv(grid.information(x))), np.finfo(float).tiny))


def _restraints(
    problem: DescentProblem, x: Array, factors: Array, collision: CollisionOptions | None
) -> list[Restraint]:
    """Limits that are exceeded first if the amplitudes of the joints grow up to the factors (n,), at most `NAMED`.

    The result is empty if neither the distance of a pair of bodies nor a limit of another joint is violated before
    the enlargement is complete.
    """
    basis, robot = problem.basis, problem.goal.model.robot
    grid = problem.grid(max(100, round(TESTED * basis.period)))
    found: dict[tuple[str, str], Restraint] = {}
    for part in PARTS.tolist():
        enlarged = about_start(basis, x, 1.0 + part * (factors - 1.0))
        for channel, values in zip(problem.channels, utilisation(problem, grid, enlarged), strict=True):
            required = channel.margins if isinstance(channel, Clearance) else np.zeros(len(channel.labels))
            for label, most, asked in zip(channel.labels, values.max(axis=0), required, strict=True):
                if most > 1.0:
                    found.setdefault((channel.name, label), Restraint(channel.name, label, float(asked), part))
        if collision is not None:
            poses = forward_kinematics(robot, basis.excitation(enlarged).at(grid.times).q)
            for pair, kept in zip(collision.measured, collision.required_distances, strict=True):
                label = BodyPair(*(collision.shapes[k].name for k in pair))
                if ("collision", label) not in found and too_close(collision.shapes, pair, kept, poses).any():
                    found["collision", label] = Restraint("collision", label, float(kept), part)
    first = sorted((each for each in found.values() if each.part < 1.0), key=lambda each: each.part)
    return [each for each in first[:NAMED] if each.part == first[0].part]


def _remedy(restraints: Sequence[Restraint]) -> str:
    """Text with the options that relax the exceeded limits, or exclude pairs of bodies that restrain the motion."""
    ways: list[str] = []
    for each in restraints:
        if isinstance(each.label, BodyPair):
            pair = f"{each.label.first},{each.label.second}"
            ways.append(f"--ignore-pair '{pair}', if these bodies are larger in the description than in reality")
    required = max((each.required for each in restraints), default=0.0)
    ways += [f"a --clearance below {required:.2g} (in metres)"] * (required > 0.0)
    ways += ["--floor HEIGHT or --no-floor"] * any("floor" in each.label for each in restraints)
    ways += list(dict.fromkeys(REMEDIES[each.limit] for each in restraints if each.limit in REMEDIES))
    return f"try {'; '.join([*ways, 'another start pose with --start, or --free-start'])}."

"""Preflight check of a plan: margins to the limits, closest approaches of bodies, predicted standard deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.certification import Margin, fine_grid, margins
from armid.excitation.collision.closest_approach import RATE, ROUNDING, ClosestApproach, closest_approaches
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.ignored_pairs import IgnoredPair
from armid.excitation.collision.unchecked_contacts import LeftOutContact, contacts_found, left_out_contacts
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.design.sqp import DescentProblem
from armid.model.parameter_name import ParameterName
from armid.notebook_display import plural

Verdict = Literal["pass", "fail", "weak", "not checked"]

NAMED = 3
"""Largest number of limits, pairs of bodies or joints that a sentence names."""


@dataclass(frozen=True, eq=False, slots=True)
class Expectation:
    """Predicted uncertainty of the parameters, if the model is correct and the noise is white.

    Attributes:
        names: Names of the base parameters.
        units: Units of the base parameters.
        deviation: Standard deviations of the base parameters, shape (b,).
        torque: Standard deviation of the predicted torque of each joint, RMS over the plan, shape (n,) [N·m or N].
        condition: Condition number of the stacked regressor of one repetition, as in equation (3.55a) of the thesis.
        log_det: Logarithm of the determinant of the information matrix.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    deviation: Array
    torque: Array
    condition: float
    log_det: float


@dataclass(frozen=True, eq=False, slots=True)
class Preflight:
    """Result of the preflight check of a plan.

    Attributes:
        margins: Margins between the plan and all limits, joint by joint.
        approaches: Closest approach of every pair of bodies, nearest first.
        skipped: Pairs of bodies that are not checked, because they touch by construction or the user has excluded
            them.
        expected: Predicted uncertainty of the parameters; `None` for poses and sweeps.
        unchecked: Reason why collisions are not checked; empty if they are checked.
        weak: Finding that the motion is too weak to identify the arm; `None` if the motion is sufficient.
        wider: Finding about limits that are wider than those of the description; `None` if there are none.
        touching: Contacts in the motion between bodies of pairs that are not checked.
        torque_lacks: Contributions, for instance `friction`, that are missing in the torque that is compared with the
            limits; empty if none are missing, or if torque is not checked.
        clearance: Distance between bodies that the user requires [m]; pairs that are close by construction have
            smaller required distances.
    """

    margins: tuple[Margin, ...]
    approaches: tuple[ClosestApproach, ...]
    skipped: tuple[IgnoredPair, ...]
    expected: Expectation | None
    unchecked: str = ""
    weak: Finding | None = None
    wider: Finding | None = None
    touching: tuple[LeftOutContact, ...] = ()
    torque_lacks: str = ""
    clearance: float = 0.0

    @property
    def verdict(self) -> Verdict:
        """Verdict on the plan.

        `fail`: a limit is exceeded, or bodies are too close. `weak`: the motion cannot identify the arm. `not
        checked`: collisions are not checked. Otherwise `pass`.
        """
        if self._missed or self._close:
            return "fail"
        if self.weak is not None:
            return "weak"
        return "not checked" if self.unchecked else "pass"

    @property
    def sentence(self) -> str:
        """Verdict on the plan as text: limits and distances that are not kept, or the statement that all are kept."""
        failures = [
            f"the limit of {each.limit} of {each.label} is exceeded: {each.value:.4g} {each.unit}"
            for each in self._missed
        ]
        failures += [
            f"the distance of {each.pair} is {1000.0 * each.distance:.0f} mm at {each.time:.2f} s, less than the "
            f"required {1000.0 * each.required_distance:.0f} mm"
            for each in self._close
        ]
        if failures:
            more = f"; {len(failures) - NAMED} more" if len(failures) > NAMED else ""
            return "; ".join(failures[:NAMED]) + more
        weak = "" if self.weak is None else f"; but the motion is too weak to identify {_some(self.weak.channel)}"
        wider = "" if self.wider is None else f"; limits of {_some(self.wider.channel)} are wider than described"
        limits = f"every limit holds{f' (torque without {self.torque_lacks})' if self.torque_lacks else ''}"
        if self.unchecked:
            return f"{limits}; collisions not checked: {self.unchecked}{wider}{weak}"
        return f"{limits}, and {self._apart}{wider}{weak}"

    @property
    def reduced(self) -> tuple[ClosestApproach, ...]:
        """Closest approaches below the clearance, of pairs whose required distance is smaller than the clearance."""
        least = self.clearance - ROUNDING
        return tuple(each for each in self.approaches if each.required_distance < least and each.distance < least)

    @property
    def reduced_clearance(self) -> Finding | None:
        """Finding about pairs that are, and may be, closer than the clearance; `None` if there are none."""
        if not self.reduced:
            return None
        pairs = "; ".join(
            f"{each.pair} {1000.0 * each.distance:.0f} mm "
            f"(at least {1000.0 * each.required_distance:.1f} mm required)"
            for each in self.reduced
        )
        evidence = (
            "pairs of links that are close to each other by construction need not keep the clearance of "
            f"{1000.0 * self.clearance:.0f} mm, and are closer in this plan: {pairs}"
        )
        return Finding("clearance-reduced", "info", "", evidence, "look at these pairs in the preview.")

    @property
    def _reduction(self) -> str:
        """Text with the number of pairs that are closer than the clearance, and their smallest required distance."""
        if not self.reduced:
            return ""
        least = 1000.0 * min(each.required_distance for each in self.reduced)
        return (
            f", {plural(len(self.reduced), 'pair')} at {least:.1f} mm or more instead of the clearance of "
            f"{1000.0 * self.clearance:.0f} mm"
        )

    @property
    def _apart(self) -> str:
        """Text on the distances of the bodies, with the number of unchecked pairs for each reason."""
        if not self.skipped:
            return f"bodies keep apart{self._reduction}"
        asked = sum(bool(each.reason) for each in self.skipped)
        adjacent = sum(not each.reason and each.adjacent for each in self.skipped)
        others = len(self.skipped) - asked - adjacent
        counts = {"of adjacent links": adjacent, "as requested": asked, "close by construction": others}
        parts = [f"{plural(count, 'pair')} {reason}" for reason, count in counts.items() if count]
        touch = (
            f"; in this plan {len(self.touching)} of these touch{'es' * (len(self.touching) == 1)}"
            if self.touching
            else ""
        )
        checked = f"checked bodies keep apart{self._reduction}" if self.approaches else "no pair of bodies is checked"
        return f"{checked} (not checked: {', '.join(parts)}{touch})"

    @property
    def contacts(self) -> Finding | None:
        """Finding about bodies that touch although their distance is not checked; `None` if there are none."""
        return contacts_found(self.touching)

    @property
    def remarks(self) -> tuple[Finding | None, ...]:
        """Findings about contacts of unchecked pairs and about reduced clearance; `None` for a missing one."""
        return self.contacts, self.reduced_clearance

    @property
    def _missed(self) -> list[Margin]:
        return [margin for margin in self.margins if margin.certified > 1.0]

    @property
    def _close(self) -> list[ClosestApproach]:
        return [each for each in self.approaches if not each.is_sufficient]


def _some(joints: str) -> str:
    """Text with the first names of a comma-separated list, and the number of the others."""
    names = joints.split(", ")
    return ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")


def expectation(goal: CriterionGoal, objective: Objective, x: Array) -> Expectation:
    """Predicted uncertainty of the parameters for a plan, with the noise and the repetitions of a goal.

    Args:
        goal: Criterion goal, with noise, repetitions and prior information.
        objective: Objective on a grid, with laws that are not smoothed.
        x: Unknowns of the plan, shape (n k,).
    """
    G = objective.information(x)
    covariance = np.linalg.inv(G)
    columns: Columns = objective.columns
    torque: list[float] = []
    plain = np.zeros_like(G)
    samples = len(objective.times)
    for j in range(goal.model.n):
        of_joint = columns.information(np.eye(goal.model.n)[j]) / samples
        plain += of_joint
        torque.append(math.sqrt(max(float((of_joint * covariance).sum()), 0.0)))
    values = np.linalg.eigvalsh(plain)
    return Expectation(
        goal.base.names,
        goal.base.units,
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        np.array(torque),
        float(np.sqrt(values[-1] / max(values[0], np.finfo(float).tiny))),
        float(np.linalg.slogdet(G)[1]),
    )


def preflight(
    problem: DescentProblem,
    x: Array,
    collision: CollisionOptions | None,
    limits: tuple[Margin, ...] | None = None,
    unchecked: str = "",
) -> Preflight:
    """Checks a plan: limits on the fine grid, collisions with Coal, and predicted uncertainty of the parameters.

    Args:
        problem: Criterion and limits of the design.
        x: Unknowns of the plan, shape (n k,).
        collision: Pairs of bodies that must keep a distance; `None` for no collision check.
        limits: Margins between the plan and the limits; computed if not given.
        unchecked: Reason why collisions are not checked; empty if they are checked.
    """
    goal, basis = problem.goal, problem.basis
    samples = max(round(goal.rate * basis.period), 40 * basis.harmonics)
    approaches: tuple[ClosestApproach, ...] = ()
    touching: tuple[LeftOutContact, ...] = ()
    if collision is not None:
        times = basis.times(max(100, round(RATE * basis.period)))
        q = basis.excitation(x).at(times).q
        approaches = closest_approaches(collision, goal.model.robot, times, q)
        touching = left_out_contacts(collision, goal.model.robot, times, q)
    return Preflight(
        margins(problem, fine_grid(problem), x) if limits is None else limits,
        approaches,
        () if collision is None else collision.unchecked,
        expectation(goal, Objective(goal, basis, samples), x),
        unchecked,
        touching=touching,
        clearance=0.0 if collision is None else collision.clearance,
    )


def worst(found: Sequence[Margin]) -> tuple[Margin, ...]:
    """Margin with the largest utilisation for each kind of limit, for instance for `velocity`."""
    names = dict.fromkeys(margin.limit for margin in found)
    return tuple(max((m for m in found if m.limit == name), key=lambda m: m.share) for name in names)

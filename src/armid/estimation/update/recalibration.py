"""An earlier estimate brought up to date: what may have changed from new recordings, the rest from both."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.estimate import collapse
from armid.estimation.fit import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.update.joint_solution import JointSolution, solve_joined
from armid.estimation.update.stacked_problem import stack_problems
from armid.information.information import Information, JointFactors, merge
from armid.values import Array

__all__ = ["ParameterChange", "Recalibrated", "recalibrate_fit"]


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A base parameter before and after.

    Attributes:
        name: The parameter.
        before: Its earlier value.
        after: Its new value.
        change: The difference. What changed freely is compared within the solution of both recordings, so that what
            they share, scales of torque as well, cancels; that can differ a little from after less before.
        deviation: Standard deviation of the change.
        beyond: Whether the change is outside its 95 % interval.
    """

    name: str
    before: float
    after: float
    change: float
    deviation: float
    beyond: bool

    @property
    def ratio(self) -> float:
        """The change in standard deviations."""
        return abs(self.change) / self.deviation if self.deviation > 0.0 else 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Recalibrated:
    """A new estimate beside the earlier one.

    Attributes:
        fit: The new estimate.
        information: Factors whose least-squares estimate it is: those of the new recordings, and the earlier ones as
            they would be with what has changed.
        changes: Every base parameter before and after.
    """

    fit: Fit
    information: Information
    changes: tuple[ParameterChange, ...]


def recalibrate_fit(
    earlier: Information,
    fit: Fit,
    new: Information,
    own: NDArray[np.bool_],
    tool: Array | None = None,
    samples: EstimationProblem | None = None,
) -> Recalibrated:
    """Estimate anew.

    Args:
        earlier: Factors that the earlier estimate was made from.
        fit: The earlier estimate.
        new: Factors of the new recordings.
        own: Which base parameters may have changed freely, shape (b,).
        tool: What ten parameters of another tool add to the base parameters, shape (b, 10); `None` for the same tool.
        samples: The new recordings with their samples.

    Raises:
        EstimationError: The new recordings do not show what the tool changes.
    """
    joined = stack_problems(earlier, fit, new, own, tool, samples)
    solved = solve_joined(joined)
    to_new = joined.to_new
    hidden = np.abs(to_new @ solved.unseen.T).max(axis=1, initial=0.0) > 0.0
    if hidden.any():
        names = ", ".join(name for name, each in zip(new.names, hidden, strict=True) if each)
        raise EstimationError(
            f"The recordings do not determine what has become of {names}.",
            remedy="move every joint through wide angles, or let less change (without --tool or --all).",
        )
    found = _fit(new, to_new, solved)
    moved = to_new - joined.before
    changes = _changes(new.names, fit, found, moved, solved)
    shifted = earlier if own.all() else _shifted(earlier, joined.information.names, found.values, solved.values)
    last = int(shifted.recording.max(initial=-1)) + 1
    runs = new.run + 1 + int(shifted.run.max(initial=-1))
    latest = replace(new, recording=new.recording + last, run=runs)
    return Recalibrated(found, new if own.all() else merge([shifted, latest]), changes)


def _fit(new: Information, to_new: Array, solved: JointSolution) -> Fit:
    """The new estimate in base parameters, with the residual of the new recordings: the arm is as they show it."""
    part = np.abs(to_new) / np.abs(to_new).sum(axis=1, keepdims=True)
    values = to_new @ solved.values
    rows, moved = new.rows.sum(axis=0), solved.fit.report.moved
    left = np.sqrt(held_out_squares(new, values) / np.maximum(rows, 1))
    return replace(
        solved.fit,
        names=new.names,
        values=values,
        residual_rms=np.where(rows > 0, left, solved.fit.residual_rms),
        deviation=np.sqrt(np.diag(to_new @ solved.white @ to_new.T)),
        covariance=to_new @ solved.whole_covariance @ to_new.T,
        freedom=part @ solved.freedom[: len(solved.values)],
        prior_precision=None,
        report=replace(solved.fit.report, moved=to_new @ moved if len(moved) else moved),
    )


def _changes(
    names: tuple[str, ...], fit: Fit, found: Fit, moved: Array, solved: JointSolution
) -> tuple[ParameterChange, ...]:
    """Every parameter before and after, and whether the difference is more than chance.

    For what changed freely the deviation of the difference follows from both recordings. What is shared has one value
    in both; there the earlier and the new estimate are compared as if they were independent.
    """
    from scipy.special import stdtrit  # a third of a second to import

    before = collapse(names, fit)
    earlier = np.array([[name == copy.split("[", 1)[0] for copy in fit.names] for name in names], dtype=np.float64)
    earlier /= earlier.sum(axis=1, keepdims=True)
    variance = np.einsum("ik,kl,il->i", moved, solved.whole_covariance, moved)
    apart = np.einsum("ik,kl,il->i", earlier, fit.covariance, earlier) + np.diag(found.covariance)
    free = moved.any(axis=1)
    change = np.where(free, moved @ solved.values, found.values - before)
    deviation = np.sqrt(np.where(free, variance, apart))
    beyond = np.abs(change) > stdtrit(found.freedom, 0.975) * deviation
    return tuple(
        ParameterChange(
            name, float(before[k]), float(found.values[k]), float(change[k]), float(deviation[k]), bool(beyond[k])
        )
        for k, name in enumerate(names)
    )


def _shifted(earlier: Information, unknowns: tuple[str, ...], values: Array, solution: Array) -> Information:
    """Earlier factors as they would be with the new values: torque moved by what the difference of both makes.

    Their residuals stay, and so does the optimum: least squares on these and the new factors gives the new values.
    """
    position = {name: k for k, name in enumerate(unknowns)}
    joints = [np.array(joint.R) for joint in earlier.joints]
    for recording in np.unique(earlier.recording):
        blocks = earlier.recording == recording
        places = [_place(position, name, int(recording)) for name in earlier.names]
        difference = values - solution[places]
        for joint, R in zip(earlier.joints, joints, strict=True):
            R[blocks, :, -1] += R[blocks, :, :-1] @ difference[joint.parameters]
    factors = tuple(JointFactors(joint.parameters, R) for joint, R in zip(earlier.joints, joints, strict=True))
    return replace(earlier, joints=factors)


def _place(position: dict[str, int], name: str, recording: int) -> int:
    """Tell where the value of an earlier recording stands: shared, its own, or that of all earlier ones."""
    for each in (name, f"{name}[{recording + 1}]", f"{name}[1]"):
        if each in position:
            return position[each]
    raise KeyError(name)

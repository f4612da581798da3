"""Shapes of selected friction by separable least squares: Gauss-Newton steps from the best shape of a grid.

A friction law θ f(dq, s) is linear in the parameter θ for a given shape s (for instance a velocity). The regressor
gets a second column, the exact derivative of f with respect to the logarithm of s. Least squares on both columns
gives the coefficients θ and β. The logarithm of the shape then changes by β / θ, and the linear parameters are
estimated again [Golub1973]. Each step computes the factors of these columns once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.friction.candidates import Candidate, CandidateModel, choice_of
from armid.estimation.friction.forward_selection import SelectionPath
from armid.estimation.friction.heldout_gains import GainPrior, make_folds
from armid.information.information import Information

ExtendModel = Callable[[Sequence[frozenset[Candidate]]], tuple[CandidateModel, Information]]
"""Function that extends the model by given candidates of each joint, and computes the triangular factors of the data
for the extended model."""

STEPS = 5
"""Largest number of Gauss-Newton steps. Three steps reduce an error of a quarter of the shape to one percent."""

MAX_STEP = 0.35
"""Largest step of the logarithm of a shape: half of the distance to the next shape of the grid."""

MAX_CHANGE = np.log(2.0)
"""Largest change of the logarithm of a shape in all steps together: the distance to the next shape of the grid."""


def refine_shapes(
    path: SelectionPath,
    extend: ExtendModel,
    prior: GainPrior,
    weights: Array,
    allowed: Sequence[frozenset[Candidate]],
) -> SelectionPath:
    """Refines the shapes of the velocity laws of a selection by least squares.

    Args:
        path: The selection, with shapes of the grid.
        extend: Function that extends the model by candidates.
        prior: Prior on the parameters of the model without candidates.
        weights: Weight of each joint's rows, shape (n,).
        allowed: Candidates of the grid that each joint may get; no shape becomes smaller than the smallest of them.

    Returns:
        The selection with refined shapes.
    """
    joints = len(allowed)
    shapes = {
        (j, candidate): candidate
        for j, laws in enumerate(path.chosen(joints))
        for candidate in laws
        if choice_of(candidate.term).log_slope is not None
    }
    smallest = {
        (j, candidate): min(each.shape for each in allowed[j] | {candidate} if each.term == candidate.term)
        for j, candidate in shapes
    }
    best, least = shapes, np.inf
    for _ in range(STEPS if shapes else 0):
        error, steps = _step(_with_shapes(path, shapes), extend, prior, weights, joints)
        if error < least:
            best, least = shapes, error
        shapes = {
            key: replace(
                candidate,
                shape=max(_bounded_step(key[1].shape, candidate.shape, steps[key[0], candidate]), smallest[key]),
            )
            for key, candidate in shapes.items()
        }
    return _with_shapes(path, best)


def _step(
    path: SelectionPath, extend: ExtendModel, prior: GainPrior, weights: Array, joints: int
) -> tuple[float, dict[tuple[int, Candidate], float]]:
    """Weighted sum of squared residuals, prior included, and Gauss-Newton step of the logarithm of each shape.

    Args:
        path: The selection with the present shapes.
        extend: Function that extends the model by candidates.
        prior: Prior on the parameters of the model without candidates.
        weights: Weight of each joint's rows, shape (n,).
        joints: Number of joints.
    """
    chosen = path.chosen(joints)
    slopes = [
        frozenset(replace(candidate, slope=True) for candidate in laws if choice_of(candidate.term).log_slope)
        for laws in chosen
    ]
    extended, information = extend([laws | derivatives for laws, derivatives in zip(chosen, slopes, strict=True)])
    own = np.flatnonzero(extended.in_model)
    embedded = prior.embedded(extended.count, own)
    folds = make_folds(information, np.zeros(information.blocks, dtype=np.int64), weights, embedded, own)
    ridge = np.zeros(extended.count)
    for each in path.selected:
        for candidate in each.candidates:
            ridge[extended.columns[each.joint, candidate]] = each.ridge
    slope_columns = [extended.columns[j, candidate][0] for j, laws in enumerate(slopes) for candidate in laws]
    whole = np.arange(extended.count)
    values = np.append(-folds.whole.solve(np.setdiff1d(whole, slope_columns), ridge), 1.0)
    error = float(values @ folds.whole.with_prior @ values)
    solution = folds.whole.solve(whole, ridge)
    steps: dict[tuple[int, Candidate], float] = {}
    for j, laws in enumerate(slopes):
        for slope in laws:
            candidate = replace(slope, slope=False)
            size, change = solution[extended.columns[j, candidate][0]], solution[extended.columns[j, slope][0]]
            steps[j, candidate] = float(np.clip(change / size, -MAX_STEP, MAX_STEP)) if size else 0.0
    return error, steps


def _bounded_step(first: float, shape: float, step: float) -> float:
    """Shape after a step of its logarithm; it stays between the grid neighbours of the first shape.

    Args:
        first: Shape of the grid with which the search began.
        shape: Shape before the step.
        step: Change of the logarithm of the shape.
    """
    return float(first * np.exp(np.clip(np.log(shape / first) + step, -MAX_CHANGE, MAX_CHANGE)))


def _with_shapes(path: SelectionPath, shapes: dict[tuple[int, Candidate], Candidate]) -> SelectionPath:
    """Selection in which selected candidates have new shapes, also in the trials.

    Args:
        path: The selection.
        shapes: New candidate for each joint index and selected candidate.
    """

    def other(joint: int, candidates: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
        return tuple(shapes.get((joint, candidate), candidate) for candidate in candidates)

    selected = tuple(replace(each, candidates=other(each.joint, each.candidates)) for each in path.selected)
    trials = tuple(
        replace(trial, candidates=other(trial.joint, trial.candidates)) if trial.chosen else trial
        for trial in path.trials
    )
    return replace(path, selected=selected, trials=trials)

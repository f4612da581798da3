"""Shapes of chosen friction by separable least squares: a grid finds the valley, Gauss-Newton its bottom.

A law θ f(dq, s) is linear in θ for a given shape s. Beside the column f stands its exact derivative by log s; with
the coefficients θ and β that the data give them together, the shape moves by β / θ in its logarithm, and everything
linear follows anew [Golub1973]. Only the factors of these columns are needed, made again at each step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armid.estimation.friction.candidates import REFINED, Candidate, CandidateModel
from armid.estimation.friction.heldout_gains import GainPrior, make_folds
from armid.estimation.friction.search import SelectionPath
from armid.information.information import Information
from armid.values import Array

__all__ = ["Widen", "refine"]

Widen = Callable[[Sequence[frozenset[Candidate]]], tuple[CandidateModel, Information]]
"""Makes the superset of some pieces of each joint, and what the data say of it."""

STEPS = 5
"""Steps of Gauss-Newton: shapes a quarter off settle to a percent in three."""

FURTHEST = 0.35
"""Largest step of a shape's logarithm, half of the way to the next shape of the grid."""

SPAN = np.log(2.0)
"""How far a shape may go from that of the grid, in its logarithm: to its neighbour."""


def refine(found: SelectionPath, widen: Widen, prior: GainPrior, weights: Array, joints: int) -> SelectionPath:
    """The same choice with the shapes of velocity laws that the data fit best.

    Args:
        found: What was chosen, with shapes of the grid.
        widen: Makes columns of shapes.
        prior: What is believed of the model's own parameters.
        weights: Weight of each joint's rows, shape (n,).
        joints: Number of joints n.
    """
    shapes = {
        (j, piece): piece for j, own in enumerate(found.chosen(joints)) for piece in own if piece.term in REFINED
    }
    best, least = shapes, np.inf
    for _ in range(STEPS if shapes else 0):
        error, steps = _step(_renamed(found, shapes), widen, prior, weights, joints)
        if error < least:
            best, least = shapes, error
        shapes = {
            key: replace(piece, shape=_moved(key[1].shape, piece.shape, steps[key[0], piece]))
            for key, piece in shapes.items()
        }
    return _renamed(found, best)


def _step(
    found: SelectionPath, widen: Widen, prior: GainPrior, weights: Array, joints: int
) -> tuple[float, dict[tuple[int, Candidate], float]]:
    """Squared error that is left with the shapes as they are, and by how much the logarithm of each wants to move."""
    chosen = found.chosen(joints)
    slopes = [frozenset(replace(piece, slope=True) for piece in own if piece.term in REFINED) for own in chosen]
    wide, information = widen([own | more for own, more in zip(chosen, slopes, strict=True)])
    spread = prior.spread(wide.count, np.flatnonzero(wide.own))
    once = make_folds(information, np.zeros(information.blocks, dtype=np.int64), weights, spread)
    ridge = np.zeros(wide.count)
    for each in found.taken:
        for piece in each.pieces:
            ridge[wide.columns[each.joint, piece]] = each.ridge
    at = [wide.columns[j, piece][0] for j, own in enumerate(slopes) for piece in own]
    whole = np.arange(wide.count)
    values = np.append(-once.solve(once.whole, np.setdiff1d(whole, at), ridge), 1.0)
    error = float(values @ (once.whole + spread.products) @ values)
    both = once.solve(once.whole, whole, ridge)
    steps: dict[tuple[int, Candidate], float] = {}
    for j, own in enumerate(slopes):
        for slope in own:
            piece = replace(slope, slope=False)
            size, change = both[wide.columns[j, piece][0]], both[wide.columns[j, slope][0]]
            steps[j, piece] = float(np.clip(change / size, -FURTHEST, FURTHEST)) if size else 0.0
    return error, steps


def _moved(first: float, shape: float, step: float) -> float:
    """A shape after a step, no further from the grid's than its neighbours."""
    return float(first * np.exp(np.clip(np.log(shape / first) + step, -SPAN, SPAN)))


def _renamed(found: SelectionPath, shapes: dict[tuple[int, Candidate], Candidate]) -> SelectionPath:
    """The choice and its evidence with other shapes of what was taken."""

    def other(joint: int, pieces: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
        return tuple(shapes.get((joint, piece), piece) for piece in pieces)

    taken = tuple(replace(each, pieces=other(each.joint, each.pieces)) for each in found.taken)
    trials = tuple(
        replace(trial, pieces=other(trial.joint, trial.pieces)) if trial.chosen else trial for trial in found.trials
    )
    return replace(found, taken=taken, trials=trials)

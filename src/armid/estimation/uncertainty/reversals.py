"""Effect of reversals on an estimate: a comparison with the estimate that leaves out rows next to them.

Where a joint turns round, dry friction takes all of its range within milliseconds: the joint sticks for a moment, or
its velocity, filtered as it is, passes zero a little earlier or later than the true one. What the model lacks there
is no noise. It has the sign of the acceleration and comes when this is largest, so it looks like mass, and neither
scatter nor spectrum of the residuals tells how far it moves the estimate. Two estimates that both are right where
the model is do [Hausman1978]: with these rows and without.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.frequency_bands import named_columns
from armid.information.column_source import column_source
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.regressor_rows import rows
from armid.measurement.band import Band
from armid.measurement.observations import ObservedRun
from armid.values import Array

__all__ = ["moved_among_unknowns", "moved_by_reversals"]

SLOW = 0.1
"""Share of its RMS speed below which a joint turns round."""

LOBE = 0.5
"""Half-width of a low-pass kernel's main lobe, in periods of its cut-off: as far as a reversal is felt in earnest."""

LEAST = 1e-8
"""Smallest eigenvalue of the normal equations with unit columns, over the largest, at which the rows that are left
determine an estimate."""

LEFT = 0.1
"""Share of a direction's information that rows away from reversals must have for a comparison there."""


def moved_by_reversals(problem: EstimationProblem, values: Array, weights: Array, prior: Array) -> Array | None:
    """By how much an estimate moves where rows next to reversals are left out, shape (b,).

    Args:
        problem: With its samples.
        values: The estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        prior: Precision of what holds it beside the data, shape (b, b).

    Returns:
        `None` where the rows that are left do not determine an estimate.
    """
    normal, pull = np.array(prior, dtype=np.float64), np.zeros(len(values))
    for _, mine, columns, side in _away(problem, weights):
        normal[mine[:, None], mine] += columns @ columns.T
        pull[mine] += columns @ (side - values[mine] @ columns)
    return _solved(normal, pull)


def moved_among_unknowns(
    problem: EstimationProblem,
    values: Array,
    weights: Array,
    through: Sequence[Array],
    rest: tuple[Array, Array],
    root: Array,
) -> Array:
    """The same for u unknowns that the parameters of the columns follow from, of which the samples show a part.

    What rows next to reversals nearly alone show cannot be compared, and stays where it is.

    Args:
        problem: With its samples, about b parameters.
        values: Parameters of each joint's torque, shape (n, b).
        weights: Weight of each joint's rows, shape (n,).
        through: How each joint's parameters follow from the unknowns, shapes (b, u).
        rest: Normal equations (u, u) and pull (u,) of all that is not in the samples.
        root: Factor of the inverse of the normal equations of everything, shape (u, u).

    Returns:
        The move, shape (u,).
    """
    n, b = values.shape
    normals, pulls = np.zeros((n, b, b)), np.zeros((n, b))
    for j, mine, columns, side in _away(problem, weights):
        normals[j, mine[:, None], mine] += columns @ columns.T
        pulls[j, mine] += columns @ (side - values[j, mine] @ columns)
    normal, pull = np.array(rest[0], dtype=np.float64), np.array(rest[1], dtype=np.float64)
    for own, of, by in zip(through, normals, pulls, strict=True):
        normal += own.T @ of @ own
        pull += own.T @ by
    share, directions = np.linalg.eigh(root.T @ normal @ root)
    inverse = np.where(share > LEFT, 1.0 / np.maximum(share, LEFT), 0.0)
    return np.asarray(root @ (directions @ (inverse * (directions.T @ (root.T @ pull)))), dtype=np.float64)


def _away(problem: EstimationProblem, weights: Array) -> Iterator[tuple[int, NDArray[np.int64], Array, Array]]:
    """Weighted rows away from reversals: joint, numbers of its parameters, columns (k, M) and torque (M,)."""
    model, base, observations = problem.require_samples("cover")
    source = column_source(model, base)
    for given in observations.runs:
        run = with_hysteresis_states(model, given, observations.band)
        own = named_columns(source, problem.information.names, run)
        counts = run.mask & _sliding(run, observations.band)
        for begin, x in rows(source, run, observations.band):
            for j, (first, last) in enumerate(zip(source.layout.offset, source.layout.offset[1:], strict=False)):
                block = weights[j] * x[first:last][:, counts[begin : begin + x.shape[1], j]]
                yield j, own[j], block[:-1], block[-1]


def _solved(normal: Array, pull: Array) -> Array | None:
    """The move of an estimate that these pull at; `None` where they do not determine it."""
    size = np.sqrt(np.diag(normal))
    if not (size > 0.0).all():
        return None
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(size, size))
    if eigenvalues[0] <= LEAST * eigenvalues[-1]:
        return None
    return np.asarray(vectors @ ((vectors.T @ (pull / size)) / eigenvalues) / size, dtype=np.float64)


def _sliding(run: ObservedRun, band: Band) -> NDArray[np.bool_]:
    """Rows of each joint that no reversal reaches through half a row or the main lobe of the filter, shape (M, n)."""
    speed = np.abs(run.motion.dq)
    slow = speed < SLOW * np.sqrt(np.mean(speed**2, axis=0))
    reach = -(-run.step // 2) if band.family == "none" else round(LOBE * run.rate / band.cutoff)
    counts = np.concatenate([np.zeros((1, slow.shape[1]), dtype=np.int64), slow.cumsum(axis=0)])
    low, high = np.maximum(run.rows - reach, 0), np.minimum(run.rows + reach + 1, len(slow))
    return counts[high] == counts[low]

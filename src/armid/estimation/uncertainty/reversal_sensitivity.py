"""Effect of velocity reversals on an estimate: comparison of the estimates with and without rows near reversals.

Near a reversal dry friction passes through its whole range within milliseconds: the joint sticks for a moment, or the
filtered velocity crosses zero a little earlier or later than the true velocity. The resulting model error is not
noise. This error has the sign of the acceleration and occurs when the acceleration is largest, so it biases the
inertias. Neither the scatter nor the spectrum of the residuals shows this bias. If the model is correct, the
estimates with and without these rows agree except for noise; a larger difference shows the bias [Hausman1978].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance_choice_thresholds import MIN_INFORMATION, SLOW_SHARE
from armid.estimation.uncertainty.cross_products_by_frequency import column_numbers
from armid.information.kept_rows import kept_rows
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.measurement.processing.row_mask import LOBE_HALF_WIDTH

MIN_EIGENVALUE = 1e-8
"""Smallest ratio of the smallest to the largest eigenvalue of the normal matrix (columns of unit length) with which
the rows away from reversals determine an estimate."""


def shift_by_reversals(problem: EstimationProblem, values: Array, weights: Array, prior: Array) -> Array | None:
    """Shift of an estimate if rows near reversals are left out, shape (b,).

    Args:
        problem: Problem with its samples.
        values: The estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        prior: Precision of the prior, shape (b, b).

    Returns:
        The shift; `None` if the rows away from reversals do not determine an estimate.
    """
    normal, pull = np.array(prior, dtype=np.float64), np.zeros(len(values))
    for _, parameters, columns, side in _rows_away_from_reversals(problem, weights):
        normal[parameters[:, None], parameters] += columns @ columns.T
        pull[parameters] += columns @ (side - values[parameters] @ columns)
    return _solve(normal, pull)


def shift_of_unknowns(
    problem: EstimationProblem,
    values: Array,
    weights: Array,
    column_maps: Sequence[Array],
    remaining: tuple[Array, Array],
    root: Array,
) -> Array:
    """Shift of an estimate of u unknowns if rows near reversals are left out.

    The parameters are linear functions of the unknowns. In directions that only rows near reversals determine, no
    comparison is possible, and the shift is zero.

    Args:
        problem: Problem with its samples, in b parameters.
        values: Parameters of each joint's torque, shape (n, b).
        weights: Weight of each joint's rows, shape (n,).
        column_maps: Matrices from the unknowns to each joint's parameters, shapes (b, u).
        remaining: Normal matrix (u, u) and negative gradient (u,) of all information except the samples: prior and
            factors of earlier recordings.
        root: Factor of the inverse of the whole normal matrix, shape (u, u).

    Returns:
        The shift, shape (u,).
    """
    n, b = values.shape
    normals, pulls = np.zeros((n, b, b)), np.zeros((n, b))
    for j, parameters, columns, side in _rows_away_from_reversals(problem, weights):
        normals[j, parameters[:, None], parameters] += columns @ columns.T
        pulls[j, parameters] += columns @ (side - values[j, parameters] @ columns)
    normal, pull = np.array(remaining[0], dtype=np.float64), np.array(remaining[1], dtype=np.float64)
    for column_map, joint_normal, joint_pull in zip(column_maps, normals, pulls, strict=True):
        normal += column_map.T @ joint_normal @ column_map
        pull += column_map.T @ joint_pull
    share, directions = np.linalg.eigh(root.T @ normal @ root)
    inverse = np.where(share > MIN_INFORMATION, 1.0 / np.maximum(share, MIN_INFORMATION), 0.0)
    return np.asarray(root @ (directions @ (inverse * (directions.T @ (root.T @ pull)))), dtype=np.float64)


def _rows_away_from_reversals(
    problem: EstimationProblem, weights: Array
) -> Iterator[tuple[int, NDArray[np.int64], Array, Array]]:
    """Yields weighted rows away from reversals.

    Yields:
        Index of the joint, indices of its k parameters, columns (k, M) and torque (M,) of M rows.
    """
    model, base, observations = problem.require_samples("cover")
    every = kept_rows(model, base, observations)
    source = every.source
    for index, run in enumerate(every.observations.runs):
        column_map = column_numbers(source, problem.information.names, run)
        counts = run.mask & _is_away(run, observations.band)
        for batch in every.of_run(index):
            x, chosen = batch.x, counts[batch.begin : batch.begin + batch.x.shape[1]]
            for j, (first, last) in enumerate(zip(source.layout.offset, source.layout.offset[1:], strict=False)):
                block = weights[j] * x[first:last][:, chosen[:, j]]
                yield j, column_map[j], block[:-1], block[-1]


def _solve(normal: Array, pull: Array) -> Array | None:
    """Solution of normal equations with a normal matrix and a right-hand side; `None` if the matrix is singular."""
    size = np.sqrt(np.diag(normal))
    if not (size > 0.0).all():
        return None
    eigenvalues, vectors = np.linalg.eigh(normal / np.outer(size, size))
    if eigenvalues[0] <= MIN_EIGENVALUE * eigenvalues[-1]:
        return None
    return np.asarray(vectors @ ((vectors.T @ (pull / size)) / eigenvalues) / size, dtype=np.float64)


def _is_away(run: ObservedRun, band: Band) -> NDArray[np.bool_]:
    """Mask (M, n) of the rows of a run that are away from reversals of the joint.

    No reversal lies within the samples that are averaged for the row or within the main lobe of the filter.
    """
    speed = np.abs(run.motion.dq)
    slow = speed < SLOW_SHARE * np.sqrt(np.mean(speed**2, axis=0))
    reach = -(-run.step // 2) if band.family == "none" else round(LOBE_HALF_WIDTH * run.rate / band.cutoff)
    counts = np.concatenate([np.zeros((1, slow.shape[1]), dtype=np.int64), slow.cumsum(axis=0)])
    low, high = np.maximum(run.rows - reach, 0), np.minimum(run.rows + reach + 1, len(slow))
    return counts[high] == counts[low]

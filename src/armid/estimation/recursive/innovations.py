"""Innovations of a block (errors of the torque predicted from earlier rows): size, and correlation of blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.recursive.state import Innovations, RecursiveState
from armid.information.information import Information

CREEP = 2.0
"""Largest ratio of the squared error of a block to the usual squared error with which a block with a sudden change
enters the average that gives the usual error; a larger ratio is replaced by this limit."""


def normalized_innovation(state: RecursiveState, values: Array, new: Information) -> tuple[Array, Array]:
    """Computes the error of the torque that the estimate predicts for new rows, relative to usual errors.

    Args:
        state: State before the rows.
        values: Estimate of that state, shape (b,).
        new: The rows, one block.

    Returns:
        Two arrays of shape (n,): the squared torque error divided by its expected value; and the square root of this
        ratio, divided by the usual value of this root.
    """
    error = np.zeros(new.n)
    if state.root is None:
        return error, error
    stats = state.innovations
    known = (stats.blocks > 0.0) & (stats.level > 0.0)
    for j, joint in enumerate(new.joints):
        indices, R = joint.parameters, state.weights[j] * joint.R[0]
        # The noise has the usual level; the uncertainty of the estimate does not scale with it.
        uncertainty = np.sum((R[:, :-1] @ state.root[indices]) ** 2) / (stats.level[j] if known[j] else 1.0)
        error[j] = np.sum((R[:, -1] - R[:, :-1] @ values[indices]) ** 2) / (max(new.rows[0, j], 1) + uncertainty)
    level = np.where(known, stats.level, np.where(error > 0.0, error, 1.0))
    return error, np.sqrt(error / level)


def after_a_gap(stats: Innovations) -> Innovations:
    """Statistics of the innovations after a block without rows.

    They stay the same, but the next block counts as uncorrelated with earlier blocks.
    """
    return replace(stats, normalized_innovation=np.zeros_like(stats.level), pull=np.zeros_like(stats.pull))


def update_noise_color(
    before: RecursiveState,
    values: Array,
    new: Information,
    half: Array,
    error: tuple[Array, Array],
    discount: float,
    *,
    usual: bool,
) -> Innovations:
    """Updates the statistics of the innovations with one more block.

    Args:
        before: State before the block, with the weights after it.
        values: Estimate of that state, shape (b,).
        new: The block.
        half: Square root of the inverse normal matrix of all information after the block, shape (b, b).
        error: Result of `normalized_innovation` for the block.
        discount: Factor by which earlier blocks are discounted, for joints that have rows in the new block.
        usual: True if no sudden change was detected; a block with a change has little effect on the statistics.
    """
    stats = before.innovations
    observed = new.rows[0] > 0
    if before.root is None:
        return stats
    # What is known of a joint's noise is as old as its last rows.
    discounts = np.where(observed, discount, 1.0)
    blocks = discounts * stats.blocks + observed
    # A persistently large error becomes the usual one over time.
    bounded = error[0] if usual else np.minimum(error[0], CREEP * stats.level)
    level = np.where(observed, stats.level + (bounded - stats.level) / np.maximum(blocks, 1.0), stats.level)
    pull, power, expected = np.zeros_like(stats.pull), discounts * stats.power, discounts * stats.expected
    for j in np.flatnonzero(observed):
        indices, R = new.joints[j].parameters, before.weights[j] * new.joints[j].R[0]
        pull[j, indices] = R[:, :-1].T @ (R[:, -1] - R[:, :-1] @ values[indices])
        projected = R[:, :-1] @ half[indices]
        inner = projected.T @ R[:, :-1]
        white = float(np.sum(projected**2))
        uncertain = float(np.sum((inner @ before.root[indices]) ** 2))
        # Share of the gradient that noise causes; the uncertainty of the estimate causes the rest.
        share = (white / (white + uncertain)) ** 2 if usual and white > 0.0 else 0.0
        size, previous = half.T @ pull[j], half.T @ stats.pull[j]
        power[j] += share * (size @ (size + 2.0 * previous) - uncertain) / max(white, np.finfo(np.float64).tiny)
        expected[j] += share
    return Innovations(error[1], level, blocks, pull, power, expected)

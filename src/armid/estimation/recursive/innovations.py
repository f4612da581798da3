"""Innovations of a block: normalised size, and the correlation of the noise between blocks."""

from __future__ import annotations

import numpy as np

from armid.estimation.recursive.state import Innovations, RecursiveState
from armid.information.information import Information
from armid.values import Array

__all__ = ["normalized_innovation", "update_noise_color"]

CREEP = 2.0
"""Largest squared error, over the usual one, that a block with a change contributes to the usual error."""


def normalized_innovation(state: RecursiveState, values: Array, new: Information) -> tuple[Array, Array]:
    """Normalised innovation of new rows against the prediction of the estimate before them.

    Args:
        state: State before the rows.
        values: Its estimate, shape (b,).
        new: The rows, one block.

    Returns:
        Squared torque error over its expected value, and the root of its ratio to the usual level, shapes (n,).
    """
    error = np.zeros(new.n)
    if state.root is None:
        return error, error
    news = state.innovations
    known = (news.blocks > 0.0) & (news.level > 0.0)
    for j, joint in enumerate(new.joints):
        own, R = joint.parameters, state.weights[j] * joint.R[0]
        # The noise has the usual level; the uncertainty of the estimate does not scale with it.
        unsure = np.sum((R[:, :-1] @ state.root[own]) ** 2) / (news.level[j] if known[j] else 1.0)
        error[j] = np.sum((R[:, -1] - R[:, :-1] @ values[own]) ** 2) / (max(new.rows[0, j], 1) + unsure)
    level = np.where(known, news.level, np.where(error > 0.0, error, 1.0))
    return error, np.sqrt(error / level)


def update_noise_color(
    before: RecursiveState,
    values: Array,
    new: Information,
    half: Array,
    error: tuple[Array, Array],
    left: float,
    *,
    usual: bool,
) -> Innovations:
    """Updates the statistics of the innovations with one more block.

    Args:
        before: State before the block, with the weights after it.
        values: Its estimate, shape (b,).
        new: The block.
        half: Square root of the inverse of all information after the block, shape (b, b).
        error: Result of `normalized_innovation` for the block.
        left: Discount factor of earlier blocks.
        usual: Whether no change was detected; a block with a change hardly enters the noise statistics.
    """
    news = before.innovations
    seen = new.rows[0] > 0
    if before.root is None:
        return news
    blocks = left * news.blocks + seen
    # A persistently large error becomes the usual one over time.
    bounded = error[0] if usual else np.minimum(error[0], CREEP * news.level)
    level = np.where(seen, news.level + (bounded - news.level) / np.maximum(blocks, 1.0), news.level)
    pull, power, expected = np.zeros_like(news.pull), left * news.power, left * news.expected
    for j in np.flatnonzero(seen):
        own, R = new.joints[j].parameters, before.weights[j] * new.joints[j].R[0]
        pull[j, own] = R[:, :-1].T @ (R[:, -1] - R[:, :-1] @ values[own])
        told = R[:, :-1] @ half[own]
        inner = told.T @ R[:, :-1]
        white = float(np.sum(told**2))
        unsure = float(np.sum((inner @ before.root[own]) ** 2))
        # Share of the gradient that is due to noise, not to the uncertainty of the estimate.
        share = (white / (white + unsure)) ** 2 if usual and white > 0.0 else 0.0
        size, beside = half.T @ pull[j], half.T @ news.pull[j]
        power[j] += share * (size @ (size + 2.0 * beside) - unsure) / max(white, np.finfo(np.float64).tiny)
        expected[j] += share
    return Innovations(error[1], level, blocks, pull, power, expected)

"""NumPy twin of the adjoint: derivatives of columns by exact differences.

By Lagrange's equations every column is linear in q̈ and quadratic in q̇. In the position of one joint it is a
trigonometric polynomial of degree two (revolute) or a polynomial of degree two (prismatic). Central differences of
quadratics are exact, and for f = Σ_{k ≤ 2} a_k cos kx + b_k sin kx

    f'(x) = (½ - √½) (f(x + π/2) - f(x - π/2)) + f(x + π/4) - f(x - π/4).
"""

from __future__ import annotations

import math

import numpy as np

from armid.kernel import reference_factor
from armid.kernel.column_layout import ColumnLayout
from armid.kernel.tree import Tree
from armid.values import Array

TURNS = ((math.pi / 2.0, 0.5 - math.sqrt(0.5)), (math.pi / 4.0, 1.0))
STEPS = ((1.0, 0.5),)


def columns_adjoint(
    tree: Tree, layout: ColumnLayout, q: Array, dq: Array, ddq: Array, cotangent: Array
) -> tuple[Array, Array, Array]:
    """Gradients (N, n) by q, dq and ddq of the sum of cotangents (columns, N) times columns."""
    bodies = np.zeros(layout.columns, dtype=np.bool_)
    pairs = [j for i in range(tree.n) for j in tree.ancestors(i)]
    for j, targets in zip(pairs, layout.target.reshape(-1, 10), strict=True):
        bodies[layout.offset[j] + targets[targets >= 0]] = True
    weights = np.where(bodies[:, None], cotangent, 0.0)
    no_terms = np.zeros((len(layout.term), len(q)))

    def value(states: list[Array]) -> Array:
        at, speed, acceleration = states
        made = reference_factor.columns(tree, layout, at, speed, acceleration, np.zeros_like(q), no_terms)
        return np.sum(weights * made, axis=0)

    gradients = [np.zeros_like(q) for _ in range(3)]
    for kind, gradient in enumerate(gradients):
        for j in range(tree.n):
            for step, factor in TURNS if kind == 0 and not tree.prismatic[j] else STEPS:
                for sense in (1.0, -1.0):
                    states = [q, dq, ddq]
                    states[kind] = states[kind].copy()
                    states[kind][:, j] += sense * step
                    gradient[:, j] += sense * factor * value(states)
    return gradients[0], gradients[1], gradients[2]


def information_adjoint(
    tree: Tree, layout: ColumnLayout, q: Array, dq: Array, ddq: Array, terms: Array, weights: Array, slopes: Array
) -> tuple[Array, Array, Array, Array]:
    """Gradients by q, dq, ddq (N, n) and terms (e, N) of a function of the information with symmetric `slopes`."""
    x = reference_factor.columns(tree, layout, q, dq, ddq, np.zeros_like(q), terms)
    worth = np.zeros_like(x)
    for weight, p, start in zip(weights, layout.parameters, layout.offset[:-1], strict=True):
        own = slice(start, start + len(p))
        worth[own] = 2.0 * weight * slopes[np.ix_(p, p)] @ x[own]
    if not len(layout.target):
        return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q), worth[layout.term]
    return *columns_adjoint(tree, layout, q, dq, ddq, worth), worth[layout.term]

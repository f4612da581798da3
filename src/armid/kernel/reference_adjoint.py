"""NumPy twin of the adjoint: derivatives of regressor columns by difference formulas that are exact.

By Lagrange's equations, every column is linear in q̈ and quadratic in q̇. As a function of the position of one joint,
it is a trigonometric polynomial of degree two (revolute joint) or a polynomial of degree two (prismatic joint).
Central differences of polynomials of degree two are exact. For f = Σ_{k ≤ 2} a_k cos kx + b_k sin kx the exact
formula is

    f'(x) = (½ - √½) (f(x + π/2) - f(x - π/2)) + f(x + π/4) - f(x - π/4).
"""

from __future__ import annotations

import math

import numpy as np

from armid.checked_array import Array
from armid.kernel import reference_factor
from armid.kernel.joint_column_layout import ColumnLayout
from armid.kernel.tree import Tree

TURNS = ((math.pi / 2.0, 0.5 - math.sqrt(0.5)), (math.pi / 4.0, 1.0))
STEPS = ((1.0, 0.5),)


def columns_adjoint(
    tree: Tree, layout: ColumnLayout, q: Array, dq: Array, ddq: Array, cotangent: Array
) -> tuple[Array, Array, Array]:
    """Gradients of the sum of all products `cotangent` · column entry by q, dq and ddq, shape (N, n) each."""
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
    """Gradients of a scalar function of the information matrix by q, dq and ddq (N, n), and by `terms` (e, N).

    `slopes` is the derivative of the function with respect to the information matrix; it must be symmetric.
    """
    x = reference_factor.columns(tree, layout, q, dq, ddq, np.zeros_like(q), terms)
    worth = np.zeros_like(x)
    for weight, p, start in zip(weights, layout.parameters, layout.offset[:-1], strict=True):
        own = slice(start, start + len(p))
        worth[own] = 2.0 * weight * slopes[np.ix_(p, p)] @ x[own]
    if not len(layout.target):
        return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q), worth[layout.term]
    return *columns_adjoint(tree, layout, q, dq, ddq, worth), worth[layout.term]

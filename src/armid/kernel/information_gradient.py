"""Kernel functions for the design of motions: information matrix of N samples, and its gradient by the joint states.

In all functions, `tree` is the arm, `layout` the layout of the kept columns, q, dq and ddq are joint positions,
velocities and accelerations, shape (N, n), and `chosen` names a build of the kernel.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

import armid.kernel._native as _native
from armid.checked_array import Array
from armid.errors import ArmidError
from armid.kernel import reference_adjoint, reference_factor
from armid.kernel.dispatch import TWIN, compiled_arm, in_use, states_of
from armid.kernel.joint_column_layout import ColumnLayout
from armid.kernel.tree import Tree

WIDEST = 8
"""Number of samples in the widest register. The adjoint processes this number of samples at once, so shorter motions
are padded with zeros."""


@lru_cache(maxsize=64)
def _parameter(layout: ColumnLayout) -> NDArray[np.int32]:
    """Index of the parameter of every column of a layout; the result is cached for each layout."""
    return layout.parameter


def columns_adjoint(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    cotangent: ArrayLike,
    *,
    chosen: str | None = None,
) -> tuple[Array, Array, Array]:
    """Gradients of the sum of all products `cotangent` · column entry by q, dq and ddq, shape (N, n) each.

    Only the rigid-body columns are differentiated. The entries of `cotangent` for other terms and for torques are
    ignored.

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        cotangent: Weight of each entry of `columns`, shape (columns, N).
        chosen: Build of the kernel.
    """
    q, dq, ddq = states_of(tree, q, dq, ddq)
    samples = len(q)
    cotangent = np.ascontiguousarray(cotangent, dtype=np.float64)
    if cotangent.shape != (layout.columns, samples):
        raise ArmidError(f"cotangent must have shape {(layout.columns, samples)}; found {cotangent.shape}.")
    if not len(layout.target):
        return np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_adjoint.columns_adjoint(tree, layout, q, dq, ddq, cotangent)
    missing = max(0, WIDEST - samples)
    if missing:
        q, dq, ddq = (np.pad(x, ((0, missing), (0, 0))) for x in (q, dq, ddq))
        cotangent = np.pad(cotangent, ((0, 0), (0, missing)))
    out = np.empty_like(q), np.empty_like(q), np.empty_like(q)
    _native.columns_adjoint(chosen, compiled_arm(tree), layout.offset, layout.target, q, dq, ddq, cotangent, *out)
    return (out[0][:samples], out[1][:samples], out[2][:samples]) if missing else out


def information(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    terms: ArrayLike,
    weights: ArrayLike,
    count: int,
    *,
    chosen: str | None = None,
) -> Array:
    """Information matrix G = Σ_j weights_j X_jᵀ X_j of the columns X_j of each joint j, shape (count, count).

    The torques are not included. The columns are not stored.

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        terms: Regressor columns of the torque terms that are kept, one in each row, shape (e, N).
        weights: Weight of each joint's rows, shape (n,).
        count: Number of parameters of the layout.
        chosen: Build of the kernel.
    """
    q, dq, ddq = states_of(tree, q, dq, ddq)
    terms = np.ascontiguousarray(terms, dtype=np.float64)
    weights = np.ascontiguousarray(weights, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_factor.information(tree, layout, q, dq, ddq, terms, weights, count)
    out = np.zeros((count, count))
    _native.information(
        chosen, compiled_arm(tree), layout.offset, layout.target, layout.term, _parameter(layout),
        q, dq, ddq, terms, weights, out,
    )  # fmt: skip
    return out


def information_adjoint(
    tree: Tree,
    layout: ColumnLayout,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    terms: ArrayLike,
    weights: ArrayLike,
    slopes: ArrayLike,
    *,
    chosen: str | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Gradients of a scalar function of the information matrix by q, dq and ddq (N, n), and by `terms` (e, N).

    Args:
        tree: The arm.
        layout: Layout of the kept columns.
        q: Joint positions, shape (N, n).
        dq: Joint velocities, shape (N, n).
        ddq: Joint accelerations, shape (N, n).
        terms: Regressor columns of the torque terms that are kept, one in each row, shape (e, N).
        weights: Weight of each joint's rows, shape (n,).
        slopes: Derivative of the function with respect to the information matrix, symmetric, shape (count, count).
        chosen: Build of the kernel.
    """
    q, dq, ddq = states_of(tree, q, dq, ddq)
    terms, weights, slopes = (np.ascontiguousarray(x, dtype=np.float64) for x in (terms, weights, slopes))
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_adjoint.information_adjoint(tree, layout, q, dq, ddq, terms, weights, slopes)
    out = np.zeros_like(q), np.zeros_like(q), np.zeros_like(q), np.empty_like(terms)
    _native.information_adjoint(
        chosen, compiled_arm(tree), layout.offset, layout.target, layout.term, _parameter(layout),
        q, dq, ddq, terms, weights, slopes, *out,
    )  # fmt: skip
    return out
